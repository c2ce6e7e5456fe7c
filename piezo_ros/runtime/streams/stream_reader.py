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
The reader of a block stream: checks the order of its messages and hands out their samples.

The messages are taken from the subscription directly, not through an executor; see
docs/architecture.md for what that gains.
"""

import math
import struct
import time
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rclpy.subscription import Subscription
from std_msgs.msg import Float64MultiArray

from piezo_ros.runtime.process.running_time import RunningTime
from piezo_ros.runtime.streams.fault import StreamFault
from piezo_ros.runtime.streams.message_decoder import MessageDecoder
from piezo_ros.runtime.streams.owner import StreamOwner
from piezo_ros.runtime.streams.qos import STREAM
from piezo_ros.runtime.streams.run_fence import RunFence
from piezo_ros.runtime.streams.sample_queue import SampleQueue
from piezo_ros.runtime.streams.writer_names import writers_beside, wrong_writers
from piezo_ros.streams import BlockCodec, MalformedBlockError

__all__ = ['NO_BYTES', 'StreamReader']

_isfinite = math.isfinite
_unpack_pair = struct.Struct('<2d').unpack_from
_WARN_S = 2.0  # a warning of one kind at most this often
# Stands for a message of no bytes, which is refused too: empty bytes say that there was none.
NO_BYTES: Final = b'\0'


class StreamReader:
    """
    Subscription of one stream: takes its blocks in order, counts those that it refuses.

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
    is_open : bool
        Whether a run has begun here that is not over; set to False where it could not begin after
        all, so that what has come for it is of the next one.
    sample_period_s : float or None
        The only sample period that is taken; None before a run has told it.
    ended : bool
        Whether the end marker of the run was taken.
    refused, gaps : int
        Number of refused messages and of gaps in this run.
    queue : SampleQueue
        Samples that were taken and wait to be used, see `fill`.
    raw : bytes
        The newest message, empty where there was none.
    held : deque of bytes
        Messages of this run that came before it began here; they are taken first.

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
        self.raw = b''
        self._node = node
        self._codec = BlockCodec(stream)
        self._single_head, numbers = self._codec.single
        self._single_size = len(self._single_head) + numbers.size
        self._unpack_single = struct.Struct(f'<{len(self._single_head)}s3d').unpack
        self._decoder = MessageDecoder(self._codec)
        self._heads = self._decoder.heads
        self._fence = RunFence(partial(_take_bytes, self.subscription), self._decoder.extent)
        self.held = self._fence.held
        self._take_message: Callable[[Any, bool], Any] = self.subscription.handle.take_message
        self.is_open = False
        self.sample_period_s: float | None = None
        self._fast_period_s = math.nan  # the period while the quick path may be taken, else NaN
        self._first = 0
        self._any_start = False
        self._warned = 0.0
        self._fault: StreamFault | None = None  # after what is in the queue
        self._lost: RunningTime | None = None  # time since the last look that found a writer
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
        self.is_open = True
        self._any_start = index < 0
        self.sample_period_s = sample_period_s
        self._fast_period_s = math.nan  # whatever comes first is looked at closely
        self._lost = None
        self._fault = None

    @property
    def received(self) -> int:
        """Number of samples of this run."""
        return self.next_index - self._first

    def discard_rest(self) -> None:
        """Throw away the messages of a run that was ended here before its end marker came."""
        self._interrupt()
        self._fence.discard_rest()

    def _interrupt(self) -> None:
        """Tell the fence where the present run stopped, unless its end marker was taken."""
        if self.is_open and not self.ended:
            self._fence.interrupt(self.next_index if self.received else None)
        self.is_open = False

    def _take_held(self, message_type: Any, is_raw: bool) -> Any:
        """Take the held messages in place of those of the subscription, until none is left."""
        if self.held:
            return self.held.popleft(), None
        self._take_message = self.subscription.handle.take_message
        return self._take_message(message_type, is_raw)

    def take_one(self) -> float | None:
        """
        Return the next sample if the next message is exactly that one (hot path).

        Everything else gives None and is left to `take_rest`: no message, several samples, the
        end, a message that is refused.

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
        elif not raw:
            self.raw = NO_BYTES
        return None

    def take_array(self) -> NDArray[np.float64] | None:
        """
        Return the samples of the next block, None if there is no block or it was refused.

        An empty array is the end of the stream.

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
        self.raw = b'' if taken is None else taken[0] or NO_BYTES
        return taken is not None

    def take_rest(self) -> NDArray[np.float64] | None:
        """Return what `take_array` returns, for the message that was taken before."""
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

    def take_blocks(self, most: int) -> tuple[list[NDArray[np.float64]], StreamFault | None]:
        """
        Return the samples of the message that was taken before and of those that wait behind it.

        Parameters
        ----------
        most : int
            The number of messages, at most.

        Returns
        -------
        blocks : list of ndarray of float64, shape (N,)
            What was taken, up to the end marker.
        fault : StreamFault or None
            What `take_rest` raised behind the blocks.

        """
        blocks: list[NDArray[np.float64]] = []
        try:
            for taken in range(1, most + 1):
                samples = self.take_rest()
                if samples is not None and samples.size:
                    blocks.append(samples)
                if taken == most or self.ended or not self.take_raw():
                    break
        except StreamFault as fault:
            return blocks, fault
        return blocks, None

    def _take_any(self, raw: bytes) -> NDArray[np.float64] | None:
        """Decode and check a message of any kind."""
        try:
            index, period_s, samples = self._decoder.decode(raw)
        except MalformedBlockError as error:
            self._refuse(str(error))
            return None
        if index != self.next_index or period_s != self.sample_period_s or self.ended:
            if not self._accept_other(index, period_s, samples.size):
                return None
        if samples.size:
            self.next_index += samples.size
            self._fast_period_s = period_s
            self._decoder.remember_head(len(raw), samples.size)
        else:
            self.ended = True
            self._fast_period_s = math.nan
        return samples

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
        Move blocks, `most` at most, into the queue; return whether there was anything.

        Raises
        ------
        StreamFault
            If samples are missing or the sample period changes; not before the queue is empty.

        """
        if self._fault and not self.queue:
            raise self._fault
        if not self.take_raw():
            return False
        blocks, fault = self.take_blocks(most)
        if blocks:
            self.queue.join(blocks)
        if fault and not self.queue:
            raise fault
        self._fault = fault or self._fault
        return bool(blocks) or self.ended

    def take_from(self, index: int) -> bool:
        """
        Take a block and queue its samples from an index on; drop older ones from the queue.

        Returns whether there was a block.
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
        """Index of the first sample in the queue; the next index if the queue is empty."""
        return self.next_index - len(self.queue)

    def drop_before(self, index: int) -> None:
        """Drop the samples below an index from the queue."""
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
        # A writer of refused messages only is no part of the run.
        if self.ended or (self.refused and not self.received):
            return True
        writers = self.subscription.get_publisher_count()
        if writers > 1:
            raise StreamFault(wrong_writers(self._node, self.subscription.topic_name, writers))
        if writers == 1:
            self._lost = None
        elif self._lost is None or self._received_then != self.received:
            self._lost = RunningTime()
            self._received_then = self.received
        return self._lost is None or self._lost.elapsed_s() <= timeout_s

    def _accept_other(self, index: int, period_s: float, samples: int) -> bool:
        """Return whether to take a block that does not simply follow; raises StreamFault."""
        topic = self.subscription.topic_name
        if not self.received and self._fence.is_rest(index, samples):
            return False
        first = self._any_start and not self.received
        if self.ended or (index < self.next_index and not first):
            self._refuse(
                f'sample {index} comes after '
                f'{"the end" if self.ended else f"sample {self.next_index - 1}"}')
            return False
        if self.sample_period_s is None:
            self.sample_period_s = period_s
        if period_s != self.sample_period_s:
            raise StreamFault(
                f'{topic} has the sample period {period_s!r} s, expected {self.sample_period_s!r} s'
                f'{writers_beside(self._node, self.subscription)}')
        if first:
            self._first = self.next_index = index
            self._node.begin_at(index)
        if index != self.next_index:
            self.gaps += 1
            raise StreamFault(
                f'{topic} lacks the samples {self.next_index} … {index - 1}'
                f'{writers_beside(self._node, self.subscription)}')
        return True

    def _refuse(self, reason: str) -> None:
        self.refused += 1
        now = time.monotonic()
        if now - self._warned > _WARN_S:
            self._warned = now
            self._node.get_logger().warning(
                f'refused a block on {self.subscription.topic_name} ({self.refused} so far): '
                f'{reason}{writers_beside(self._node, self.subscription)}')


def _take_bytes(subscription: Subscription) -> bytes | None:
    taken = subscription.handle.take_message(Float64MultiArray, True)
    return None if taken is None else taken[0]
