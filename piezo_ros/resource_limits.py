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
from typing import Final

try:
    import resource
except ImportError:  # not on Windows, which has no such limits
    resource = None  # type: ignore[assignment]

__all__ = ['COMMAND_BYTES', 'GRAPH_BYTES', 'limit_behind', 'memory_limit', 'memory_problem']

# What a process maps at most before its first sample: libraries, compiler, threads. Most of it is
# reserved and never used.
COMMAND_BYTES: Final = 700 << 20
GRAPH_BYTES: Final = 2 << 30  # with the middleware; the composed loop is the largest
_MEBIBYTE: Final = 1 << 20
_MEMORY_LIMITS: Final = (
    ('RLIMIT_AS', 'address space', 'ulimit -v'),
    ('RLIMIT_DATA', 'data segment', 'ulimit -d'),
)


def _limit(name: str) -> int | None:
    """Return a limit of this process, None where there is none."""
    number = getattr(resource, name, None)
    if number is None:
        return None
    limit = resource.getrlimit(number)[0]
    return None if limit == resource.RLIM_INFINITY else limit


def memory_limit() -> str:
    """Return a text for the limits on the memory of this process; '' for none."""
    return ', '.join(
        f'{what} of at most {limit / _MEBIBYTE:.0f} MiB ({command})'
        for name, what, command in _MEMORY_LIMITS if (limit := _limit(name)) is not None)


def memory_problem(needed_bytes: int) -> str:
    """
    Return why a process has too little memory to begin, '' where it has enough.

    Parameters
    ----------
    needed_bytes : int
        `COMMAND_BYTES` or `GRAPH_BYTES`.

    """
    limit = _limit('RLIMIT_AS')
    if limit is None or limit >= needed_bytes:
        return ''
    return (
        f'a process has an {memory_limit()}, at least {needed_bytes / _MEBIBYTE:.0f} MiB are '
        'needed')


def limit_behind(error: BaseException) -> str:
    """Return the limit that may have caused an error, as the end of a sentence; '' for none."""
    if isinstance(error, MemoryError) and memory_limit():
        return f'; a process has an {memory_limit()}'
    size = _limit('RLIMIT_FSIZE')
    if isinstance(error, OSError) and error.errno == errno.EFBIG and size is not None:
        return f'; a file may have at most {size} bytes (ulimit -f)'
    return ''
