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
What all stages of the loop have in common: lifecycle, parameters, status, end and faults.

Its streams are served by the stream loop of the process (`piezo_ros.nodes.host`), everything else
by an executor in another thread, see `piezo_ros.nodes.stream_node`.
"""

import json
import os
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from std_msgs.msg import String

from piezo_ros.nodes.guard import explain, guarded
from piezo_ros.nodes.handshake import await_peers
from piezo_ros.nodes.observation import Diagnostics, Monitor
from piezo_ros.nodes.parameters import declare, names_by_change, plain, read
from piezo_ros.nodes.qos import LATCHED
from piezo_ros.nodes.running_time import RunningTime
from piezo_ros.nodes.stream_node import ServiceRefusedError, StreamNode
from piezo_ros.nodes.streams import StreamFault, StreamReader, StreamWriter
from piezo_ros.parameters.node_parameters import NODE_PARAMETERS, StageParameters, parameter_names
from piezo_ros.parameters.role_parameters import parameter_files, role_parameters

__all__ = ['Stage']

_CHECK_PEERS_S = 0.25
_REPORT_S = 1.0
_ACKNOWLEDGE = Duration(seconds=0.1)
_FAREWELL_S = 2.0  # how long the readers of an interrupted run have for its end


class Stage(StreamNode):
    """
    A managed node with block streams.

    Parameters
    ----------
    name : str
        Role, one of `NODE_PARAMETERS`, and name of the node unless it is given another.
    compiled : bool
        What the parameter of that name is where the user does not set it.

    """

    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    # Whether others wait for its next message, so that it shall look for its input all the time.
    urgent = True
    # Whether a stage that is not urgent had better let its input pile up.
    in_bursts = False
    # Whether it subscribes only once it knows the writers. A writer that waits for its readers
    # then does not begin before they can hear: in a loop each node waits for the next one, but none
    # for a recorder.
    subscribes_late = False
    # The diagnostics warn where these counts grow.
    troubles: tuple[str, ...] = ('refused_messages', 'gaps')

    def __init__(self, name: str, *, compiled: bool = False) -> None:
        super().__init__(name)
        self.role = name
        when = names_by_change(*NODE_PARAMETERS[name])
        self._fixed = frozenset[str]().union(*when.values()) - when['running']  # during a run
        self._shaping = when['configuration']
        self._configured_with: dict[str, Any] = {}  # what the endpoints are made of
        self.is_configured = False
        self._reread = False  # parameters have changed since they were read
        declare(
            self, *NODE_PARAMETERS[name], accept=self._accept_changes,
            defaults={**({'compiled': True} if compiled else {}), **self._of_role()})
        self.add_post_set_parameters_callback(guarded(self, self._after_changes))
        self.starts_itself = bool(self.get_parameter('autostart').value)
        self.running = False
        self.in_blocks = False  # several samples come in and go out at a time
        self.failed = False  # a fault is latched
        self.fault = ''  # what it was
        self.activating = False  # an activation is under way
        self.given_up = False  # it is no longer wanted
        self.was_given_up = False  # the newest activation came to nothing for that
        self.starting = False  # nothing is driven yet, and a signal need not wait
        self.over = False  # a run has ended, well or not
        self.shut_down = False
        self.stop_requested = False
        self.run_number = 0
        self.activity = 'unconfigured'
        self.result = ''  # how the newest run ended
        self.reason = ''
        self.by_peer = False  # the newest run ended because that of a peer had
        # What the stream loop calls: `look`, or a quicker way that does the same.
        self.quick: Callable[[int], bool] = self.look
        self.readers: dict[str, StreamReader] = {}
        self.writers: dict[str, StreamWriter] = {}
        self._status = self.create_publisher(String, 'status', LATCHED)
        self._next_check = 0.0
        self._next_report = 0.0
        self._monitor = Monitor(self)
        self._diagnostics = Diagnostics(self)
        self.create_trigger('reset', self.reset)
        self.create_trigger('stop', self._stop_by_service)

    def _of_role(self) -> dict[str, Any]:
        """Return what parameter files say of the role, where ROS finds only the other name."""
        if self.get_name() == self.role:
            return {}
        values = role_parameters(self.role, self.get_namespace(), parameter_files(sys.argv))
        names = parameter_names(self.role)
        return {name: value for name, value in values.items() if name in names}

    # -- what a stage defines ---------------------------------------------------------------------

    def configure(self) -> None:
        """Make constants of the parameters."""

    def start(self) -> None:
        """Set all state to its initial value; the peers are there."""

    def poll(self) -> bool:
        """Do what can be done now; return whether there was anything."""
        raise NotImplementedError

    def look(self, times: int) -> bool:
        """Poll until there is something, but only so often, yielding in between; return as that."""
        while not self.poll():
            times -= 1
            if times <= 0 or self.stop_requested or not self.running:
                return False
            os.sched_yield()
        return True

    def quiesce(self) -> None:
        """Bring whatever the stage drives to rest; called once at the end of a run."""

    def watch(self, now_s: float) -> None:
        """Look after time limits; called a few times a second while running."""

    def status_fields(self) -> dict[str, Any]:
        """Return what the stage adds to its status."""
        return {}

    def counts(self) -> dict[str, int]:
        """Return what the diagnostics tell of the run: samples, and what went wrong how often."""
        readers = self.readers.values()
        return {
            'samples': max(
                (end.sent for end in self.writers.values()),
                default=max((end.received for end in readers), default=0)),
            'refused_messages': sum(reader.refused for reader in readers),
            'gaps': sum(reader.gaps for reader in readers),
            'lag_samples': max((len(reader.queue) for reader in readers), default=0),
        }

    def change_parameters(self, changes: Mapping[str, Any]) -> str:
        """Take changes that the sets allow, in the executor; return why not, '' if so."""
        return ''

    def parameters_changed(self) -> None:
        """Take over what may change at once; the new values are there."""

    def input_topic(self, stream: str) -> str:
        """Return the topic of an input."""
        return stream

    def required_inputs(self) -> tuple[str, ...]:
        """Return the inputs that must have a writer before the run starts."""
        return self.inputs

    def missing_peers(self) -> str:
        """Return what else is missing before the run can start, '' for nothing."""
        return ''

    # -- lifecycle --------------------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the parameters and create every endpoint."""
        try:
            self._read_parameters()
            self._configured_with = self._parameters_of_endpoints()
            if not self.subscribes_late:
                self.create_readers()
            self.writers = {
                stream: StreamWriter(self, stream, self.settings.recorded_block_samples)
                for stream in self.outputs}
            self.create_endpoints()
            self._monitor.create_endpoints()
        except Exception as error:  # rclpy would swallow it.
            self.in_executor(self._destroy_endpoints)
            if self.stop_requested:  # what an interrupted compiler raises says nothing
                return self._give_up('stopped while getting ready')
            return self._refuse('configure', error)
        self.is_configured = True
        self.reason = ''
        self._report('inactive')
        return TransitionCallbackReturn.SUCCESS

    def _read_parameters(self) -> None:
        self._reread = False
        self.settings = read(self, StageParameters)
        self._monitor.use_rate(self.settings.monitor_rate_hz)
        with self._interruptible():
            self.configure()

    @contextmanager
    def _interruptible(self) -> Iterator[None]:
        """Let a signal end the process in here: code may be compiled for a minute."""
        self.starting = self.is_stream_loop  # Another thread is no hindrance.
        try:
            yield
        finally:
            self.starting = False

    def _refuse(self, transition: str, why: Exception | str) -> TransitionCallbackReturn:
        """Say why a transition fails, in log and status; a latched fault stays the reason there."""
        self.reason = self.fault or str(why)
        self.get_logger().error(f'cannot {transition}: {why}')
        if isinstance(why, Exception) and not isinstance(why, (ValueError, OSError)):
            self.get_logger().error(''.join(traceback.format_exception(why)))
        self._report(self.activity)
        return TransitionCallbackReturn.FAILURE

    def create_readers(self) -> None:
        """Subscribe to the inputs."""
        self.readers = {
            stream: StreamReader(self, stream, self.input_topic(stream)) for stream in self.inputs}

    def create_endpoints(self) -> None:
        """Create what the stage has beside its streams."""

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Wait for the peers, set all state to its initial value, start the run."""
        if self.failed:
            return self._refuse('activate', (
                f'a fault is latched until ~/reset is called: {self.fault}'))
        self.activating, self.was_given_up = True, False
        try:
            self._take_changed_parameters()
            missing = await_peers(self)
            if missing:
                return self._give_up(missing) if self.given_up else self._refuse(
                    'activate', missing)
            self.between_samples(self._begin)
        except Exception as error:  # rclpy would swallow it.
            if self.stop_requested:
                return self._give_up('stopped while getting ready')
            return self._refuse('activate', error)
        finally:
            self.activating = self.given_up = False
        return TransitionCallbackReturn.SUCCESS

    def _begin(self) -> None:
        start_index, period_s = self.settings.start_index, self.settings.sample_period_s
        for reader in self.readers.values():
            reader.start(start_index, period_s)
        for writer in self.writers.values():
            writer.start(max(start_index, 0), period_s)
        self.over, self.reason, self.result, self.by_peer = False, '', '', False
        self.run_number += 1
        self.quick = self.look
        with self._interruptible():
            self.start()
        self._monitor.start()
        self.running = True
        self._report('active')
        self.get_logger().info(f'run {self.run_number} begins')

    def _give_up(self, why: str) -> TransitionCallbackReturn:
        """Say that no run was wanted after all."""
        self.was_given_up = True
        self.reason = why
        self.get_logger().info(why)
        self._report(self.activity)
        return TransitionCallbackReturn.FAILURE

    def _take_changed_parameters(self) -> None:
        """Configure again where parameters have changed since; the endpoints stay."""
        if not self._reread:
            return
        changed = [
            f'{name} is {value!r} and was {self._configured_with[name]!r}'
            for name, value in self._parameters_of_endpoints().items()
            if value != self._configured_with[name]]
        if changed:
            raise ValueError(
                f'{", ".join(changed)}: clean up and configure the node, for its topics change')
        self._read_parameters()

    def _parameters_of_endpoints(self) -> dict[str, Any]:
        return {
            name: plain(self.get_parameter(name).value)
            for name in sorted(self._shaping)}

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the run; nothing is taken any more."""
        self.between_samples(lambda: self.stop('deactivated'))
        # A reader that begins a run after this finds the end of this one among what has come.
        waited = RunningTime()
        self.await_acknowledgements(lambda: waited.elapsed_s() < _FAREWELL_S)
        self._monitor.stop()
        self._report('inactive')
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Destroy every endpoint."""
        def leave() -> None:
            self.stop('cleaned up')
            self.is_configured = False  # The stream loop touches no endpoint any more.

        self.between_samples(leave)
        # Not while the executor looks at them.
        self.in_executor(self._destroy_endpoints)
        self._report('unconfigured')
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the run and begin anew, unconfigured."""
        return self.on_cleanup(state)

    def _destroy_endpoints(self) -> None:
        self.is_configured = False
        self._monitor.stop()
        for reader in self.readers.values():
            self.destroy_stream_subscription(reader.subscription)
        for writer in self.writers.values():
            for publisher in writer.publishers:
                self.destroy_publisher(publisher)
        self.readers, self.writers = {}, {}
        self.destroy_own_endpoints()

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the run, and the process with it unless other stages live there."""
        self.between_samples(lambda: self.stop('shut down'))
        self._report('finalized')
        self.shut_down = True
        return TransitionCallbackReturn.SUCCESS

    # -- services and parameters ------------------------------------------------------------------

    def reset(self) -> str:
        """Clear a latched fault, so that the next activation is allowed."""
        if self.running:
            raise ServiceRefusedError('a run is going on; call ~/stop or deactivate first')
        was = f'cleared: {self.fault}' if self.failed else 'there was no fault'
        self.failed, self.fault, self.reason = False, '', ''
        self._report(self.activity)
        return was

    def give_up_activation(self) -> None:
        """Wait for the peers no longer."""
        self.given_up = True

    def _stop_by_service(self) -> str:
        if self.activating and not self.running:
            self.give_up_activation()
            return 'the activation is given up'
        if not self.running:
            raise ServiceRefusedError('no run is going on')
        # First, so that a writer that waits for its reader gives up.
        self.stop_requested = True
        self.between_samples(lambda: self.stop('asked to by ~/stop'))
        return f'{self.result}: {self.reason}' if self.reason else self.result

    def _accept_changes(self, changes: Mapping[str, Any]) -> str:
        """Return why changes that the sets allow are refused, '' where they are not."""
        if self.running or self.activating:
            for name, value in changes.items():
                if name in self._fixed and (
                    plain(value) != plain(self.get_parameter(name).value)
                ):
                    return (
                        f'{name} takes effect at an activation and cannot change during a run; '
                        'deactivate first')
        return self.change_parameters(changes)

    def _after_changes(self, changes: list[Parameter]) -> None:
        if not self.is_configured:
            return
        self._reread = True
        self.settings = read(self, StageParameters)
        self.parameters_changed()
        self._monitor.use_rate(self.settings.monitor_rate_hz)

    # -- stream loop ------------------------------------------------------------------------------

    def break_off(self, error: Exception) -> None:
        """End the run for whatever `poll` has raised."""
        if isinstance(error, StreamFault):
            self.fail(str(error))
        else:
            self.get_logger().error(''.join(traceback.format_exception(error)))
            self.fail(f'{type(error).__name__}: {error}')

    def housekeeping(self, now_s: float) -> None:
        """Look after peers, time limits and status; called a few times a second."""
        if not self.running:
            if self.over and self.is_configured:
                for reader in self.readers.values():
                    reader.discard_rest()
            return
        for writer in self.writers.values():
            writer.flush()
        try:
            self.watch(now_s)
            if now_s >= self._next_check:
                self._next_check = now_s + _CHECK_PEERS_S
                self._check_writers()
        except StreamFault as fault:
            self.fail(str(fault))
            return
        if now_s >= self._next_report:
            self._report('active')

    def _check_writers(self) -> None:
        timeout_s = self.settings.lost_writer_timeout_s
        required = self.required_inputs()
        for stream, reader in self.readers.items():
            if stream in required and not reader.check_writer(timeout_s):
                if not self.has_waiting(reader):
                    raise StreamFault(
                        f'{reader.subscription.topic_name} lost its writer after sample '
                        f'{reader.next_index - 1}')

    def has_waiting(self, reader: StreamReader) -> bool:
        """Return whether samples of an input wait, so that its writer may be gone by now."""
        return False

    def begin_at(self, index: int) -> None:
        """Give the outputs the index that an input has begun at (``start_index`` -1)."""
        for writer in self.writers.values():
            writer.begin_at(index)

    def finish(self) -> None:
        """End the run well: pass the end on, come to rest, report."""
        self._close('finished', '')

    def fail(self, reason: str) -> None:
        """End the run for a fault: pass the end on, come to rest, report why."""
        if self.running:
            self.failed, self.fault = True, reason
            self.get_logger().error(f'run ended: {reason}')
            self._close('faulted', reason)

    def note_fault(self, reason: str) -> None:
        """Take note of what went wrong at the end of a run; the first such reason stays."""
        self.failed, self.fault = True, self.fault or reason
        self.get_logger().error(reason)

    def _tell_end(self) -> None:
        if not self.failed:
            why = f' ({self.reason})' if self.reason else ''
            self.get_logger().info(
                f'run {self.run_number} {self.result}{why}: {self.counts()["samples"]} samples')

    def stop(self, reason: str, *, by_peer: bool = False) -> None:
        """
        End the run because it is to end, not for a fault.

        Parameters
        ----------
        reason : str
            What wants it to end.
        by_peer : bool, optional
            Whether a peer has ended its own run, well or not: it says why.

        """
        self.stop_requested = True
        if self.running:
            self.by_peer = by_peer
            self._close('stopped', reason)
        self.stop_requested = False

    def _close(self, state: str, reason: str) -> None:
        self.running = False
        self.over = True
        self.reason = reason
        self.result = state
        for writer in self.writers.values():
            writer.end()
        try:
            self.quiesce()
        except Exception as error:  # The report of how it ended must go out all the same.
            self.note_fault(explain(error))
            self.get_logger().error(traceback.format_exc())
        self.reason = self.reason or self.fault
        self._monitor.rest()
        self._tell_end()
        self._report(state)

    def await_acknowledgements(self, has_time: Callable[[], bool]) -> None:
        """
        Wait until every reader has what was published.

        Parameters
        ----------
        has_time : callable
            Whether to go on waiting for a reader, which may be dead; asked ten times a second.

        """
        writers = self.writers.values()
        for publisher in [
            *(publisher for writer in writers for publisher in writer.publishers),
            *self.own_publishers, self._status,
        ]:
            # Once at least: a reader that has everything already is not waited for.
            while not publisher.wait_for_all_acked(_ACKNOWLEDGE) and has_time():
                pass

    def await_supervisor(self, has_time: Callable[[], bool]) -> None:
        """Wait until a reader of the status has been discovered."""
        while not self._status.get_subscription_count() and has_time():
            time.sleep(0.01)

    # -- status -----------------------------------------------------------------------------------

    def _report(self, activity: str) -> None:
        self.activity = activity
        self._next_report = time.monotonic() + _REPORT_S
        index = max((writer.sent for writer in self.writers.values()), default=0)
        fields = {
            'node': self.get_name(),
            'role': self.role,
            'state': activity,
            'run': self.run_number,
            'index': index,
            'total': None,
            'progress': None,
            'result': self.result,
            'by_peer': self.by_peer,
            'refused': sum(reader.refused for reader in self.readers.values()),
            'reason': self.reason,
            'voltage_v': None,
            **self.status_fields(),
        }
        if fields['total']:
            fields['progress'] = fields['index'] / fields['total']
        self._status.publish(String(data=json.dumps(fields)))
