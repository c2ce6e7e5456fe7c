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
Marks the functions that exist once and run twice: as Python in a node, compiled on arrays offline.

A marked function is ordinary Python over numbers, named tuples and anything indexable; its state is
an argument and is changed in place. A node calls it with lists and need not import numba;
`piezo_ros.model.compiled` makes the same source callable from compiled kernels. Both give the same
bits, because the operations and their order are the same and no fast mathematics is allowed.
"""

from collections.abc import Callable, MutableSequence
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ['Vector', 'as_arrays', 'marked_steps', 'step']

# A list in a node, a float64 array in a compiled kernel.
Vector: TypeAlias = MutableSequence[float] | NDArray[np.float64]

_Function = TypeVar('_Function', bound=Callable[..., Any])
_marked: list[Callable[..., Any]] = []


def step(function: _Function) -> _Function:
    """Mark a function as callable from compiled kernels; the function itself is unchanged."""
    _marked.append(function)
    return function


def marked_steps() -> tuple[Callable[..., Any], ...]:
    """Return every function marked so far, in the order of definition."""
    return tuple(_marked)


def as_arrays(value: Any) -> Any:
    """Return named tuples of lists as the same named tuples of float64 arrays, for a kernel."""
    if isinstance(value, list):
        return np.array(value, dtype=np.float64)
    if isinstance(value, tuple):
        return type(value)(*(as_arrays(element) for element in value))
    return value
