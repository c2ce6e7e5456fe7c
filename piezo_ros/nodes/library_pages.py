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

"""Gives memory back that holds code which was only needed to start."""

import ctypes
import re
from pathlib import Path
from typing import Final

__all__ = ['give_back_code']

_MAPS: Final = Path('/proc/self/smaps')
# Bounds of what is mapped from a file to be read, and in which nothing was written, as relocation
# does: all of it is in the file.
_whole_in_file: Final = re.compile(
    rb'^(\w+)-(\w+) r-\S+ .* /.*\n(?:[A-Z].*\n)*?Anonymous: +0 kB$', re.MULTILINE).findall
_MADV_DONTNEED: Final = 4  # of <sys/mman.h>


def give_back_code() -> int:
    """
    Let go of what is in memory of the files of libraries; what is needed is read from them again.

    The compiler alone has 70 MB there in every process, for the moment in which it loads a kernel,
    and half of all else is only ever used before the first sample.

    Returns
    -------
    int
        Number of bytes that may be taken; 0 where the system does not tell of its pages.

    """
    try:
        mappings = _MAPS.read_bytes()
    except OSError:
        return 0
    advise = ctypes.CDLL(None).madvise
    advise.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
    given = 0
    for bounds in _whole_in_file(mappings):
        start, end = (int(bound, 16) for bound in bounds)
        if advise(start, end - start, _MADV_DONTNEED) == 0:
            given += end - start
    return given
