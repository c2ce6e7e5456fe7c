"""Gives memory back that holds code which was only needed to start."""

import ctypes
from pathlib import Path
from typing import Final

__all__ = ['give_back_code']

_MAPS: Final = Path('/proc/self/smaps')
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
        lines = _MAPS.read_text(encoding='utf-8').splitlines()
    except OSError:
        return 0
    advise = ctypes.CDLL(None).madvise
    advise.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
    given = start = end = 0
    for line in lines:
        first, *others = line.split()
        if not first.endswith(':'):
            access, path = others[0], others[-1]
            ours = access.startswith('r') and 'w' not in access and path.startswith('/')
            start, end = (int(bound, 16) for bound in first.split('-')) if ours else (0, 0)
        elif first == 'Anonymous:' and end and int(others[0]) == 0:
            # Nothing was written there, as relocation does: all of it is in the file.
            if advise(start, end - start, _MADV_DONTNEED) == 0:
                given += end - start
    return given
