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

"""The controller: reference, feedforward and displacement in, linearised command out."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from piezo_ros.control.changes import CHANGEABLE, ChangeParameters, parse_changes
from piezo_ros.control.controller import (
    AUTO,
    ControllerParameters,
    controller_constants,
    controller_step,
    initial_state,
    prepare_transfer,
    recall_measurement,
)
from piezo_ros.control.stepping import PackedController
from piezo_ros.model.parameters import ParameterError
from piezo_ros.nodes.bursts import BURST_BLOCKS, BlockBuffer, publish_blocks
from piezo_ros.nodes.demand import DemandWriter
from piezo_ros.nodes.law_schedule import NEVER, LawSchedule
from piezo_ros.nodes.parameters import read
from piezo_ros.nodes.stage import Stage
from piezo_ros.nodes.streams import StreamFault, StreamReader
from piezo_ros.parameters.node_parameters import DemandParameters

if TYPE_CHECKING:
    from piezo_ros.nodes.relay import Relay

__all__ = ['Controller']

_WORTH_LENDING = 4  # samples; the relay for fewer costs more than it saves


class Controller(Stage):
    """
    Sends v[k] once y_d[k], u_ff[k] and, with feedback, y[k] are there.

    Without feedback it follows the blocks of the trajectory; the displacement then only paces the
    demand. Changes of gains and scheme are made between two samples, see
    `piezo_ros.nodes.law_schedule`.
    """

    inputs = ('reference', 'feedforward', 'displacement')
    outputs = ('command',)

    def __init__(self, *, compiled: bool = False) -> None:
        self._chosen_scheme = ''
        self._schedule = LawSchedule(ControllerParameters(), ())
        self._first = 0
        super().__init__('controller', compiled=compiled)

    def configure(self) -> None:
        """Make the constants of the control law; decide what the scheme auto stands for."""
        self._law = read(self, ControllerParameters)
        if self._law.scheme == AUTO:
            self._choose_scheme()
        self._flow = read(self, DemandParameters)
        changes = read(self, ChangeParameters)
        if changes.apply_at_sample >= 0:
            raise ParameterError(
                f'apply_at_sample is {changes.apply_at_sample}; it belongs to a change during a '
                'run, what is known before goes into changes')
        self._listed_changes = parse_changes(changes.changes)
        self._schedule = LawSchedule(self._law, self._listed_changes)
        self._schedule.laws()  # refuses what does not go together

    def _choose_scheme(self) -> None:
        """Take the scheme that auto stands for, as the parameter, so that bags tell of it too."""
        law = self._law
        self._chosen_scheme = law.concrete_scheme
        self._law = law.replaced(scheme=self._chosen_scheme)
        self.set_parameters([Parameter('scheme', value=self._chosen_scheme)])
        self.get_logger().info(
            f'scheme auto is {self._chosen_scheme}: the scan has {law.scan_frequency_hz:g} Hz, '
            f'feedback is acceptable below {law.feedback_acceptable_below_hz:g} Hz')

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget what auto stood for, unless somebody has set another scheme."""
        if self._chosen_scheme == self.get_parameter('scheme').value:
            self.set_parameters([Parameter('scheme', value=AUTO)])
        self._chosen_scheme = ''
        return super().on_cleanup(state)

    def status_fields(self) -> dict[str, Any]:
        """Return the scheme that is in use, and the sample from which it and the gains hold."""
        changed_at = self._schedule.changed_at
        return {
            'scheme': self._schedule.law.scheme,
            'changed_at': None if changed_at is None else changed_at + self._first}

    def create_endpoints(self) -> None:
        """Create the publisher of the demand."""
        self._demand = DemandWriter(self)

    def required_inputs(self) -> tuple[str, ...]:
        """Return what the scheme, or one that is to come, needs; every one needs displacement."""
        if any(law.uses_feedforward for law in self._schedule.laws()):
            return self.inputs
        return ('reference', 'displacement')

    def start(self) -> None:
        """Forget everything and ask for the first samples."""
        self._schedule = LawSchedule(self._law, self._listed_changes)
        self._packed = PackedController(self._law) if self.settings.compiled else None
        self._memory = self._packed.state if self._packed else initial_state(self._law)
        self._lent_at: int | None = None  # index from which on the relay has the targets
        self._reference = self.readers['reference']
        self._feedforward = self.readers['feedforward']
        self._displacement = self.readers['displacement']
        self._command = self.writers['command']
        self._first = max(self.settings.start_index, 0)
        self._commands_ended = False
        self._targets = BlockBuffer(self._reference), BlockBuffer(self._feedforward)
        # What must be done before the next sample can be; None for nothing.
        self._prepare: Callable[[], bool] | None = None
        if self.settings.start_index < 0:
            self._prepare = self._join
        self._use_law()
        self._relay = self._make_relay() if self._packed else None
        self._demand.start(0, self._flow.lookahead_samples)

    @property
    def _index(self) -> int:
        """Number of the next sample, from the first one of the run on."""
        return self._command.next_index - self._first

    def _make_relay(self) -> 'Relay':
        from piezo_ros.bag.relay_kernels import relay_controller
        from piezo_ros.nodes.relay import Relay
        relay = Relay(self, self._displacement, self._command, relay_controller, self._poll_other)
        self._bind(relay, np.empty(0), np.empty(0))  # loaded before the first sample
        return relay

    def _bind(
        self, relay: 'Relay', reference_um: NDArray[np.float64],
        feedforward_um: NDArray[np.float64],
    ) -> None:
        assert self._packed is not None
        relay.bind(
            self._packed.packed, self._first, self._command.next_index, reference_um,
            feedforward_um)

    def _lend(self, relay: 'Relay') -> None:
        """Let the relay go on as far as there are targets; what it has used is dropped later."""
        count = min(len(self._reference.queue), (self._flow.lookahead_samples + 1) // 2)
        if self._feeds_forward:
            count = min(count, len(self._feedforward.queue))
        if self._schedule.change_at >= self._index:
            count = min(count, self._schedule.change_at - self._index)
        if count < _WORTH_LENDING:
            return
        reference_um = self._reference.queue.head(count)
        feedforward_um = (
            self._feedforward.queue.head(count) if self._feeds_forward else np.zeros(count))
        self._lent_at = self._command.next_index
        self._bind(relay, reference_um, feedforward_um)
        self.quick = relay.look

    def _take_back(self) -> None:
        """Drop the targets that the relay has used."""
        if self._lent_at is None:
            return
        self._lent_at = None
        self.quick = self.look
        self._reference.drop_before(self._command.next_index)
        self._feedforward.drop_before(self._command.next_index)

    def _poll_other(self) -> bool:
        """Go on with what the relay could not answer."""
        self._take_back()
        samples = self._displacement.take_rest()
        if samples is not None:
            self._displacement.queue.extend(samples)
        return self.poll() or samples is not None

    def _use_law(self) -> None:
        law = self._schedule.law
        self._constants = controller_constants(law, self.settings.sample_period_s)
        if self._packed:
            self._packed.use(self._constants)
        self._closes_loop = law.uses_feedback
        self._feeds_forward = law.uses_feedforward
        self.in_blocks = not law.uses_feedback

    def poll(self) -> bool:
        """Send every command that can be computed now."""
        self._take_back()
        if self._prepare is not None:
            if not self._prepare():
                return self._check_end()
            self._prepare = None
        if self._closes_loop:
            progress = self._poll_feedback()
        else:
            progress = self._poll_blocks()
        self._demand.update(self._displacement.next_index)
        if self._relay and self._closes_loop and self._prepare is None and self.running:
            if not (self._displacement.queue or self._displacement.ended):
                self._lend(self._relay)
        return progress

    def begin_at(self, index: int) -> None:
        """Wait for the other streams: the run begins where all of them have begun."""

    def _join(self) -> bool:
        """Drop what comes before the first sample that all streams have; return whether it came."""
        readers = [self._reference]
        if self._closes_loop:
            readers.append(self._displacement)
        if self._feeds_forward:
            readers.append(self._feedforward)
        for reader in readers:
            if not reader.queue and not reader.fill():
                return False
        first = max(reader.queue_index for reader in readers)
        for reader in readers:
            reader.drop_before(first)
        if not all(reader.queue for reader in readers):
            return False
        self._first = first
        self._command.begin_at(first)
        return True

    def _change(self) -> None:
        """Go over to the law that holds from the next sample on."""
        had_feedback, fed_forward = self._closes_loop, self._feeds_forward
        self._schedule.apply()
        if self._index:
            prepare_transfer(self._memory)
        self._use_law()
        needs_past = self._closes_loop and not had_feedback
        needs_feedforward = self._feeds_forward and not fed_forward
        if needs_past or needs_feedforward:
            self._prepare = lambda: (
                (not needs_feedforward or self._begin_feedforward())
                and (not needs_past or self._recall()))
        law = self._schedule.law
        self.get_logger().info(
            f'from sample {self._first + self._index} on: {law.scheme}, '
            f'kP {law.proportional_gain:g}, kI {law.integral_gain_per_s:g} 1/s')
        self._report('active')

    def _begin_feedforward(self) -> bool:
        """Wait for the feedforward of the next sample; return whether it is there."""
        feedforward, index = self._feedforward, self._first + self._index
        while feedforward.take_from(index):
            pass
        if feedforward.ended and not feedforward.queue:
            raise StreamFault(
                f'{feedforward.subscription.topic_name} ended before sample {index}, from which on '
                'the scheme needs it')
        if not feedforward.queue:
            return False
        if feedforward.queue_index > index:
            raise StreamFault(
                f'{feedforward.subscription.topic_name} begins at sample '
                f'{feedforward.queue_index}, the scheme needs it from sample {index} on')
        return True

    def _recall(self) -> bool:
        """Tell the controller what was measured lately, without feedback; return whether all is."""
        displacement = self._displacement
        if displacement.queue_index + len(displacement.queue) < self._first + self._index:
            displacement.fill()
        while displacement.queue and displacement.queue_index < self._first + self._index:
            index = displacement.queue_index - self._first
            recall_measurement(self._memory, index, displacement.queue.popleft())
        if displacement.queue_index > self._first + self._index:
            raise StreamFault(
                f'{displacement.subscription.topic_name} begins at sample '
                f'{displacement.queue_index}, feedback at sample {self._first + self._index}')
        return displacement.queue_index == self._first + self._index

    def _poll_feedback(self) -> bool:
        displacement, reference = self._displacement, self._reference
        progress = False
        if not displacement.queue and displacement.fill():
            progress = True
        while displacement.queue and self._next_target():
            if self._index == self._schedule.change_at:
                self._change()
                if self._prepare is not None or not self._closes_loop:
                    return True
            reference_um = reference.queue.popleft()
            feedforward_um = self._feedforward.queue.popleft() if self._feeds_forward else 0.0
            self._command.publish_one(controller_step(
                self._memory, self._constants, self._index, reference_um, feedforward_um,
                displacement.queue.popleft()))
            progress = True
        return self._check_end() or progress

    def _poll_blocks(self) -> bool:
        progress = self._take_displacement()
        if self._packed:
            if self._answer_blocks(self._packed):
                self._skip_feedforward()
                return True
            if self._targets[0].size:  # for the feedforward
                return progress
        if self._next_target():
            if self._index == self._schedule.change_at:
                self._change()
                if self._prepare is not None or self._closes_loop:
                    return True
            reference, feedforward = self._reference.queue, self._feedforward.queue
            count = len(reference)
            if self._feeds_forward:
                count = min(count, len(feedforward))
            if self._schedule.change_at > self._index:
                count = min(count, self._schedule.change_at - self._index)
            commands = []
            for index in range(self._index, self._index + count):
                feedforward_um = feedforward.popleft() if self._feeds_forward else 0.0
                commands.append(controller_step(
                    self._memory, self._constants, index, reference.popleft(), feedforward_um,
                    0.0))
            self._command.publish(commands)
            progress = True
        return self._check_end() or progress

    def _take_displacement(self) -> bool:
        """Take what has come of the displacement; only the newest samples are of interest."""
        # A scheme that is to come may ask for the last measurements before its first sample. Played
        # from a bag it may be there, end and all, before anything is commanded: what cannot be an
        # answer yet stays where it is.
        displacement, commanded = self._displacement, self._command.next_index
        wanted = commanded - len(self._memory.measured_um)
        taken = 0
        while taken < BURST_BLOCKS and displacement.next_index <= commanded:
            if not displacement.take_from(wanted):
                break
            taken += 1
        return taken > 0

    def _skip_feedforward(self) -> None:
        """Take the feedforward also where the scheme does not use it: its writer would wait."""
        if not self._feeds_forward:
            while self._feedforward.take_from(self._command.next_index):
                pass

    def _answer_blocks(self, packed: PackedController) -> bool:
        """Answer the targets that wait in compiled code, if nothing else is to be done."""
        reference, feedforward = self._targets
        if self._schedule.change_at != NEVER or self._reference.queue or (
                self._feeds_forward and self._feedforward.queue):
            reference.pour()
            feedforward.pour()
            return False
        reference.fill()
        count = reference.size
        if self._feeds_forward and count:
            feedforward.fill()
            count = min(count, feedforward.size)
        if not count:
            return False
        from piezo_ros.control.kernels import controller_packed_array
        blocks = reference.pull(count)
        reference_um = np.concatenate(blocks)
        feedforward_um = (
            np.concatenate(feedforward.pull(count)) if self._feeds_forward
            else np.zeros_like(reference_um))
        command_um = np.empty_like(reference_um)
        controller_packed_array(
            packed.packed, self._index, reference_um, feedforward_um, command_um)
        publish_blocks(self._command, command_um, [block.size for block in blocks])
        return True

    def _next_target(self) -> bool:
        """Return whether reference and feedforward of the next sample are there."""
        if not self._reference.queue:
            if not self._reference.fill():
                return False
            self._skip_feedforward()
        if self._feeds_forward and not self._feedforward.queue:
            self._feedforward.fill()
            return bool(self._feedforward.queue) and bool(self._reference.queue)
        return bool(self._reference.queue)

    def _check_end(self) -> bool:
        """Pass the end of the trajectory on; finish once the plant has ended too."""
        if not self._commands_ended:
            if self._reference.ended and not self._reference.queue:
                self._commands_ended = True
                self._command.end()
                return True
            if self._displacement.ended:
                # The plant ends first only because it was stopped, or for a fault, its own or
                # upstream of it: whose it is says so.
                self.stop(
                    f'{self._displacement.subscription.topic_name} ended at sample '
                    f'{self._displacement.next_index}, before the trajectory', by_peer=True)
                return True
            return False
        progress = self._displacement.fill()
        self._displacement.queue.clear()
        if not self._feedforward.ended:
            progress = self._feedforward.take_from(self._command.next_index) or progress
        if self._displacement.ended:
            self.finish()
        return progress

    def watch(self, now_s: float) -> None:
        """End the run when a foreign source ignores the demand and sends far too much."""
        for reader in self.readers.values():
            waiting = len(reader.queue)
            if waiting > self._flow.max_buffer_samples:
                raise StreamFault(
                    f'{waiting} samples of {reader.subscription.topic_name} wait, allowed are '
                    f'{self._flow.max_buffer_samples}')

    def change_parameters(self, changes: Mapping[str, Any]) -> str:
        """Schedule new gains and another scheme of a running controller."""
        at_sample = int(changes.get('apply_at_sample', -1))
        values = {name: changes[name] for name in CHANGEABLE if name in changes}
        if at_sample >= 0 and not (self.running and values):
            return (
                f'apply_at_sample is {at_sample}; it goes with gains or scheme in one call of '
                'set_parameters_atomically, during a run')
        if not (self.running and values):
            return ''
        refusals: list[str] = []
        self.between_samples(lambda: refusals.append(self._schedule_change(at_sample, values)))
        return refusals[0]

    def _schedule_change(self, at_sample: int, values: Mapping[str, Any]) -> str:
        """Add a change between two samples; return why not, '' if it was added."""
        self._take_back()
        next_index = self._first + self._index
        if at_sample < 0:
            at_sample = next_index
        elif at_sample < next_index:
            return f'apply_at_sample is {at_sample}; the next sample is {next_index} already'
        try:
            if not self._is_fed() and self._schedule.law.replaced(**values).uses_feedforward:
                return (
                    f'scheme is {values.get("scheme")!r}, and nobody sends '
                    f'{self._feedforward.subscription.topic_name}')
            self._schedule.add(at_sample - self._first, values)
        except ParameterError as error:
            return str(error)
        return ''

    def _is_fed(self) -> bool:
        """Return whether somebody sends the feedforward, or has sent it."""
        feedforward = self._feedforward
        return bool(feedforward.received or feedforward.subscription.get_publisher_count())

    def has_waiting(self, reader: StreamReader) -> bool:
        """Return whether samples wait: in blocks, one stream comes long before the others."""
        return bool(reader.queue) or reader.fill()

    def quiesce(self) -> None:
        """Ask for nothing more."""
        self._demand.end()

    def parameters_changed(self) -> None:
        """Forget the sample of a change; it holds for one call alone."""
        if self.get_parameter('apply_at_sample').value != -1:
            self.set_parameters([Parameter('apply_at_sample', value=-1)])
