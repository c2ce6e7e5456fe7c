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
Supervision of node processes: their namespace, their status, their end, and the signals.

Every process is told the process that started it and ends with it, so that nothing is left behind
even when this process is killed.
"""

import math
import os
import signal
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import rclpy
import yaml
from std_msgs.msg import String

from piezo_ros.interruption import STOP_SIGNALS, was_interrupted
from piezo_ros.live.newest_samples import Observation, Observer
from piezo_ros.live.node_status import BadStatusError, parse_status
from piezo_ros.live.process_group import POLL_S, ProcessGroup
from piezo_ros.parameters.errors import CampaignError
from piezo_ros.parameters.role_parameters import full_name
from piezo_ros.report.files import write_atomically
from piezo_ros.runtime.process.leaving import destroy_after_others, exit_after
from piezo_ros.runtime.process.middleware import initialise_rclpy
from piezo_ros.runtime.process.ros_environment import (
    checked_namespace,
    keep_discovery_on_this_machine,
)
from piezo_ros.runtime.process.running_time import RunningTime
from piezo_ros.runtime.process.stop_request import StopRequest
from piezo_ros.runtime.streams.qos import EVERY_STATUS

__all__ = ['Supervisor', 'how_it_ended', 'stopped_by']

_LEAVE_S = 10.0  # how long the middleware may take to let this process go
_WARN_S = 10.0  # a warning of refused statuses at most this often


class Supervisor:
    """
    A context in which node processes are started, followed and ended.

    Parameters
    ----------
    namespace : str
        Namespace of the nodes, ``'/'`` for the root; by default one of its own for every process.

    Attributes
    ----------
    processes : ProcessGroup
        The processes of the present graph.
    bag_namespace : str
        Namespace that they have in bags and parameter files, '' for the same.
    statuses : dict of str to dict
        The newest status of every node of it, by name.
    exit_code : int
        With which this process ends if the middleware does not let it go.

    """

    def __init__(self, namespace: str = '') -> None:
        # The nodes of several commands must not meet; in a bag nothing tells which command it was.
        self.namespace = checked_namespace(namespace or f'piezo_{os.getpid()}')
        self.bag_namespace = '' if namespace else '/'
        self.processes = ProcessGroup()
        self.statuses: dict[str, dict[str, Any]] = {}
        self.exit_code = 1
        self._stop = StopRequest()
        self._beside: list[Supervisor] = []
        self._observer: Observer | None = None
        self._observation: Observation | None = None

    def __enter__(self) -> 'Supervisor':
        """Listen to the status of the nodes; take over the stop signals."""
        self._old_handlers = {number: signal.getsignal(number) for number in STOP_SIGNALS}
        self._stop.listen()
        for handler in self._old_handlers.values():
            if was_interrupted(handler):
                self._stop.signal_number = handler.signal_number
        keep_discovery_on_this_machine()
        initialise_rclpy()
        self._node = rclpy.create_node('supervisor', namespace=self.namespace)
        self._subscribe('status')
        return self

    def _subscribe(self, topic: str) -> None:
        self._subscription = self._node.create_subscription(
            String, topic, self._note, EVERY_STATUS)

    def below(self, name: str) -> 'Supervisor':
        """
        Return a supervisor for one more rig, in a namespace below this one.

        It needs no context of its own: it is stopped by the same signals and ends with this one.

        Parameters
        ----------
        name : str
            The last part of its namespace.

        """
        other = Supervisor(full_name(self.namespace, name))
        other.bag_namespace = self.bag_namespace and full_name(self.bag_namespace, name)
        other._stop = self._stop
        other._node = self._node
        other._subscribe(f'{name}/status')
        if self._observer:
            other._observe(self._observer, name)
        self._beside.append(other)
        return other

    def observe(self, observer: Observer) -> None:
        """Let an observer see the statuses and the newest samples, of rigs below as well."""
        self._observe(observer, '')

    def _observe(self, observer: Observer, rig: str) -> None:
        self._observer = observer
        self._observation = Observation(self._node, observer, rig)

    def forget_samples(self) -> None:
        """Drop the newest samples that were sent before now."""
        for supervisor in (self, *self._beside):
            if supervisor._observation:
                supervisor._observation.drop()

    def __exit__(self, *_: object) -> None:
        """End the processes and give everything back."""
        for supervisor in (self, *self._beside):
            supervisor.processes.stop()
            supervisor.processes.kill()
        stay = exit_after(_LEAVE_S, self.exit_code)
        destroy_after_others(self._node)
        rclpy.try_shutdown()
        stay()
        for number, handler in self._old_handlers.items():
            signal.signal(number, handler)

    @property
    def stop_signal(self) -> int:
        """The signal that has asked this process to end, 0 for none."""
        return self._stop.signal_number

    @property
    def arguments(self) -> list[str]:
        """The arguments that put a node executable into the namespace."""
        return ['--ros-args', '-r', f'__ns:={self.namespace}']

    def write_parameters(
        self, path: Path, sections: Mapping[str, Mapping[str, Any]],
    ) -> list[str]:
        """Write a parameter file, node by node; return the arguments for executables with it."""
        write_atomically(path, yaml.safe_dump({
            full_name('/**' if self.bag_namespace else self.namespace, node): {
                'ros__parameters': dict(values)}
            for node, values in sections.items()}))
        return [*self.arguments, '--params-file', str(path)]

    def begin_graph(self) -> None:
        """Forget the processes of the graph before, which are gone, and what they said."""
        self.processes = ProcessGroup()
        self.take_statuses()
        self.statuses.clear()

    def take_statuses(self) -> None:
        """Take in what the nodes have said since the last time, without waiting."""
        while (taken := self._subscription.handle.take_message(String, False)) is not None:
            self._note(taken[0])
        if self._observation:
            self._observation.take()

    def create_client(self, service_type: Any, name: str) -> Any:
        """Create the client of a service, named below the namespace."""
        return self._node.create_client(service_type, full_name(self.namespace, name))

    def spin_until(
        self, condition: Callable[[], bool], *, timeout_s: float = math.inf,
    ) -> bool:
        """
        Take in statuses and answers until a condition is met; return whether it is.

        Parameters
        ----------
        condition : callable
            The condition.
        timeout_s : float
            How long to wait for it.

        Raises
        ------
        CampaignError
            If this process was asked to end, or a process of the graph failed.

        """
        waited = RunningTime()
        while not condition():
            if waited.elapsed_s() >= timeout_s:
                return False
            if self.stop_signal:
                raise CampaignError(stopped_by(self.stop_signal))
            if self.processes.dead():
                name, code = next(iter(self.processes.blamed.items()))
                raise CampaignError(f'{name} {how_it_ended(code)}')
            self.spin_once(POLL_S)
        return True

    def spin_once(self, timeout_s: float) -> None:
        """Take in one status or answer, waiting for it at most so long."""
        rclpy.spin_once(self._node, timeout_sec=timeout_s)

    def _note(self, message: String) -> None:
        try:
            status = parse_status(message.data)
        except BadStatusError as error:
            self._node.get_logger().warning(
                f'refused a status: {error}', throttle_duration_sec=_WARN_S)
            return
        self.statuses[status['node']] = status
        if self._observation:
            self._observation.take_status(status)


def how_it_ended(code: int) -> str:
    """Return what to say of a process that is blamed, see `ProcessGroup`, for its exit code."""
    if code < 0:
        return f'was killed by {signal.Signals(-code).name}'
    return 'failed' if code else 'ended before its run (exit code 0)'


def stopped_by(number: int) -> str:
    """Return what to say of a run that a signal ended."""
    return f'stopped by {signal.Signals(number).name}'
