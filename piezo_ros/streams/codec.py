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
Serialization of blocks: little-endian CDR of ``std_msgs/Float64MultiArray`` and back.

`struct` and `numpy` alone do it, some thirty times faster than the typed message.
"""

import math
import struct
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.streams.block import (
    HEADER_NUMBERS,
    MAXIMUM_INDEX,
    ArrayBlock,
    Block,
    MalformedBlockError,
    block_from_message_fields,
)
from piezo_ros.streams.names import label_of, stream_with_label

__all__ = ['BlockCodec', 'OtherEncodingError', 'labelled_stream']

_ENCAPSULATION: Final = b'\x00\x01\x00\x00'  # CDR, little-endian
_XCDR2: Final = tuple(bytes([kind]) for kind in range(6, 12))


class OtherEncodingError(MalformedBlockError):
    """A message in an encoding that only the middleware may read, not `BlockCodec`."""


class BlockCodec:
    """
    Serializer of the blocks of one stream.

    Parameters
    ----------
    stream : str
        One of `STREAMS`.

    Raises
    ------
    ValueError
        If the stream is not one of `STREAMS`.

    """

    def __init__(self, stream: str) -> None:
        self.stream = stream
        self.label = label_of(stream)
        text = self.label.encode() + b'\x00'
        self._label_head = _ENCAPSULATION + struct.pack('<II', 1, len(text)) + text
        # Typed publishers leave garbage in the padding, so it is skipped, never compared.
        self._layout_offset = 4 + -(-(len(self._label_head) - 4) // 4) * 4
        self._length_offset = self._layout_offset + 12
        self._data_offset = 4 + -(-(self._length_offset + 4 - 4) // 8) * 8
        self._single_head = self._head(1)
        self._single_size = len(self._single_head) + 24
        self._single_layout = self._single_head[self._layout_offset:self._length_offset + 4]
        self._pack_single = struct.Struct('<3d').pack
        self._unpack_single = struct.Struct('<3d').unpack_from
        self._unpack_pair = struct.Struct('<2d').unpack_from

    def _head(self, samples: int) -> bytes:
        layout = struct.pack('<4I', samples, samples, HEADER_NUMBERS, samples + HEADER_NUMBERS)
        head = self._label_head.ljust(self._layout_offset, b'\x00') + layout
        return head.ljust(self._data_offset, b'\x00')

    def encode_one(self, index: int, sample_period_s: float, sample: float) -> bytes:
        """Return the CDR bytes of a block of one sample (hot path, arguments not checked)."""
        return self._single_head + self._pack_single(index, sample_period_s, sample)

    def encode(
        self, index: int, sample_period_s: float, samples: NDArray[np.float64] | Sequence[float],
    ) -> bytes:
        """
        Return the CDR bytes of a block.

        Parameters
        ----------
        index : int
            Index of the first sample, 0 … 2**53 - 1.
        sample_period_s : float
            Sample period, seconds.
        samples : array_like of float, shape (N,)
            The samples; N = 0 ends the stream.

        Returns
        -------
        bytes
            Little-endian CDR with its encapsulation header.

        """
        values = np.ascontiguousarray(samples, dtype='<f8')
        prefix = struct.pack('<2d', index, sample_period_s)
        return self._head(values.size) + prefix + values.tobytes()

    @property
    def single(self) -> tuple[bytes, struct.Struct]:
        """Bytes ahead of the numbers of a block of one sample, and the layout of its numbers."""
        return self._single_head, struct.Struct('<3d')

    def header(self, samples: int) -> tuple[bytes, bytes]:
        """
        Return the bytes that precede the numbers of a little-endian block.

        Parameters
        ----------
        samples : int
            The number of samples N.

        Returns
        -------
        header, mask : bytes, bytes
            The bytes up to the first number, and a mask of the same length: 0xff where these bytes
            matter, 0 where they are options or padding, which may have any value.

        """
        mask = bytearray(b'\xff' * self._data_offset)
        mask[2:4] = bytes(2)
        label_end, layout_end = len(self._label_head), self._length_offset + 4
        mask[label_end:self._layout_offset] = bytes(self._layout_offset - label_end)
        mask[layout_end:] = bytes(self._data_offset - layout_end)
        return self._head(samples), bytes(mask)

    def index_and_period(self, raw: bytes) -> tuple[float, float]:
        """
        Return index and sample period, seconds, of a block (hot path, numbers not checked).

        Parameters
        ----------
        raw : bytes
            CDR bytes of a block of this stream; its layout and its samples are not checked.

        Raises
        ------
        MalformedBlockError, struct.error
            If the bytes are those of another stream, or end early.

        """
        if raw.startswith(self._label_head):
            index, sample_period_s = self._unpack_pair(raw, self._data_offset)
            return index, sample_period_s
        block = self.decode(raw)
        return block.index, block.sample_period_s

    def decode(self, raw: bytes) -> Block:
        """
        Return the block in serialized bytes of any conforming publisher.

        Parameters
        ----------
        raw : bytes
            Little-endian CDR of a ``std_msgs/Float64MultiArray``.

        Returns
        -------
        Block
            The checked block.

        Raises
        ------
        MalformedBlockError
            If the layout is another, the index is no integer in 0 … 2**53 - 1, the sample period
            is not positive and finite, or a sample is not finite.

        """
        if (
            len(raw) == self._single_size
            and raw.startswith(self._label_head)
            and raw[self._layout_offset:self._length_offset + 4] == self._single_layout
        ):
            index, period, sample = self._unpack_single(raw, self._data_offset)
            # A sample minus itself is zero only where it is finite.
            if sample - sample == 0.0 and period > 0.0 and index % 1.0 == 0.0 and 0.0 <= index:
                if index < MAXIMUM_INDEX and period < math.inf:
                    return Block(int(index), period, (sample,))
        index, period, samples = self.decode_array(raw)
        return Block(index, period, tuple(samples.tolist()))

    def decode_array(self, raw: bytes) -> ArrayBlock:
        """Return the block as `decode` does, its samples as an array."""
        label, size, stride, offset, data = _parse(raw)
        if label != self.label:
            raise MalformedBlockError(
                f'layout.dim[0].label is {label!r}, the stream {self.stream!r} needs '
                f'{self.label!r}')
        return block_from_message_fields(label, size, stride, offset, data)


def labelled_stream(raw: bytes) -> str | None:
    """Return the stream that the label of a serialized block names, None if this is no block."""
    try:
        label, size, _, offset, data = _parse(raw)
    except MalformedBlockError:
        return None
    if offset != HEADER_NUMBERS or data.size != size + HEADER_NUMBERS:
        return None
    return stream_with_label(label)


def _parse(raw: bytes) -> tuple[str, int, int, int, NDArray[np.float64]]:
    """Read the CDR fields of a Float64MultiArray with one dimension."""
    if raw[:2] not in (b'\x00\x01', b'\x00\x00'):
        name = 'XCDR2, ' if raw[:1] == b'\x00' and raw[1:2] in _XCDR2 else ''
        raise OtherEncodingError(
            f'CDR encapsulation is {name}{raw[:4].hex()}, only plain CDR is read')
    order = '<' if raw[1] == 1 else '>'
    try:
        dimensions, length = struct.unpack_from(order + 'II', raw, 4)
        if dimensions != 1:
            raise MalformedBlockError(f'layout.dim has {dimensions} entries, a block has exactly 1')
        label = raw[12:12 + max(length - 1, 0)].decode('utf-8', 'replace')
        position = 12 + length
        if length and raw[position - 1:position] not in (b'\x00', b''):
            raise MalformedBlockError(f'layout.dim[0].label {label!r} does not end in a zero byte')
        position += -(position - 4) % 4
        size, stride, offset, count = struct.unpack_from(order + '4I', raw, position)
        position += 16
        position += -(position - 4) % 8
        data = np.frombuffer(raw, dtype=order + 'f8', count=count, offset=position)
    except (struct.error, ValueError) as error:
        if isinstance(error, MalformedBlockError):
            raise
        raise MalformedBlockError(f'message of {len(raw)} bytes ends early: {error}') from None
    return label, size, stride, offset, data.astype(np.float64, copy=False)
