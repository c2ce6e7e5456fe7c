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
One block: consecutive samples of one stream, and the rules that it must obey.

A block is a ``std_msgs/Float64MultiArray`` with the fields

    layout.dim         = [{label: '<stream>_<unit>', size: N, stride: N}]
    layout.data_offset = 2
    data               = [index of the first sample, sample period in s, s_0, …, s_{N-1}]

N = 0 ends a stream; its index is the number of samples sent.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = [
    'HEADER_NUMBERS',
    'MAXIMUM_INDEX',
    'ArrayBlock',
    'Block',
    'MalformedBlockError',
    'block_from_message_fields',
]

HEADER_NUMBERS: Final = 2  # layout.data_offset: index and sample period
MAXIMUM_INDEX: Final = 2**53  # a double represents every integer below it


class MalformedBlockError(ValueError):
    """A message that is no valid block; the text names the field, its value and what is allowed."""


class Block(NamedTuple):
    """
    N consecutive samples of one stream.

    Attributes
    ----------
    index : int
        Index of the first sample; the count of samples sent when N = 0.
    sample_period_s : float
        Sample period, seconds.
    samples : tuple of float
        The N samples, in the stream's unit; empty at the end of the stream.

    """

    index: int  # type: ignore[assignment]  # hides tuple.index, which blocks do not need
    sample_period_s: float
    samples: tuple[float, ...]


class ArrayBlock(NamedTuple):
    """
    A `Block` with its samples as an array.

    Attributes
    ----------
    index : int
        Index of the first sample.
    sample_period_s : float
        Sample period, seconds.
    samples : ndarray, shape (N,)
        In the stream's unit.

    """

    index: int  # type: ignore[assignment]
    sample_period_s: float
    samples: NDArray[np.float64]


def block_from_message_fields(
    label: str, size: int, stride: int, data_offset: int, data: NDArray[np.float64],
) -> ArrayBlock:
    """
    Return the block in the fields of a message, checked.

    Parameters
    ----------
    label, size, stride : str, int, int
        The fields of ``layout.dim[0]``; the label is only named in errors.
    data_offset : int
        The field ``layout.data_offset``.
    data : ndarray of float64, shape (N + 2,)
        The field ``data``.

    Returns
    -------
    ArrayBlock
        The block.

    Raises
    ------
    MalformedBlockError
        If the layout is another, the index is no integer in 0 … 2**53 - 1, the sample period is
        not positive and finite, or a sample is not finite.

    """
    data = np.asarray(data, dtype=np.float64)
    if data_offset != HEADER_NUMBERS:
        raise MalformedBlockError(
            f'layout.data_offset of {label!r} is {data_offset}, a block has {HEADER_NUMBERS} '
            '(index and sample period)')
    if data.size != size + HEADER_NUMBERS:
        raise MalformedBlockError(
            f'data of {label!r} holds {data.size} numbers, layout.dim[0].size {size} needs '
            f'{size + HEADER_NUMBERS}')
    if stride != size:
        raise MalformedBlockError(
            f'layout.dim[0].stride of {label!r} is {stride}, it must equal the size {size}')
    index, period = float(data[0]), float(data[1])
    if not (0.0 <= index < MAXIMUM_INDEX and index == int(index)):
        raise MalformedBlockError(
            f'index (data[0]) of {label!r} is {index}, allowed are integers in 0 … 2**53 - 1')
    if not 0.0 < period < math.inf:
        raise MalformedBlockError(
            f'sample period (data[1]) of {label!r} is {period} s, it must be positive and finite')
    samples = data[HEADER_NUMBERS:]
    finite = np.isfinite(samples)
    if not finite.all():
        first = int(np.argmin(finite))
        raise MalformedBlockError(
            f'sample {int(index) + first} of {label!r} is {samples[first]}, it must be finite')
    return ArrayBlock(int(index), period, samples)
