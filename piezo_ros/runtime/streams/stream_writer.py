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

"""The writer of a block stream: numbers the samples and publishes them as serialized blocks."""

import math
import struct
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from rclpy.publisher import Publisher

from piezo_ros.runtime.streams.outlet import Outlet
from piezo_ros.runtime.streams.owner import StreamOwner
from piezo_ros.runtime.streams.stream_copy import StreamCopy
from piezo_ros.streams import BlockCodec

__all__ = ['StreamWriter']

_unpack_number = struct.Struct('<d').unpack_from
_pair = struct.Struct('<2d')  # index and sample period of a block
# A message, what writes its index and sample period, and its samples.
_Block = tuple[bytearray, Callable[[int, float], None], NDArray[np.float64]]
_KEPT_LENGTHS = 16  # lengths of blocks for which a message is kept and written over
_LONGEST_KEPT = 10_000  # samples


class StreamWriter:
    """
    Publisher of one stream, sample by sample or in blocks.

    Parameters
    ----------
    node : StreamOwner
        The node that publishes.
    stream : str
        The stream.
    copy_samples : int
        Largest block of a copy for a recorder, see `stream_copy`; 0 for none.

    Attributes
    ----------
    next_index : int
        Index of the next sample.
    message : bytearray
        The newest sample as a serialized block of one.

    """

    def __init__(self, node: StreamOwner, stream: str, copy_samples: int = 0) -> None:
        self.stream = stream
        self.outlet = Outlet(node, stream)
        self.publisher = self.outlet.publisher
        self.copy = StreamCopy(node, stream, copy_samples) if copy_samples else None
        self.next_index = 0
        self._codec = BlockCodec(stream)
        # One buffer serves all blocks of one sample: only its numbers are written anew.
        head, numbers = self._codec.single
        self.message = bytearray(head) + bytes(numbers.size)
        self._write_numbers = partial(numbers.pack_into, self.message, len(head))
        # Longer blocks have one buffer for each length.
        self._blocks: dict[int, _Block] = {}
        self._period_s = 0.0
        self._first = 0
        self._ended = False

    def start(self, index: int, sample_period_s: float) -> None:
        """Begin a run at an index."""
        self._period_s = sample_period_s
        self._begin(index)
        self._ended = False
        self._write_numbers(index, sample_period_s, 0.0)

    def _begin(self, index: int) -> None:
        self._first = self.next_index = index
        if self.copy:
            self.copy.start(index, self._period_s)

    @property
    def publishers(self) -> list[Publisher]:
        """The publishers of the stream and, where there is one, of its copy."""
        return [outlet.publisher for outlet in self._outlets]

    @property
    def _outlets(self) -> list[Outlet]:
        return [self.outlet, self.copy.outlet] if self.copy else [self.outlet]

    def count_readers(self) -> int:
        """Return the number of reliable readers of the stream and its copy."""
        return sum(outlet.count_readers() for outlet in self._outlets)

    @property
    def is_waiting(self) -> bool:
        """Whether a reader does not take at present."""
        return self.outlet.is_waiting or bool(self.copy and self.copy.outlet.is_waiting)

    def wait_at_most(self, patience_s: float = math.inf) -> None:
        """Make it a fault of the run if a reader does not take for so long, by default never."""
        for outlet in self._outlets:
            outlet.most_patience_s = patience_s

    @property
    def newest(self) -> float:
        """The newest sample, 0 before the first."""
        return _unpack_number(self.message, len(self.message) - 8)[0]  # type: ignore[no-any-return]

    @property
    def newest_index(self) -> int:
        """Index of the newest sample, 0 before the first."""
        return max(self.next_index - 1, 0)

    @property
    def sent(self) -> int:
        """Number of samples of this run."""
        return self.next_index - self._first

    def begin_at(self, index: int) -> None:
        """Begin at another index, unless something is sent already."""
        if not self.sent:
            self._begin(index)

    def publish_one(self, value: float) -> None:
        """Publish the next sample; raises as `Outlet.publish`."""
        index = self.next_index
        self._write_numbers(index, self._period_s, value)
        self.outlet.publish(self.message, index)
        self.next_index = index + 1
        copy = self.copy
        if copy:
            copy.recent[index % copy.recent.size] = value
            if index + 1 == copy.due:
                copy.flush(index + 1)

    def publish(self, values: Sequence[float] | NDArray[np.float64]) -> None:
        """Publish the next samples, at least one, as one block; raises as `publish_one`."""
        count, index = len(values), self.next_index
        if count == 1:
            self.publish_one(float(values[0]))
            return
        raw, write_pair, samples = self._blocks.get(count) or self._new_block(count)
        write_pair(index, self._period_s)
        samples[:] = values
        self.outlet.publish(raw, index)
        # These are sent, whatever becomes of the copy.
        self.next_index = index + count
        self._write_numbers(index + count - 1, self._period_s, values[-1])
        if self.copy:
            self.copy.pass_on(raw, index, count)

    def _new_block(self, count: int) -> _Block:
        """Make the buffer of the blocks of a length; it is kept unless the block is large."""
        head = self._codec.header(count)[0]
        at = len(head)
        raw = bytearray(head) + bytes(_pair.size + 8 * count)
        block = (
            raw, partial(_pair.pack_into, raw, at),
            np.frombuffer(raw, '<f8', -1, at + _pair.size))
        if count <= _LONGEST_KEPT:
            if len(self._blocks) >= _KEPT_LENGTHS:
                self._blocks.clear()
            self._blocks[count] = block
        return block

    def flush(self) -> None:
        """Send what the copy has collected; raises as `publish_one`."""
        if self.copy:
            self.copy.flush(self.next_index)

    def end(self) -> None:
        """Publish the end of the stream, once, behind what was sent; raises as `publish_one`."""
        if self._ended:
            return
        self._ended = True
        try:
            self.outlet.publish(
                self._codec.encode(self.next_index, self._period_s, []), self.next_index)
        finally:
            if self.copy:
                self.copy.end(self.next_index)
