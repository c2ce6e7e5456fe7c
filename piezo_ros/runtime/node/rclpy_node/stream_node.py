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
A managed node that three threads serve: its streams, its transitions, and all the rest.

The stream loop serves the streams, `TransitionServer` the lifecycle, an executor everything else;
streams and lifecycle are hidden from it. What the other two want of a running node is done by the
stream loop between two samples.
"""

import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rclpy.exceptions import ParameterException
from rclpy.lifecycle import LifecycleNode
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.service import Service
from rclpy.subscription import Subscription
from std_srvs.srv import Trigger

from piezo_ros.runtime.node.rclpy_node.guard import explain, guard_services
from piezo_ros.runtime.node.rclpy_node.hidden_subscriptions import NodeWithHiddenSubscriptions
from piezo_ros.runtime.node.rclpy_node.thread_request import ServiceRefusedError, ThreadRequest
from piezo_ros.runtime.node.rclpy_node.transitions import TransitionServer
from piezo_ros.runtime.streams.qos import OVERRIDES, overridable

__all__ = ['ServiceRefusedError', 'StreamNode']

_EXECUTOR_S = 10.0  # it ends with the process, even if it is waited for


class StreamNode(NodeWithHiddenSubscriptions, LifecycleNode):
    """
    A managed node with streams that an executor does not see.

    Parameters
    ----------
    name : str
        Node name.
    **arguments
        What else `LifecycleNode` takes.

    """

    def __init__(self, name: str, **arguments: Any) -> None:
        self._own_subscriptions: list[Subscription] = []
        self.own_publishers: list[Publisher] = []
        self._hidden_services: list[Service] = []
        super().__init__(name, **arguments)
        self.transitions = TransitionServer(self)
        self._hidden_services.append(self.transitions.service)
        guard_services(self)
        self.wake: Callable[[], None] = lambda: None  # the stream loop, when nothing is running
        self._thread = threading.get_ident()
        self._requests: deque[ThreadRequest] = deque()

    # -- between the threads ----------------------------------------------------------------------

    @property
    def is_stream_loop(self) -> bool:
        """Whether this is called by the thread of the stream loop."""
        return threading.get_ident() == self._thread

    def between_samples(self, action: Callable[[], None], refusal: Callable[[], str] = str) -> None:
        """Let the stream loop run an action between two samples; wait for it unless refused."""
        if self.is_stream_loop:
            action()
            return
        request = ThreadRequest(action)
        self._requests.append(request)
        self.wake()
        request.wait_unless(refusal)

    def in_executor(self, action: Callable[[], None]) -> None:
        """Let the executor run an action between two callbacks, and wait for it."""
        if self.executor is None:
            action()
            return
        request = ThreadRequest(action)
        self.executor.create_task(request.serve)
        request.wait(_EXECUTOR_S)

    def serve_request(self) -> None:
        """Do what other threads want done between two samples, if anything."""
        while self._requests:
            self._requests.popleft().serve()

    # -- endpoints --------------------------------------------------------------------------------

    def create_own_publisher(
        self, message_type: Any, topic: str, qos: QoSProfile,
    ) -> Publisher:
        """Create a publisher beside the streams; it goes when the node is cleaned up."""
        publisher = self.create_stream_publisher(message_type, topic, qos)
        self.own_publishers.append(publisher)
        return publisher

    def create_stream_publisher(
        self, message_type: Any, topic: str, qos: QoSProfile,
    ) -> Publisher:
        """Create a publisher; raises ValueError where its QoS is overridden by nonsense."""
        with self._creating(topic):
            return self.create_publisher(
                message_type, topic, **overridable(qos))

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
        """
        Create a subscription that the stream loop takes from, hidden from the executor.

        Raises
        ------
        ValueError
            If its QoS is overridden by nonsense.

        """
        with self._creating(topic):
            return self.create_hidden_subscription(message_type, topic, qos)

    @contextmanager
    def _creating(self, topic: str) -> Iterator[None]:
        """Tell what rclpy has against an endpoint, with what was overridden."""
        try:
            yield
        except (ParameterException, RuntimeError, TypeError, ValueError) as error:
            name = f'qos_overrides.{self.resolve_topic_name(topic)}.'
            given = ', '.join(
                f'{key} = {parameter.value!r}'
                for key, parameter in self._parameter_overrides.items() if key.startswith(name))
            hint = f' ({given}; {OVERRIDES})' if given else ''
            raise ValueError(f'{topic} cannot be created: {explain(error)}{hint}') from None

    def destroy_own_endpoints(self) -> None:
        """Destroy what was created beside the streams."""
        for subscription in self._own_subscriptions:
            self.destroy_hidden_subscription(subscription)
        for publisher in self.own_publishers:
            self.destroy_publisher(publisher)
        self._own_subscriptions, self.own_publishers = [], []

    @property
    def services(self) -> Iterator[Service]:
        """The services that an executor shall serve: not the transitions."""
        for service in super().services:
            if service not in self._hidden_services:
                yield service

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
