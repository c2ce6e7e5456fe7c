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

"""What readers and writers of streams need of the node that they belong to."""

from typing import Any, Protocol

from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

__all__ = ['StreamOwner']


class StreamOwner(Protocol):
    """The node of some streams, as these see it."""

    stop_requested: bool  # a writer that waits for its reader gives up

    def create_stream_publisher(
        self, message_type: Any, topic: str, qos: QoSProfile,
    ) -> Publisher:
        """Create a publisher."""

    def create_stream_subscription(
        self, message_type: Any, topic: str, qos: QoSProfile,
    ) -> Subscription:
        """Create a subscription that no executor serves."""

    def begin_at(self, index: int) -> None:
        """Take note of the index that an input has begun at."""

    def get_logger(self) -> Any:
        """Return the logger of the node."""

    def get_publishers_info_by_topic(self, topic_name: str) -> list[Any]:
        """Return the endpoint of every writer of a topic, by its full name."""

    def get_subscriptions_info_by_topic(self, topic_name: str) -> list[Any]:
        """Return the endpoint of every reader of a topic, by its full name."""
