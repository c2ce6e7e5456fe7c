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
Endpoints of the block streams: raw CDR in and out, checked for order.

The subscriptions are taken from directly, not through an executor; see docs/architecture.md for
what that gains.
"""

import math
import struct
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float64MultiArray

from piezo_ros.runtime.process.running_time import RunningTime
from piezo_ros.runtime.streams.outlet import Outlet
from piezo_ros.runtime.streams.owner import StreamOwner
from piezo_ros.runtime.streams.qos import STREAM
from piezo_ros.runtime.streams.run_fence import RunFence
from piezo_ros.runtime.streams.sample_queue import SampleQueue
from piezo_ros.runtime.streams.stream_copy import StreamCopy
from piezo_ros.streams import (
    ArrayBlock,
    BlockCodec,
    MalformedBlockError,
    OtherEncodingError,
    block_from_message_fields,
)

__all__ = ['StreamFault', 'StreamReader', 'StreamWriter']

_isfinite = math.isfinite
_unpack_pair = struct.Struct('<2d').unpack_from
_unpack_number = struct.Struct('<d').unpack_from
_WARN_S = 2.0  # a warning of one kind at most this often
_KEPT_LENGTHS = 16  # of blocks, for which is kept what is the same in all
_LONGEST_KEPT = 10_000  # samples


class StreamFault(Exception):
    """A stream that cannot go on; the text names the topic and what is wrong."""


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

    """

    def __init__(self, node: StreamOwner, stream: str, copy_samples: int = 0) -> None:
        self.stream = stream
        self.outlet = Outlet(node, stream)
        self.publisher = self.outlet.publisher
        self.copy = StreamCopy(node, stream, copy_samples) if copy_samples else None
        self.next_index = 0
        self._codec = BlockCodec(stream)
        # A block of one sample is written over the one before: no bytes are put together for it.
        head, numbers = self._codec.single
        self.message = bytearray(head) + bytes(numbers.size)
        self._write_numbers = partial(numbers.pack_into, self.message, len(head))
        # A longer block likewise, over the last one of its length.
        self._blocks: dict[int, tuple[bytearray, NDArray[np.float64]]] = {}
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
        """What publishes: the stream, and its copy where there is one."""
        return [outlet.publisher for outlet in self._outlets]

    @property
    def _outlets(self) -> list[Outlet]:
        return [self.outlet, self.copy.outlet] if self.copy else [self.outlet]

    def count_readers(self) -> int:
        """Return the number of readers of the stream or its copy that lose nothing."""
        return sum(outlet.count_readers() for outlet in self._outlets)

    @property
    def is_waiting(self) -> bool:
        """Whether a reader does not take at present."""
        return self.outlet.is_waiting or bool(self.copy and self.copy.outlet.is_waiting)

    @property
    def newest(self) -> float:
        """The newest sample, 0 before the first."""
        return _unpack_number(self.message, len(self.message) - 8)[0]  # type: ignore[no-any-return]

    @property
    def sent(self) -> int:
        """Number of samples of this run."""
        return self.next_index - self._first

    def begin_at(self, index: int) -> None:
        """Begin at another index, unless something is sent already."""
        if not self.sent:
            self._begin(index)

    def publish_one(self, value: float) -> None:
        """Publish the next sample."""
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
        """Publish the next samples, at least one, as one block."""
        count, index = len(values), self.next_index
        if count == 1:
            self.publish_one(float(values[0]))
            return
        raw, numbers = self._blocks.get(count) or self._new_block(count)
        numbers[0], numbers[1] = index, self._period_s
        numbers[2:] = values
        self.outlet.publish(raw, index)
        if self.copy:
            self.copy.pass_on(raw, index, count)
        self.next_index = index + count
        self._write_numbers(index + count - 1, self._period_s, values[-1])

    def _new_block(self, count: int) -> tuple[bytearray, NDArray[np.float64]]:
        """Make room for the messages of a length, once and for all unless they are large."""
        head = self._codec.header(count)[0]
        raw = bytearray(head) + bytes(8 * (count + 2))
        block = raw, np.frombuffer(raw, '<f8', -1, len(head))
        if count <= _LONGEST_KEPT:
            if len(self._blocks) >= _KEPT_LENGTHS:
                self._blocks.clear()
            self._blocks[count] = block
        return block

    def flush(self) -> None:
        """Send what the copy has collected."""
        if self.copy:
            self.copy.flush(self.next_index)

    def end(self) -> None:
        """Publish the end of the stream, once."""
        if not self._ended:
            self._ended = True
            raw = self._codec.encode(self.next_index, self._period_s, [])
            self.outlet.publish(raw, self.next_index)
            if self.copy:
                self.copy.pass_on(raw, self.next_index, 0)


class StreamReader:
    """
    Subscription of one stream; hands out blocks in order, counts what it refuses.

    Parameters
    ----------
    node : StreamOwner
        The node that subscribes.
    stream : str
        The stream.
    topic : str, optional
        Its topic, where that has another name.

    Attributes
    ----------
    next_index : int
        Index of the next sample.

    """

    def __init__(self, node: StreamOwner, stream: str, topic: str = '') -> None:
        self.stream = stream
        self.subscription = node.create_stream_subscription(
            Float64MultiArray, topic or stream, STREAM)
        self.queue = SampleQueue()
        self.refused = 0
        self.gaps = 0
        self.next_index = 0
        self.ended = False
        self.raw = b''  # the newest message, nothing where there was none
        self._node = node
        self._codec = BlockCodec(stream)
        self._single_head, numbers = self._codec.single
        self._single_size = len(self._single_head) + numbers.size
        self._unpack_single = struct.Struct(f'<{len(self._single_head)}s3d').unpack
        self._fence = RunFence(self._take_bytes, self._extent)
        self.held = self._fence.held  # messages that were taken before the run began
        self._take_message: Callable[[Any, bool], Any] = self.subscription.handle.take_message
        self._is_open = False  # a run has begun whose end has not come
        self._period_s: float | None = None
        self._fast_period_s = math.nan  # the period while the quick path may be taken, else NaN
        # Number of bytes -> what such a block begins with, of some that have come.
        self._heads: dict[int, bytes] = {}
        self._first = 0
        self._any_start = False
        self._warned = 0.0
        self._fault: StreamFault | None = None  # after what is in the queue
        self._lost: RunningTime | None = None  # since when it has had no writer
        self._received_then = 0

    def start(self, index: int, sample_period_s: float | None) -> None:
        """
        Begin a run.

        Parameters
        ----------
        index : int
            Index of the first sample; -1 takes any.
        sample_period_s : float or None
            The only sample period that is taken; None takes that of the first block.

        """
        self.queue.clear()
        self._interrupt()
        self._fence.begin(takes_any_start=index < 0)
        if self.held:
            self._take_message = self._take_held
        self._first = self.next_index = index
        self.refused = 0
        self.gaps = 0
        self.ended = False
        self._is_open = True
        self._any_start = index < 0
        self._period_s = sample_period_s
        self._fast_period_s = math.nan  # whatever comes first is looked at closely
        self._lost = None
        self._fault = None

    @property
    def received(self) -> int:
        """Number of samples of this run."""
        return self.next_index - self._first

    def example(self) -> bytes:
        """Return a message of one sample as the run that has begun expects it."""
        return self._codec.encode(0, self._period_s or 0.0, [0.0])

    def discard_rest(self) -> None:
        """Throw away what comes of a run that is over here, and not at its writer."""
        self._interrupt()
        self._fence.discard_rest()

    def _interrupt(self) -> None:
        """Tell the fence of a run whose end has not come."""
        if self._is_open and not self.ended:
            self._fence.interrupt(self.next_index if self.received else None)
        self._is_open = False

    def _take_bytes(self) -> bytes | None:
        taken = self.subscription.handle.take_message(Float64MultiArray, True)
        return None if taken is None else taken[0]

    def _extent(self, raw: bytes) -> tuple[int, int]:
        index, _, samples = self._decode(raw)
        return index, samples.size

    def _take_held(self, message_type: Any, is_raw: bool) -> Any:
        """Do what the subscription does, as long as there are messages that came before."""
        if self.held:
            return self.held.popleft(), None
        self._take_message = self.subscription.handle.take_message
        return self._take_message(message_type, is_raw)

    def take_one(self) -> float | None:
        """
        Return the next sample where it comes alone (hot path).

        None is the answer to everything else, which `take_rest` then looks at: no message, several
        samples, the end, a message that is refused.

        """
        taken = self._take_message(Float64MultiArray, True)
        if taken is None:
            self.raw = b''
            return None
        self.raw = raw = taken[0]
        if len(raw) == self._single_size:
            head, index, period_s, sample = self._unpack_single(raw)
            if (
                index == self.next_index and period_s == self._fast_period_s
                and sample - sample == 0.0 and head == self._single_head
            ):
                self.next_index += 1
                return sample  # type: ignore[no-any-return]
        return None

    def take_array(self) -> NDArray[np.float64] | None:
        """
        Return the samples of the next block, None where there is none (or it was refused).

        No samples at all are the end of the stream.

        Raises
        ------
        StreamFault
            If samples are missing or the sample period changes.

        """
        self.take_raw()
        return self.take_rest()

    def take_raw(self) -> bool:
        """Take a message for `take_rest`; return whether there was one."""
        taken = self._take_message(Float64MultiArray, True)
        self.raw = b'' if taken is None else taken[0]
        return taken is not None

    def take_rest(self) -> NDArray[np.float64] | None:
        """Do what `take_array` does with the message that was taken before."""
        raw = self.raw
        head = self._heads.get(len(raw))
        if head is not None and raw.startswith(head):
            at = len(head)
            index, period_s = _unpack_pair(raw, at)
            if index == self.next_index and period_s == self._fast_period_s:
                samples = np.frombuffer(raw, np.float64, -1, at + 16)
                if _isfinite(samples.dot(samples)):  # else one of them may not be
                    self.next_index += samples.size
                    return samples
        if not raw:
            return None
        return self._take_any(raw)

    def _take_any(self, raw: bytes) -> NDArray[np.float64] | None:
        """Look closely at a message, whatever it is."""
        try:
            index, period_s, samples = self._decode(raw)
        except MalformedBlockError as error:
            self._refuse(str(error))
            return None
        if index != self.next_index or period_s != self._period_s or self.ended:
            if not self._accept_other(index, period_s, samples.size):
                return None
        if samples.size:
            self.next_index += samples.size
            self._fast_period_s = period_s
            if len(raw) not in self._heads:
                self._remember_head(len(raw), samples.size)
        else:
            self.ended = True
            self._fast_period_s = math.nan
        return samples

    def _remember_head(self, length: int, samples: int) -> None:
        if samples > _LONGEST_KEPT:
            return  # its dot product would wake the threads of the linear algebra
        if len(self._heads) >= _KEPT_LENGTHS:
            self._heads.clear()
        head = self._codec.header(samples)[0]
        if len(head) + 8 * (samples + 2) == length:
            self._heads[length] = head

    def _decode(self, raw: bytes) -> ArrayBlock:
        try:
            return self._codec.decode_array(raw)
        except OtherEncodingError:
            # Some middleware writes another encoding; rclpy knows how to read it.
            message = deserialize_message(raw, Float64MultiArray)
            if len(message.layout.dim) != 1:
                raise MalformedBlockError(
                    f'layout.dim has {len(message.layout.dim)} entries, a block has exactly 1'
                ) from None
            dimension = message.layout.dim[0]
            return block_from_message_fields(
                dimension.label, dimension.size, dimension.stride, message.layout.data_offset,
                np.asarray(message.data))

    def fill(self) -> bool:
        """Move one block into the queue; return whether there was one."""
        sample = self.take_one()
        if sample is not None:
            self.queue.append(sample)
            return True
        samples = self.take_rest()
        if samples is None:
            return False
        self.queue.extend(samples)
        return True

    def fill_many(self, most: int) -> bool:
        """
        Move blocks into the queue; return whether there were any.

        Raises
        ------
        StreamFault
            If samples are missing or the sample period changes; not before the queue is empty.

        """
        if self._fault and not self.queue:
            raise self._fault
        blocks = 0
        try:
            while blocks < most and self.fill():
                blocks += 1
        except StreamFault as fault:
            if not self.queue:
                raise
            self._fault = fault
        return blocks > 0

    def take_from(self, index: int) -> bool:
        """
        Take a block, of which only the samples from an index on are of interest.

        They go into the queue, and older ones out of it. Returns whether there was a block.
        """
        samples = self.take_array()
        if samples is not None:
            wanted = self.next_index - index
            if wanted > 0:
                self.queue.extend(samples[max(0, samples.size - wanted):])
        self.drop_before(index)
        return samples is not None

    @property
    def queue_index(self) -> int:
        """Index of the first sample that waits in the queue, or of the next to come."""
        return self.next_index - len(self.queue)

    def drop_before(self, index: int) -> None:
        """Drop the samples of the queue whose index is smaller."""
        self.queue.drop(max(0, index - self.queue_index))

    def check_writer(self, timeout_s: float) -> bool:
        """
        Return whether the stream still has a writer, or has had one lately.

        Parameters
        ----------
        timeout_s : float
            How long it may have none, nothing arriving in the meantime.

        Raises
        ------
        StreamFault
            If it has several writers.

        """
        # Who has sent nothing but what was refused was no part of the run.
        if self.ended or (self.refused and not self.received):
            return True
        writers = self.subscription.get_publisher_count()
        if writers > 1:
            raise StreamFault(f'{self.subscription.topic_name} has {writers} writers')
        if writers == 1:
            self._lost = None
        elif self._lost is None or self._received_then != self.received:
            self._lost = RunningTime()
            self._received_then = self.received
        return self._lost is None or self._lost.elapsed_s() <= timeout_s

    def _accept_other(self, index: int, period_s: float, samples: int) -> bool:
        """Decide on a block that is not simply the next one."""
        topic = self.subscription.topic_name
        if not self.received and self._fence.is_rest(index, samples):
            return False
        first = self._any_start and not self.received
        if self.ended or (index < self.next_index and not first):
            self._refuse(
                f'sample {index} comes after '
                f'{"the end" if self.ended else f"sample {self.next_index - 1}"}')
            return False
        if self._period_s is None:
            self._period_s = period_s
        if period_s != self._period_s:
            raise StreamFault(
                f'{topic} has the sample period {period_s!r} s, expected {self._period_s!r} s')
        if first:
            self._first = self.next_index = index
            self._node.begin_at(index)
        if index != self.next_index:
            self.gaps += 1
            raise StreamFault(
                f'{topic} lacks the samples {self.next_index} … {index - 1}')
        return True

    def _refuse(self, reason: str) -> None:
        self.refused += 1
        now = time.monotonic()
        if now - self._warned > _WARN_S:
            self._warned = now
            self._node.get_logger().warning(
                f'refused a block on {self.subscription.topic_name} ({self.refused} so far): '
                f'{reason}')
