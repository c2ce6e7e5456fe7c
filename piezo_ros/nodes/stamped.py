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
An onlooker that offers the streams as stamped messages, for the tools of ROS that want a header.

It reads ``newest/<stream>``, which costs the loop no reader and no waiting; see docs/stamped.md.
"""

import time
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray

from piezo_ros.nodes.stamped_parts.stamped_messages import (
    Sample,
    joint_state_fields,
    newest_sample,
    time_of,
)
from piezo_ros.parameters.node_parameters import StampedParameters
from piezo_ros.runtime.node.declared_parameters import declare, read
from piezo_ros.runtime.node.observation import newest_topic
from piezo_ros.runtime.node.rclpy_node.guard import guard_services
from piezo_ros.runtime.node.rclpy_node.hidden_subscriptions import NodeWithHiddenSubscriptions
from piezo_ros.runtime.process.steady_timer import SteadyTimer
from piezo_ros.runtime.streams.qos import NEWEST, overridable
from piezo_ros.streams import MalformedBlockError

__all__ = ['Stamped']

_IDLE_HZ = 5.0  # at which it looks while nothing comes
_IDLE_S = 3.0  # after which that is so; the newest sample is repeated after one second
_LOOK_FOR_WRITERS_HZ = 0.2
_WARN_S = 10.0

# For readers of either reliability and durability; a late one has the last samples.
_STAMPED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=10, reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Stamped(NodeWithHiddenSubscriptions):
    """
    Publishes the newest sample of each stream on ``stamped/<stream>``.

    It never reads a stream itself: that slows the loop.

    Parameters
    ----------
    message_type : type
        ``sensor_msgs.msg.JointState``.

    """

    def __init__(self, message_type: Any) -> None:
        super().__init__('stamped')
        guard_services(self)
        declare(self, StampedParameters)
        settings = read(self, StampedParameters)
        self.settings = settings
        self.message_type = message_type
        self.is_simulated = settings.stamp == 'simulated' or (
            settings.stamp == 'auto' and bool(self.get_parameter('use_sim_time').value))
        self._twins = [_Twin(self, stream) for stream in settings.stream_names]
        self._heard_s = time.monotonic()
        self._looking = SteadyTimer(self, self._look, self._looking_hz)
        self._looking.update()
        self._search = SteadyTimer(self, self._look_for_writers, self._search_hz)
        self._search.update()
        self.get_logger().info(
            f'offers {", ".join(twin.publisher.topic_name for twin in self._twins)}; the stamps '
            f'are {"simulated time" if self.is_simulated else "of the clock on the wall"}')

    def _looking_hz(self) -> float:
        rate_hz = self.settings.rate_hz
        is_idle = time.monotonic() - self._heard_s >= _IDLE_S
        return min(rate_hz, _IDLE_HZ) if is_idle else rate_hz

    def _look(self) -> None:
        now_s = time.monotonic()
        for twin in self._twins:
            try:
                if twin.look():
                    self._heard_s = now_s
            except (MalformedBlockError, ValueError) as error:
                self.get_logger().warning(
                    f'refused a message on {twin.subscription.topic_name}: {error}',
                    throttle_duration_sec=_WARN_S)
        self._looking.update()

    def _search_hz(self) -> float:
        return 0.0 if all(twin.is_settled for twin in self._twins) else _LOOK_FOR_WRITERS_HZ

    def _look_for_writers(self) -> None:
        """Tell of streams that go by unseen; a stream that was seen once has its writer."""
        for twin in self._twins:
            if not twin.is_settled:
                twin.look_for_writer()
        self._search.update()


class _Twin:
    """
    One stream, and the stamped messages beside it.

    Parameters
    ----------
    node : Stamped
        The onlooker.
    stream : str
        The stream.

    """

    def __init__(self, node: Stamped, stream: str) -> None:
        self._node = node
        self._stream = stream
        self.subscription = node.create_hidden_subscription(
            Float64MultiArray, newest_topic(stream), NEWEST)
        self.publisher = node.create_publisher(
            node.message_type, f'stamped/{stream}', **overridable(_STAMPED))
        self.is_settled = False  # nothing has to be told of its writer
        self._shown: Sample | None = None

    def look(self) -> bool:
        """Publish the newest sample, unless it is shown already; return whether there was one."""
        taken = self.subscription.handle.take_message(Float64MultiArray, False)
        if taken is None:
            return False
        message, about = taken
        sample = newest_sample(self._stream, message)
        if sample is not None and sample != self._shown:
            self._publish(sample, about['source_timestamp'])
        return True

    def _publish(self, sample: Sample, sent_ns: int) -> None:
        self.is_settled = True
        self._shown = sample
        stamped = self._node.message_type(
            **joint_state_fields(self._stream, sample.value, self._node.settings.joint))
        stamp = stamped.header.stamp
        if self._node.is_simulated:
            stamp.sec, stamp.nanosec = time_of(sample)
        else:
            # A middleware that does not say when leaves it at zero.
            stamp.sec, stamp.nanosec = divmod(sent_ns or time.time_ns(), 10**9)
        stamped.header.frame_id = self._node.settings.frame_id
        self.publisher.publish(stamped)

    def look_for_writer(self) -> None:
        """Tell, once, if the stream has a writer that does not show what is newest."""
        topic = self._node.resolve_topic_name(self._stream)
        if self._node.count_publishers(topic) and not self.subscription.get_publisher_count():
            self.is_settled = True
            self._node.get_logger().warning(
                f'{topic} has a writer, but {self.subscription.topic_name} has none; a node of '
                'yours can publish its newest sample there, as a block of one')
