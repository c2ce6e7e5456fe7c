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
Copies of the outputs for a recorder: the same samples, collected into long blocks.

One more reader of a stream costs as much as the loop's own; a thousand samples at once cost it
hardly anything.
"""

import numpy as np

from piezo_ros.runtime.streams.fault import SendGivenUpError, StreamFault
from piezo_ros.runtime.streams.outlet import Outlet
from piezo_ros.runtime.streams.owner import StreamOwner
from piezo_ros.streams import BlockCodec

__all__ = ['StreamCopy', 'copy_topic']


def copy_topic(stream: str) -> str:
    """Return the topic of the copy of a stream."""
    return f'recorded/{stream}'


class StreamCopy:
    """
    Collects the samples of one output and publishes them in blocks.

    Whatever publishes raises as `Outlet.publish`.

    Parameters
    ----------
    node : StreamOwner
        The node with that output.
    stream : str
        The stream.
    samples : int
        Largest block that is collected.

    Attributes
    ----------
    recent : ndarray of float64, shape (samples,)
        The samples that are not sent yet, and older ones: sample k at ``k % samples``.
    due : int
        The index at which `flush` must be called at the latest.

    """

    def __init__(self, node: StreamOwner, stream: str, samples: int) -> None:
        self.outlet = Outlet(node, copy_topic(stream))
        self.recent = np.zeros(samples)
        self.due = samples
        self._codec = BlockCodec(stream)
        self._period_s = 0.0
        self._sent = 0
        self._is_cut = False  # a block was not sent, and is not among the recent samples either

    def start(self, index: int, sample_period_s: float) -> None:
        """Begin a run at an index."""
        self._period_s = sample_period_s
        self._is_cut = False
        self._advance(index)

    def flush(self, next_index: int) -> None:
        """Send what has been collected up to an index, at most `due`."""
        count = next_index - self._sent
        if count > 0 and not self._is_cut:
            at = self._sent % self.recent.size
            self._publish(self._codec.encode(
                self._sent, self._period_s, self.recent[at:at + count]))
            self._advance(next_index)

    def pass_on(self, raw: bytes | bytearray, index: int, count: int) -> None:
        """Send a block as it is, after what has been collected before its index."""
        try:
            self.flush(index)
            self._publish(raw)
        except (SendGivenUpError, StreamFault):
            self._is_cut = True
            raise
        self._advance(index + count)

    def end(self, next_index: int) -> None:
        """Send what has been collected up to an index, and the end behind what was sent."""
        try:
            self.flush(next_index)
        finally:
            self._publish(self._codec.encode(self._sent, self._period_s, []))

    def _publish(self, raw: bytes | bytearray) -> None:
        self.outlet.publish(raw, self._sent)

    def _advance(self, index: int) -> None:
        self._sent = index
        self.due = (index // self.recent.size + 1) * self.recent.size
