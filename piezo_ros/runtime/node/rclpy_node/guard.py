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
Callbacks of a node that never raise.

An exception that leaves a callback ends the thread of the executor, or the whole process, and with
it every service: whatever is called from there goes through here.
"""

import time
import traceback
from collections.abc import Callable
from typing import Any

from rclpy.node import Node

__all__ = ['explain', 'guard_services', 'guarded', 'guarded_service', 'spin_guarded']

_THROTTLE_S = 10.0
_SPIN_S = 0.5  # between two looks whether the process ends
_PAUSE_S = 0.05


def explain(error: BaseException) -> str:
    """Return an exception in one line."""
    text = str(error).strip().partition('\n')[0]
    return f'{type(error).__name__}: {text}' if text else type(error).__name__


def guarded(node: Node, callback: Callable[..., Any]) -> Callable[..., None]:
    """Return a callback that logs what goes wrong in another one."""
    def call(*arguments: Any) -> None:
        try:
            callback(*arguments)
        except Exception:
            _log(node)

    return call


def guarded_service(
    node: Node, callback: Callable[[Any, Any], Any],
) -> Callable[[Any, Any], Any]:
    """Return a service that answers with a refusal where another one raises."""
    def serve(request: Any, response: Any) -> Any:
        try:
            return callback(request, response)
        except Exception as error:
            _log(node)
            return _refusal(request, type(response)(), explain(error))

    serve.guarded = True  # type: ignore[attr-defined]
    return serve


def guard_services(node: Node) -> None:
    """Guard the services that rclpy itself has made for a node: parameters and lifecycle."""
    for service in node.services:
        if not hasattr(service.callback, 'guarded'):
            service.callback = guarded_service(node, service.callback)


def spin_guarded(executor: Any, node: Node, is_over: Callable[[], bool]) -> None:
    """Serve an executor until that is over: whatever rclpy raises, the services go on."""
    while not is_over():
        try:
            executor.spin_once(_SPIN_S)
        except Exception:
            _log(node)
            time.sleep(_PAUSE_S)


def _log(node: Node) -> None:
    node.get_logger().error(traceback.format_exc(), throttle_duration_sec=_THROTTLE_S)


def _refusal(request: Any, response: Any, reason: str) -> Any:
    """Fill in an empty response so that it says no, as far as its type can."""
    if hasattr(response, 'success'):
        response.success = False
    if hasattr(response, 'message'):
        response.message = reason
    if hasattr(response, 'result') and hasattr(response.result, 'successful'):
        response.result.successful = False
        response.result.reason = reason
    if hasattr(response, 'results') and hasattr(request, 'parameters'):
        from rcl_interfaces.msg import SetParametersResult
        response.results = [
            SetParametersResult(successful=False, reason=reason) for _ in request.parameters]
    return response
