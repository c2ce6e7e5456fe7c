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

"""What every supervisor of nodes has: a namespace, an ear for status, and the signals."""

import os
import signal
from pathlib import Path
from typing import Any, TypeVar

import rclpy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from piezo_ros.interruption import was_interrupted
from piezo_ros.runtime.process.leaving import destroy_after_others
from piezo_ros.runtime.process.middleware import set_middleware_defaults
from piezo_ros.runtime.streams.qos import EVERY_STATUS

__all__ = ['Supervisor', 'stopped_by']

_Self = TypeVar('_Self', bound='Supervisor')


class Supervisor:
    """
    A context in which nodes are supervised.

    Parameters
    ----------
    directory : Path
        Output directory.
    namespace : str
        Namespace of the nodes; of its own for every process by default.

    """

    def __init__(self, directory: Path, namespace: str) -> None:
        set_middleware_defaults()
        self._directory = directory
        self._namespace = '/' + (namespace or f'piezo_{os.getpid()}').strip('/')
        self._stop_signal = 0

    def __enter__(self: _Self) -> _Self:
        """Listen to the status of the nodes; take over SIGINT and SIGTERM."""
        self._old_handlers = {
            number: signal.signal(number, self._on_signal)
            for number in (signal.SIGINT, signal.SIGTERM)}
        if was_interrupted(self._old_handlers[signal.SIGINT]):
            self._stop_signal = signal.SIGINT
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node('supervisor', namespace=self._namespace)
        self._subscription = self._node.create_subscription(
            String, 'status', self._note, EVERY_STATUS)
        return self

    def __exit__(self, *_: object) -> None:
        """Give everything back."""
        destroy_after_others(self._node)
        rclpy.try_shutdown()
        for number, handler in self._old_handlers.items():
            signal.signal(number, handler)

    def _note(self, message: String) -> None:
        """Take a status, where the node is spun."""

    def _on_signal(self, number: int, _frame: Any) -> None:
        self._stop_signal = number


def stopped_by(number: int) -> str:
    """Return what to say of a run that a signal ended."""
    return f'stopped by {signal.Signals(number).name}'
