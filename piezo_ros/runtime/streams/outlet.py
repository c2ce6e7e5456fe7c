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

"""A publisher that drops nothing: it waits for a reader that does not take, and says so."""

import math
import time
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray

from piezo_ros.runtime.process.running_time import RunningTime
from piezo_ros.runtime.streams.fault import SendGivenUpError, StreamFault
from piezo_ros.runtime.streams.owner import StreamOwner
from piezo_ros.runtime.streams.qos import STREAM
from piezo_ros.runtime.streams.writer_names import node_of_endpoint

__all__ = ['Outlet']

_WARN_S = 2.0  # a warning of one kind at most this often
_PATIENCE_S = 1.0  # for a reader that is merely slow, as a recorder may be


class Outlet:
    """
    Publisher of serialized blocks.

    Parameters
    ----------
    node : StreamOwner
        The node that publishes.
    topic : str
        Relative name.

    Attributes
    ----------
    publisher : Publisher
        The publisher of rclpy.
    is_waiting : bool
        Whether a reader has not taken for so long that it was warned of.
    most_patience_s : float
        How long to wait for a reader at most, by the running time.

    """

    def __init__(self, node: StreamOwner, topic: str) -> None:
        self.publisher = node.create_stream_publisher(Float64MultiArray, topic, STREAM)
        self.is_waiting = False
        self.most_patience_s = math.inf
        self._node = node
        self._is_best_effort = (
            self.publisher.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT)
        # It takes a bytearray as well, whatever its types say.
        self.publish_raw: Any = self.publisher.handle.publish_raw

    def publish(self, raw: bytes | bytearray, index: int) -> None:
        """
        Publish a block.

        Parameters
        ----------
        raw : bytes or bytearray
            The block.
        index : int
            Index of its first sample, for messages.

        Raises
        ------
        SendGivenUpError
            If a reader does not take, and the node shall stop.
        StreamFault
            If a reader has not taken for too long.

        """
        try:
            self.publish_raw(raw)
        except _rclpy.RCLError:
            # A reader that does not take makes publishing fail after 0.1 s.
            self.publish_patiently(raw, index)

    def publish_patiently(self, raw: bytes | bytearray, index: int) -> None:
        """Wait for a reader, dropping nothing, unless the node shall stop; raises as `publish`."""
        warn_at = time.monotonic() + _PATIENCE_S
        waited = RunningTime()
        while True:
            if self._node.stop_requested:
                self.is_waiting = False
                raise SendGivenUpError(
                    f'{self.publisher.topic_name} was not sent from sample {index} on: a reader '
                    f'does not take its messages: {self._reader_names()}')
            if waited.elapsed_s() > self.most_patience_s:
                self.is_waiting = False
                raise StreamFault(
                    f'{self.publisher.topic_name} has waited at sample {index} for more than '
                    f'{self.most_patience_s:g} s (watchdog_s) for a reader that does not take its '
                    f'messages: {self._reader_names()}')
            now = time.monotonic()
            if now >= warn_at:
                warn_at = now + _WARN_S
                self.is_waiting = True
                self._node.get_logger().warning(
                    f'{self.publisher.topic_name} waits at sample {index} for a reader that does '
                    f'not take its messages: {self._reader_names()}')
            try:
                self.publish_raw(raw)
                break
            except _rclpy.RCLError:
                pass
        self.is_waiting = False

    def count_readers(self) -> int:
        """
        Return the number of matched readers that lose nothing.

        Best-effort readers are onlookers, as ``ros2 topic echo`` beside a loop is; they count only
        where the topic itself is overridden to be best effort.
        """
        matched = self.publisher.get_subscription_count()
        if self._is_best_effort or not matched:
            return matched
        # The volatile ones alone match: the stream keeps nothing for a reader that asks for more.
        onlookers = sum(
            endpoint.qos_profile.durability == DurabilityPolicy.VOLATILE
            for endpoint in self._readers(ReliabilityPolicy.BEST_EFFORT))
        return max(matched - onlookers, 0)

    def _reader_names(self) -> str:
        """Return the nodes that read; the middleware does not tell which one is behind."""
        names = sorted({
            node_of_endpoint(endpoint) for endpoint in self._readers(ReliabilityPolicy.RELIABLE)})
        return ' or '.join(names) or 'of unknown name'

    def _readers(self, reliability: ReliabilityPolicy) -> list[Any]:
        return [
            endpoint for endpoint
            in self._node.get_subscriptions_info_by_topic(self.publisher.topic_name)
            if endpoint.qos_profile.reliability == reliability]
