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
Compiles array kernels around the shared steps (see `piezo_ros.model.step`).

Compiled code is kept in the user's cache under a digest of the package's own sources: numba alone
looks at the time stamp of the kernel's file only and would keep a kernel with former steps.
"""

import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

# Vector mathematics of another maker gives other bits than the scalar functions of libm.
os.environ.setdefault('NUMBA_DISABLE_INTEL_SVML', '1')

import numba
from numba.extending import register_jitable

from piezo_ros.model.step import marked_steps
from piezo_ros.user_directories import cache_directory

__all__ = ['brief_kernel', 'kernel']

_Function = TypeVar('_Function', bound=Callable[..., Any])
# Kernels allocate nothing; without the counting of references (nrt) they are four times faster.
_OPTIONS: dict[str, Any] = {'fastmath': False, 'error_model': 'numpy', '_nrt': False}
# A step that is left to the compiler's own judgement may stay a call, which hands its hundred
# constants and states over one by one: ten times as long as what it computes.
_STEP_OPTIONS: dict[str, Any] = {**_OPTIONS, 'forceinline': True}
_registered: set[Callable[..., Any]] = set()


def kernel(function: _Function) -> _Function:
    """
    Compile a function over float64 arrays that calls shared steps; it lets other threads run.

    Parameters
    ----------
    function : callable
        Python source within what numba compiles; every step it calls must be defined already.

    Returns
    -------
    callable
        The compiled function, cached on disk.

    """
    return _compiled(function, nogil=True)


def brief_kernel(function: _Function) -> _Function:
    """
    Do as `kernel` for calls of microseconds, which keep the interpreter's lock.

    To give the lock up and to get it back costs more than such a call, and far more where another
    thread takes it in between.
    """
    return _compiled(function, nogil=False)


def _compiled(function: _Function, *, nogil: bool) -> _Function:
    for shared in marked_steps():
        if shared not in _registered:
            register_jitable(**_STEP_OPTIONS)(shared)
            _registered.add(shared)
    # numba reads the directory when it is told to cache, so other packages keep their own.
    settings: Any = numba.config
    before = settings.CACHE_DIR
    settings.CACHE_DIR = str(_cache_directory())
    try:
        return cast('_Function', numba.njit(cache=True, nogil=nogil, **_OPTIONS)(function))
    finally:
        settings.CACHE_DIR = before


@cache
def _cache_directory() -> Path:
    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256(numba.__version__.encode())
    for tier in ('model', 'control'):
        for source in sorted((package / tier).rglob('*.py')):
            digest.update(source.read_bytes())
    return cache_directory() / 'piezo_ros' / digest.hexdigest()[:16]
