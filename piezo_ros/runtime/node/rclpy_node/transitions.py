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
The service by which a manager leads a node through its lifecycle, in a thread of its own.

An activation waits for peers, for seconds. In the executor it would keep every other service of the
process waiting with it: parameters, ``get_state``, ``~/stop``.
"""

import threading
from contextlib import suppress
from typing import Any, Final, cast

from lifecycle_msgs.srv import ChangeState
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.lifecycle import LifecycleNode
from rclpy.service import Service

from piezo_ros.runtime.node.rclpy_node.guard import guarded_service

__all__ = ['TransitionServer']

_NAME: Final = '/change_state'
_WAIT_NS: Final = 10**9


class TransitionServer:
    """
    Serves ``change_state`` of one node.

    Parameters
    ----------
    node : LifecycleNode
        The node, which keeps `service` from its executor.

    Attributes
    ----------
    service : Service
        What is served here.
    lock : threading.Lock
        Taken during a transition; code that leads the node through one takes it.

    """

    def __init__(self, node: LifecycleNode) -> None:
        self.service: Service = next(
            service for service in node.services if service.service_name.endswith(_NAME))
        self.lock = threading.Lock()
        self._node = node
        self._change_state = self.service.callback
        self._serve = guarded_service(node, self._make_transition)
        self._closing = threading.Event()
        self._context = cast(Any, node.context.handle)
        self._wake = _rclpy.GuardCondition(self._context)
        self._thread = threading.Thread(
            target=self._run, name='transitions', daemon=True)

    def start(self) -> None:
        """Begin to serve."""
        self._thread.start()

    def close(self) -> bool:
        """Serve no more; return whether the transition that was going on is over."""
        self._closing.set()
        self._wake.trigger_guard_condition()
        self._thread.join(0.01)
        return not self._thread.is_alive()

    def _run(self) -> None:
        waiting: Any = _rclpy.WaitSet(0, 1, 0, 0, 1, 0, self._context)
        while not self._closing.is_set():
            waiting.clear_entities()
            waiting.add_guard_condition(self._wake)
            waiting.add_service(self.service.handle)
            waiting.wait(_WAIT_NS)
            self._answer()

    def _make_transition(self, request: Any, response: Any) -> Any:
        try:
            return self._change_state(request, response)
        except _rclpy.RCLError:
            # Jazzy raises where a state does not have the transition; Kilted answers.
            self._node.get_logger().warning(
                f'transition {request.transition.label or request.transition.id} is none of the '
                'present state')
            return ChangeState.Response(success=False)

    def _answer(self) -> None:
        header: Any
        request, header = self.service.handle.service_take_request(ChangeState.Request)
        if request is None:
            return
        with self.lock:
            response = self._serve(request, ChangeState.Response())
        # The client may have left, and the node may be going.
        with suppress(_rclpy.RCLError, _rclpy.InvalidHandle):
            self.service.send_response(response, header)
