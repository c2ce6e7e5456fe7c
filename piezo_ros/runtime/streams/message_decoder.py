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

"""Decoding of the messages of one stream, in any encoding that a middleware delivers."""

import numpy as np
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float64MultiArray

from piezo_ros.streams import (
    ArrayBlock,
    BlockCodec,
    MalformedBlockError,
    OtherEncodingError,
    block_from_message_fields,
)

__all__ = ['MessageDecoder']

_KEPT_LENGTHS = 16  # lengths of messages for which the head is kept
_LONGEST_KEPT = 10_000  # samples


class MessageDecoder:
    """
    Decoder of serialized blocks, checked.

    Parameters
    ----------
    codec : BlockCodec
        The codec of the stream.

    Attributes
    ----------
    heads : dict of int to bytes
        For some lengths in bytes: all bytes ahead of the numbers of a block of that length. A
        message that begins so needs no other check of its layout.

    """

    def __init__(self, codec: BlockCodec) -> None:
        self.heads: dict[int, bytes] = {}
        self._codec = codec

    def decode(self, raw: bytes) -> ArrayBlock:
        """Return the block of a message; raises MalformedBlockError if it is no valid one."""
        try:
            return self._codec.decode_array(raw)
        except OtherEncodingError as other:
            # Some middleware writes another encoding; rclpy knows how to read it.
            try:
                message = deserialize_message(raw, Float64MultiArray)
            except _rclpy.RMWError:
                raise MalformedBlockError(str(other)) from None
            if len(message.layout.dim) != 1:
                raise MalformedBlockError(
                    f'layout.dim has {len(message.layout.dim)} entries, a block has exactly 1'
                ) from None
            dimension = message.layout.dim[0]
            return block_from_message_fields(
                dimension.label, dimension.size, dimension.stride, message.layout.data_offset,
                np.asarray(message.data))

    def extent(self, raw: bytes) -> tuple[int, int]:
        """Return index and number of samples of a message; raises as `decode` does."""
        index, _, samples = self.decode(raw)
        return index, samples.size

    def remember_head(self, length: int, samples: int) -> None:
        """Keep the head of the messages of a length in bytes, which have so many samples."""
        if length in self.heads or samples > _LONGEST_KEPT:
            return  # The dot product of a longer one would wake the threads of the linear algebra.
        if len(self.heads) >= _KEPT_LENGTHS:
            self.heads.clear()
        head = self._codec.header(samples)[0]
        if len(head) + 8 * (samples + 2) == length:
            self.heads[length] = head
