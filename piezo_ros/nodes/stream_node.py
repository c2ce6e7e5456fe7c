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
A managed node that two threads serve: a stream loop its streams, an executor all the rest.

The streams are hidden from the executor, and what its thread wants of a running node is done by the
stream loop between two samples.
"""

import threading
import traceback
from collections.abc import Callable, Iterator
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.lifecycle import LifecycleNode
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from std_srvs.srv import Trigger

from piezo_ros.nodes.qos import overridable

__all__ = ['ServiceRefusedError', 'StreamNode']


class ServiceRefusedError(Exception):
    """What a service was asked for does not go now; the text says why."""


class StreamNode(LifecycleNode):
    """
    A managed node whose streams an executor does not see.

    Parameters
    ----------
    name : str
        Node name.
    **arguments
        What else `LifecycleNode` takes.

    """

    def __init__(self, name: str, **arguments: Any) -> None:
        self._stream_subscriptions: set[Subscription] = set()
        self._own_subscriptions: list[Subscription] = []
        self._own_publishers: list[Publisher] = []
        super().__init__(name, **arguments)
        self.wake: Callable[[], None] = lambda: None  # the stream loop, when nothing is running
        self._thread = threading.get_ident()
        self._request: Callable[[], None] | None = None
        self._request_done = threading.Event()

    # -- between the two threads ------------------------------------------------------------------

    def between_samples(self, action: Callable[[], None]) -> None:
        """Let the stream loop run an action between two samples, and wait for it."""
        if threading.get_ident() == self._thread:
            action()
            return
        self._request_done.clear()
        self._request = action
        self.wake()
        self._request_done.wait()

    def serve_request(self) -> None:
        """Do what the executor wants done between two samples, if anything."""
        if self._request is None:
            return
        request, self._request = self._request, None
        try:
            request()
        finally:
            self._request_done.set()

    # -- endpoints --------------------------------------------------------------------------------

    def create_own_publisher(
        self, message_type: Any, topic: str, qos: QoSProfile,
        event_callbacks: 'PublisherEventCallbacks | None' = None,
    ) -> Publisher:
        """Create a publisher beside the streams; it goes when the node is cleaned up."""
        publisher = self.create_publisher(
            message_type, topic, event_callbacks=event_callbacks, **overridable(qos))
        self._own_publishers.append(publisher)
        return publisher

    def create_own_subscription(
        self, message_type: Any, topic: str, qos: QoSProfile,
    ) -> Subscription:
        """Create a subscription beside the streams; it goes when the node is cleaned up."""
        subscription = self.create_stream_subscription(message_type, topic, qos)
        self._own_subscriptions.append(subscription)
        return subscription

    def create_stream_subscription(
        self, message_type: Any, topic: str, qos: QoSProfile,
    ) -> Subscription:
        """Create a subscription that the stream loop takes from, hidden from the executor."""
        subscription = self.create_subscription(
            message_type, topic, callback=_never_called, **overridable(qos))
        self._stream_subscriptions.add(subscription)
        return subscription

    def destroy_stream_subscription(self, subscription: Subscription) -> None:
        """Destroy what `create_stream_subscription` has returned."""
        self._stream_subscriptions.discard(subscription)
        self.destroy_subscription(subscription)

    def destroy_own_endpoints(self) -> None:
        """Destroy what was created beside the streams."""
        for subscription in self._own_subscriptions:
            self.destroy_stream_subscription(subscription)
        for publisher in self._own_publishers:
            self.destroy_publisher(publisher)
        self._own_subscriptions, self._own_publishers = [], []

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """The subscriptions that an executor shall serve: not those of the streams."""
        for subscription in super().subscriptions:
            if subscription not in self._stream_subscriptions:
                yield subscription

    def create_trigger(self, name: str, action: Callable[[], str]) -> None:
        """
        Offer a service that takes no arguments.

        Parameters
        ----------
        name : str
            Name of the service below the node's own.
        action : callable
            Called in the executor; what it returns is told as it is, what it raises as a refusal.

        """
        def serve(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                response.message = action()
                response.success = True
            except Exception as error:
                response.message = str(error)
                if not isinstance(error, ServiceRefusedError):
                    self.get_logger().error(traceback.format_exc())
            return response

        self.create_service(Trigger, f'~/{name}', serve)


def _never_called(_message: Any) -> None:
    """Stand in for the callback that rclpy wants; the stream loop takes the messages itself."""
