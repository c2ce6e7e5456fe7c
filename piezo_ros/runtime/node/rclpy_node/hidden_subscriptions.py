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

"""Subscriptions that a node takes messages from itself, hidden from its executor."""

from collections.abc import Iterator
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from piezo_ros.runtime.streams.qos import overridable

__all__ = ['NodeWithHiddenSubscriptions']


class NodeWithHiddenSubscriptions(Node):
    """
    A node with subscriptions that its executor does not serve.

    Parameters
    ----------
    name : str
        Node name.
    **arguments
        What else the next class takes, `Node` or `LifecycleNode`.

    """

    def __init__(self, name: str, **arguments: Any) -> None:
        self._hidden_subscriptions: set[Subscription] = set()
        super().__init__(name, **arguments)

    def create_hidden_subscription(
        self, message_type: Any, topic: str, qos: QoSProfile,
    ) -> Subscription:
        """Create a subscription to be taken from; parameters may override its QoS."""
        subscription = self.create_subscription(
            message_type, topic, callback=_never_called, **overridable(qos))
        self._hidden_subscriptions.add(subscription)
        return subscription

    def destroy_hidden_subscription(self, subscription: Subscription) -> None:
        """Destroy what `create_hidden_subscription` has returned."""
        self._hidden_subscriptions.discard(subscription)
        self.destroy_subscription(subscription)

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """The subscriptions that an executor shall serve: not the hidden ones."""
        for subscription in super().subscriptions:
            if subscription not in self._hidden_subscriptions:
                yield subscription


def _never_called(_message: Any) -> None:
    """Stand in for the callback that rclpy wants."""
