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
Decoding of many blocks of one stream at once, as arrays.

Blocks of equal length differ in their numbers alone, so that they are compared with the one header
that they must have and read as the rows of a matrix. Blocks of any other layout are decoded one by
one.
"""

from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag.container.chunk_scan import HEAD_BYTES, MESSAGE_HEAD_BYTES, unaligned
from piezo_ros.streams import BlockCodec, MalformedBlockError
from piezo_ros.streams.block import HEADER_NUMBERS

__all__ = ['Blocks', 'decoded']

_ENCAPSULATION_BYTES: Final = 4
_U2, _U8 = np.dtype('<u2'), np.dtype('<u8')
_Floats = NDArray[np.float64]
_Integers = NDArray[np.int64]


class Blocks(NamedTuple):
    """
    Consecutive blocks of one stream.

    Attributes
    ----------
    indices, periods_s : ndarray of float64, shape (blocks,)
        Index and sample period, seconds, of each block.
    counts : ndarray of int64, shape (blocks,)
        Number of samples of each block.
    samples : ndarray of float64, shape (counts.sum(),)
        The samples of all blocks, in the stream's unit.

    """

    indices: _Floats
    periods_s: _Floats
    counts: _Integers
    samples: _Floats


def decoded(
    codec: BlockCodec, data: bytes, messages: NDArray[np.int64],
) -> tuple[Blocks, MalformedBlockError | None]:
    """
    Decode the blocks of some messages.

    Parameters
    ----------
    codec : BlockCodec
        That of the stream.
    data : bytes
        A buffer with message records.
    messages : ndarray of int64
        Offsets of the message records of the stream in it; at least one.

    Returns
    -------
    blocks : Blocks
        The blocks up to the first malformed one; their numbers are not checked.
    error : MalformedBlockError or None
        What is wrong with the block that follows these; None if there is none.

    """
    lengths = unaligned(data, '<u8')[messages + 1].astype(np.int64) + HEAD_BYTES
    # Where only few blocks differ in length, as in a recording of ragged blocks by another
    # program, several groups cost little more than one.
    members = [np.flatnonzero(lengths == length) for length in _distinct(lengths)]
    groups: list[Blocks] = []
    for group in members:
        size = int(lengths[group[0]]) - MESSAGE_HEAD_BYTES
        blocks = _equal_blocks(codec, data, messages[group], size)
        if blocks is None:
            return _one_by_one(codec, data, messages, lengths)
        groups.append(blocks)
    return _merged(members, groups), None


def _equal_blocks(
    codec: BlockCodec, data: bytes, messages: _Integers, size: int,
) -> Blocks | None:
    """Decode blocks of one size, None unless every one has the layout of `BlockCodec`."""
    layout = _layout(codec.stream, size)
    if layout is None:
        return None
    count, encapsulation, expected, matters = layout
    starts = messages + MESSAGE_HEAD_BYTES
    stride = _stride(starts)
    if (_rows(data, starts, stride, _U2, 1) != encapsulation).any():
        return None
    words = _rows(
        data, starts + _ENCAPSULATION_BYTES, stride, _U8, (size - _ENCAPSULATION_BYTES) // 8)
    # NumPy works along the last axis: where blocks are short, there are more blocks than words.
    heads = np.ascontiguousarray(words[:, :len(expected) + HEADER_NUMBERS].T)
    if ((heads[:len(expected)] & matters) != expected).any():
        return None
    indices, periods_s = heads[len(expected):].view('<f8').astype(np.float64)
    samples = words[:, len(heads):].view('<f8').astype(np.float64).ravel()
    return Blocks(indices, periods_s, np.full(messages.size, count), samples)


class _Layout(NamedTuple):
    """
    What the blocks of one size of a stream begin with.

    Attributes
    ----------
    samples : int
        Samples in a block.
    encapsulation : int
        The first two bytes.
    expected, matters : ndarray of uint64, shape (words, 1)
        The words from the encapsulation to the first number, and which of their bits matter.

    """

    samples: int
    encapsulation: int
    expected: NDArray[np.uint64]
    matters: NDArray[np.uint64]


@lru_cache(maxsize=256)
def _layout(stream: str, size: int) -> _Layout | None:
    """Return the layout of the blocks of a stream with so many bytes; None if none has so many."""
    codec = BlockCodec(stream)
    count, rest = divmod(size - len(codec.header(0)[0]), 8)
    count -= HEADER_NUMBERS
    if count < 0 or rest:
        return None
    header, mask = codec.header(count)
    expected, matters = (
        np.frombuffer(content[_ENCAPSULATION_BYTES:], _U8)[:, np.newaxis]
        for content in (header, mask))
    return _Layout(count, int.from_bytes(header[:2], 'little'), expected, matters)


def _one_by_one(
    codec: BlockCodec, data: bytes, messages: _Integers, lengths: _Integers,
) -> tuple[Blocks, MalformedBlockError | None]:
    """Decode blocks of any layout, up to the first malformed one."""
    blocks = []
    malformed = None
    for start, length in zip(messages.tolist(), lengths.tolist(), strict=True):
        try:
            blocks.append(codec.decode(data[start + MESSAGE_HEAD_BYTES:start + length]))
        except MalformedBlockError as error:
            malformed = error
            break
    samples = [np.asarray(block.samples, dtype=np.float64) for block in blocks]
    return Blocks(
        np.array([block.index for block in blocks], dtype=np.float64),
        np.array([block.sample_period_s for block in blocks], dtype=np.float64),
        np.array([sample.size for sample in samples], dtype=np.int64),
        np.concatenate([*samples, np.empty(0)])), malformed


def _distinct(values: _Integers) -> list[int]:
    """Return the distinct values; most often there is one, found without sorting."""
    first = int(values[0])
    return [first] if (values == first).all() else [int(value) for value in np.unique(values)]


def _stride(starts: _Integers) -> int | None:
    """Return the distance of places that follow one another regularly, None if they do not."""
    if starts.size < 2:
        return None
    strides = np.diff(starts)
    return int(strides[0]) if (strides == strides[0]).all() else None


def _rows(
    data: bytes, starts: _Integers, stride: int | None, kind: np.dtype[Any], width: int,
) -> NDArray[Any]:
    """Return so many numbers from each start on, a view where the stride is regular."""
    if stride is not None:
        return np.ndarray(
            (starts.size, width), kind, buffer=data, offset=int(starts[0]),
            strides=(stride, kind.itemsize))
    gathered = unaligned(data, f'V{width * kind.itemsize}')[starts]
    return gathered.view(kind).reshape(starts.size, width)


def _merged(members: list[_Integers], groups: list[Blocks]) -> Blocks:
    """Put the blocks of all groups back into the order of their messages."""
    if len(groups) == 1:
        return groups[0]
    messages = sum(group.size for group in members)
    indices, periods = np.empty(messages), np.empty(messages)
    counts = np.empty(messages, dtype=np.int64)
    for group, blocks in zip(members, groups, strict=True):
        indices[group] = blocks.indices
        periods[group] = blocks.periods_s
        counts[group] = blocks.counts
    ends = np.cumsum(counts)
    samples = np.empty(int(ends[-1]))
    for group, blocks in zip(members, groups, strict=True):
        count = int(blocks.counts[0])
        places = (ends[group] - count)[:, np.newaxis] + np.arange(count)
        samples[places.ravel()] = blocks.samples
    return Blocks(indices, periods, counts, samples)
