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
from typing import Any, Final, TypeVar, cast

# Vector mathematics of another maker gives other bits than the scalar functions of libm.
os.environ.setdefault('NUMBA_DISABLE_INTEL_SVML', '1')

import numba
import numpy as np
from numba.core import types
from numba.extending import intrinsic, register_jitable
from numba.np import arrayobj
from numpy.typing import NDArray

from piezo_ros.model.step import marked_steps

__all__ = [
    'Operands',
    'brief_kernel',
    'bytes_at',
    'direct',
    'floats_at',
    'integers_at',
    'kernel',
]

_arrays: Any = arrayobj  # without types
_make_array = _arrays.make_array
_Function = TypeVar('_Function', bound=Callable[..., Any])
# Kernels allocate nothing; without the counting of references (nrt) they are four times faster.
_OPTIONS: dict[str, Any] = {'fastmath': False, 'error_model': 'numpy', '_nrt': False}
# A step that is left to the compiler's own judgement may stay a call, which hands its hundred
# constants and states over one by one: ten times as long as what it computes.
_STEP_OPTIONS: dict[str, Any] = {**_OPTIONS, 'forceinline': True}
_registered: set[Callable[..., Any]] = set()


def kernel(function: _Function) -> _Function:
    """
    Compile a function over float64 arrays that calls shared steps.

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
    Do as `kernel`, for what takes less time than to let other threads run meanwhile.

    Parameters
    ----------
    function : callable
        As `kernel` takes it.

    Returns
    -------
    callable
        The compiled function, cached on disk.

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


def direct(compiled: Any, *examples: Any) -> Callable[..., Any]:
    """
    Return what a kernel runs for arguments of some types, without the look-up of them at each call.

    Parameters
    ----------
    compiled : callable
        What `kernel` returned.
    *examples : value
        Arguments of those types; the kernel is compiled for them, not called.

    """
    types = tuple(map(cast('Any', numba.typeof), examples))
    return cast('Callable[..., Any]', compiled.compile(types))


class Operands:
    """
    Arrays and integers for a kernel that finds them by their places.

    A call with six arrays takes longer to unwrap them than the step that it does; here one array of
    addresses stands for all. In the kernel, `floats_at`, `integers_at` and `bytes_at` give the
    arrays back.

    Parameters
    ----------
    *operands : ndarray of float64, int64 or uint8, or int
        One-dimensional contiguous arrays, kept alive as long as this object, and plain numbers.

    Attributes
    ----------
    places : ndarray of int64, shape (2 n,)
        Address and size of each array; of a number itself and 0.

    """

    def __init__(self, *operands: NDArray[Any] | int) -> None:
        self._operands = operands
        self.places = np.array([_place(operand) for operand in operands], np.int64).ravel()


def _place(operand: NDArray[Any] | int) -> tuple[int, int]:
    if isinstance(operand, int):
        return operand, 0
    if operand.ndim != 1 or not operand.flags.c_contiguous or (
            operand.dtype not in (np.float64, np.int64, np.uint8)):
        raise ValueError(
            f'an array of {operand.dtype} and shape {operand.shape}; allowed are contiguous '
            'one-dimensional ones of float64, int64 or uint8')
    return operand.ctypes.data, operand.size


def _operand_of(item: Any) -> Any:
    """Return a function that gives an operand back as an array; only within kernels."""
    @intrinsic
    def operand(_typing: Any, places: Any, number: Any) -> Any:
        array_type = types.Array(item, 1, 'C')

        def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            # What numba.carray does; a kernel without reference counts may not return its result.
            table = _make_array(places)(context, builder, arguments[0])
            at = builder.mul(arguments[1], context.get_constant(types.intp, 2))
            address = builder.load(builder.gep(table.data, [at]))
            at = builder.add(at, context.get_constant(types.intp, 1))
            size = builder.load(builder.gep(table.data, [at]))
            item_bytes = context.get_constant(types.intp, item.bitwidth // 8)
            made = _make_array(array_type)(context, builder)
            _arrays.populate_array(
                made, data=builder.inttoptr(address, made.data.type), shape=[size],
                strides=[item_bytes], itemsize=item_bytes, meminfo=None)
            return made._getvalue()

        return array_type(places, types.intp), generate

    return operand


# Of `Operands.places` and the number of the operand.
floats_at: Final[Any] = _operand_of(types.float64)
integers_at: Final[Any] = _operand_of(types.int64)
bytes_at: Final[Any] = _operand_of(types.uint8)


@cache
def _cache_directory() -> Path:
    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256(numba.__version__.encode())
    for tier in ('model', 'control'):
        for source in sorted((package / tier).glob('*.py')):
            digest.update(source.read_bytes())
    root = os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache'
    return Path(root) / 'piezo_ros' / digest.hexdigest()[:16]
