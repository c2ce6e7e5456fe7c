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
A node of the loop: its parts, and its lifecycle.

Its streams are served by the stream loop of the process (`piezo_ros.runtime.host`), everything else
by an executor in another thread, see `piezo_ros.runtime.node.rclpy_node.stream_node`.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.publisher import Publisher

from piezo_ros.parameters.node_parameters import LoopNodeParameters
from piezo_ros.runtime.node.handshake import await_peers
from piezo_ros.runtime.node.hooks import NodeHooks
from piezo_ros.runtime.node.loop_parameters import ParameterChanges
from piezo_ros.runtime.node.node_run import Run
from piezo_ros.runtime.node.observation import Diagnostics, Monitor
from piezo_ros.runtime.node.rclpy_node.stream_node import ServiceRefusedError
from piezo_ros.runtime.node.run_requests import RunRequests
from piezo_ros.runtime.node.status import Status

__all__ = ['LoopNode']


class LoopNode(NodeHooks):
    """
    A managed node with block streams.

    Parameters
    ----------
    role : str
        Role, one of `NODE_PARAMETERS`, and name of the node unless it is given another.
    compiled : bool
        What the parameter of that name is where the user does not set it.

    """

    def __init__(self, role: str, *, compiled: bool = False) -> None:
        super().__init__(role)
        self.was_given_up = False  # the newest activation came to nothing for that
        self.is_starting = False  # nothing is driven yet, and a signal need not wait
        self.is_shut_down = False
        self._changes = ParameterChanges(self, compiled=compiled, take=self._take_changes)
        self.starts_itself = bool(self.get_parameter('autostart').value)
        self.status = Status(self)
        self._monitor = Monitor(self)
        self._diagnostics = Diagnostics(self)
        self.run = Run(self, self.status, self._monitor)
        self.requests = RunRequests(self, self.run, self.status)
        self.create_trigger('reset', self.requests.reset)
        self.create_trigger('stop', self.requests.stop)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the parameters and create every endpoint."""
        try:
            self._changes.note_endpoints()
            self._read_parameters()
            self.create_streams()
            self.create_endpoints()
            self._monitor.create_endpoints()
        except Exception as error:  # rclpy would swallow it.
            self.in_executor(self._destroy_endpoints)
            if self.stop_requested:  # what an interrupted compiler raises says nothing
                return self._give_up('stopped while getting ready')
            return self._refuse('configure', error)
        self.is_configured = True
        self.run_state.reason = ''
        self.status.report('inactive')
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Wait for the peers, set all state to its initial value, start the run."""
        if self.run_state.has_failed:
            return self._refuse('activate', (
                f'a fault is latched until ~/reset is called: {self.run_state.fault}'))
        self.is_activating, self.was_given_up = True, False
        try:
            self._read_changes()
            missing = await_peers(self)
            if missing:
                return self._give_up(missing) if self.given_up else self._refuse(
                    'activate', missing)
            self._read_changes()
            self.between_samples(self._begin)
        except Exception as error:  # rclpy would swallow it.
            if self.stop_requested or self.given_up:
                return self._give_up('stopped while getting ready')
            return self._refuse('activate', error)
        finally:
            self.is_activating = self.given_up = False
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the run; nothing is taken any more."""
        self.requests.end_for_readers('deactivated', self.publishers_of_run)
        self._monitor.stop()
        self.status.report('inactive')
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Destroy every endpoint."""
        def leave() -> None:
            self.is_configured = False  # The stream loop touches no endpoint any more.

        self.requests.end('cleaned up')
        self.between_samples(leave)
        # Not while the executor looks at them.
        self.in_executor(self._destroy_endpoints)
        self.status.report('unconfigured')
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the run and begin anew, unconfigured."""
        return self.on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the run, and the process with it unless other nodes live there."""
        self.requests.end('shut down')
        self.status.report('finalized')
        self.is_shut_down = True
        return TransitionCallbackReturn.SUCCESS

    def _read_parameters(self) -> None:
        self.settings = self._changes.read()
        self._monitor.use_rate(self.settings.monitor_rate_hz)
        with self._interruptible():
            self.configure()

    def _read_changes(self) -> None:
        if self._changes.has_unread:
            self._changes.check_endpoints()  # They stay.
            self._read_parameters()

    def _take_changes(self, settings: LoopNodeParameters) -> None:
        self.settings = settings
        self.parameters_changed()
        self._monitor.use_rate(settings.monitor_rate_hz)

    def _begin(self) -> None:
        if self.given_up:
            raise ServiceRefusedError('the run is not wanted any more')
        with self.run.beginning(), self._interruptible():
            self.start()

    @contextmanager
    def _interruptible(self) -> Iterator[None]:
        """Let a signal end the process in here: code may be compiled for a minute."""
        self.is_starting = self.is_stream_loop  # Another thread is no hindrance.
        try:
            yield
        finally:
            self.is_starting = False

    def _refuse(self, transition: str, why: Exception | str) -> TransitionCallbackReturn:
        self.status.report_refusal(transition, why)
        return TransitionCallbackReturn.FAILURE

    def _give_up(self, why: str) -> TransitionCallbackReturn:
        """Say that no run was wanted after all."""
        self.was_given_up = True
        self.run_state.reason = why
        self.get_logger().info(why)
        self.status.report()
        return TransitionCallbackReturn.FAILURE

    def _destroy_endpoints(self) -> None:
        self.is_configured = False
        self._monitor.stop()
        self.destroy_streams()
        self.destroy_own_endpoints()

    def finish(self) -> None:
        """End the run well."""
        self.run.finish()

    def stop(self, reason: str, *, by_peer: bool = False) -> None:
        """End the run because it is to end, not for a fault; see `Run.stop`."""
        self.run.stop(reason, by_peer=by_peer)

    @property
    def publishers_of_run(self) -> list[Publisher]:
        """What publishes during a run: the streams, what is beside them, and the status."""
        streams = [each for writer in self.writers.values() for each in writer.publishers]
        return [*streams, *self.own_publishers, self.status.publisher]
