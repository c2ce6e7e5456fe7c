# Copyright 2026 piezo_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
Limits of the system on a process (``ulimit``), told where they are the cause of a failure.

Memory that cannot be had ends in an abort within a compiled library, where nothing can be said any
more. Hence a limit that is too small is refused before these are loaded.
"""

import errno
import resource
from typing import Final

__all__ = ['MINIMUM_ADDRESS_BYTES', 'limit_behind', 'memory_limit', 'memory_problem']

# What a process of this package has mapped at most before its first sample, compiler included; most
# of it is reserved and never used.
MINIMUM_ADDRESS_BYTES: Final = 3 << 30
_MEBIBYTE: Final = 1 << 20
_MEMORY_LIMITS: Final = (
    (resource.RLIMIT_AS, 'address space', 'ulimit -v'),
    (resource.RLIMIT_DATA, 'data segment', 'ulimit -d'),
)


def memory_limit() -> str:
    """Return a text for the limits on the memory of this process; '' for none."""
    return ', '.join(
        f'{what} of at most {limit / _MEBIBYTE:.0f} MiB ({command})'
        for number, what, command in _MEMORY_LIMITS
        if (limit := resource.getrlimit(number)[0]) != resource.RLIM_INFINITY)


def memory_problem() -> str:
    """Return why the memory of this process is too small to begin; '' where it is not."""
    limits = [
        limit for number, _, _ in _MEMORY_LIMITS
        if (limit := resource.getrlimit(number)[0]) != resource.RLIM_INFINITY]
    if not limits or min(limits) >= MINIMUM_ADDRESS_BYTES:
        return ''
    return (
        f'this process has {memory_limit()}, at least {MINIMUM_ADDRESS_BYTES / _MEBIBYTE:.0f} MiB '
        'are needed')


def limit_behind(error: BaseException) -> str:
    """Return the limit that may have caused an error, as the end of a sentence; '' for none."""
    if isinstance(error, MemoryError) and memory_limit():
        return f'; this process has {memory_limit()}'
    size = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    if isinstance(error, OSError) and error.errno == errno.EFBIG and (
            size != resource.RLIM_INFINITY):
        return f'; a file may have at most {size} bytes (ulimit -f)'
    return ''
