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
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from piezo_ros.control.changes import CHANGEABLE, ChangeParameters, parse_changes
from piezo_ros.control.control_law import ControlLaw, check_command
from piezo_ros.control.controller import AUTO, ControllerParameters
from piezo_ros.control.pi_controller import PiController
from piezo_ros.model.parameters import ParameterError
from piezo_ros.nodes.demand import DemandWriter
from piezo_ros.nodes.law_schedule import LawSchedule
from piezo_ros.parameters.node_parameters import DemandParameters
from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.node.parameters import read
from piezo_ros.runtime.streams.bursts import BURST_BLOCKS, MOST_JOINED
from piezo_ros.runtime.streams.fault import StreamFault
from piezo_ros.runtime.streams.reader import StreamReader

if TYPE_CHECKING:
    from piezo_ros.runtime.node.relay import Relay

__all__ = ['Controller']

_WORTH_RELAYING = 4  # samples; for fewer the relay costs more than it saves
_MOST_RELAYED = 4096  # samples, whose targets are laid out for it at once

class Controller(LoopNode):
    """
    Sends v[k] once y_d[k], u_ff[k] and, with feedback, y[k] are there.

    Without feedback it follows the blocks of the trajectory; the displacement then only paces the
    demand. Changes of gains and scheme are made between two samples, see
    `piezo_ros.nodes.law_schedule`.
    """

    inputs = ('reference', 'feedforward', 'displacement')
    outputs = ('command',)

    def __init__(
        self, *, compiled: bool = False, control_law: type[ControlLaw] | None = None,
    ) -> None:
        self._own_law = control_law
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
        self._element = self._make_element()
        self._reference = self.readers['reference']
        self._feedforward = self.readers['feedforward']
        self._displacement = self.readers['displacement']
        self._command = self.writers['command']
        self._first = max(self.settings.start_index, 0)
        self._commands_ended = False
        self._relay = self._make_relay()
        # What must be done before the next sample can be; None for nothing.
        self._prepare: Callable[[], bool] | None = None
        if self.settings.start_index < 0:
            self._prepare = self._join
        self._use_law()
        self._demand.start(0, self._flow.lookahead_samples)

    def _make_element(self) -> ControlLaw:
        """Return the control law in its initial state."""
        if self._own_law:
            return self._own_law(self._law, self.settings.sample_period_s)
        return PiController(
            self._law, self.settings.sample_period_s, compiled=self.settings.compiled)

    def _make_relay(self) -> 'Relay | None':
        element = self._element
        if not isinstance(element, PiController) or not element.is_compiled:
            return None
        from piezo_ros.runtime.node.relay import Relay
        return Relay(self, self._displacement, self._command, element, self._poll_taken)

    @property
    def _index(self) -> int:
        """Number of the next sample, from the first one of the run on."""
        return self._command.next_index - self._first

    def _use_law(self) -> None:
        law = self._schedule.law
        self._closes_loop = law.uses_feedback
        self._feeds_forward = law.uses_feedforward
        self.in_blocks = not law.uses_feedback

    def poll(self) -> bool:
        """Send every command that can be computed now."""
        return self._go_on(self._take_inputs)

    def _poll_taken(self) -> bool:
        """Go on with the displacement that the relay has taken and left."""
        self._end_relay()
        return self._go_on(self._take_left)

    def _go_on(self, take_inputs: Callable[[], bool]) -> bool:
        if self._prepare is not None:
            if not self._prepare():
                return self._check_end()
            self._prepare = None
        progress = take_inputs()
        while count := self._count_ready():
            if self._index == self._schedule.change_at:
                self._change()
                if self._prepare is not None:
                    return True
                continue
            self._answer(count)
            progress = True
        self._demand.update(self._displacement.next_index)
        if self._check_end():
            return True
        if progress and self._relay:
            self._begin_relay(self._relay)
        return progress

    def _begin_relay(self, relay: 'Relay') -> None:
        """Let single displacements be answered in compiled code, as far as there are targets."""
        displacement = self._displacement
        if not self._closes_loop or displacement.held or displacement.queue:
            return
        if self._schedule.change_at == self._index:
            return
        targets = [reader.queue.waiting for reader in self._targets()]
        count = min(self._count_targets(), _MOST_RELAYED)
        if count < _WORTH_RELAYING:
            return
        beside = np.zeros((2, count))
        for row, target_um in enumerate(targets):
            beside[row] = target_um[:count]
        relay.use(self._command.next_index, beside, self._first)
        self.quick = relay.look

    def _end_relay(self) -> None:
        """Drop the targets that the relay has used."""
        if self.quick != self.look:
            self.quick = self.look
            for reader in self._targets():
                reader.drop_before(self._command.next_index)

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
        self._element.change(self._schedule.law, bumpless=self._index > 0)
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
        self.status.report('active')

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
            self._element.recall(index, displacement.queue.popleft())
        if displacement.queue_index > self._first + self._index:
            raise StreamFault(
                f'{displacement.subscription.topic_name} begins at sample '
                f'{displacement.queue_index}, feedback at sample {self._first + self._index}')
        return displacement.queue_index == self._first + self._index

    def _take_inputs(self) -> bool:
        """Take what has come; return whether there was anything."""
        if self._closes_loop:
            progress = not self._displacement.queue and self._displacement.fill()
            most = 1
        else:
            progress = self._take_displacement()
            most = BURST_BLOCKS
        for reader in self._targets():
            if not reader.queue and reader.fill_many(most):
                progress = True
                if not self._feeds_forward:
                    self._skip_feedforward()
        return progress

    def _take_left(self) -> bool:
        """Take the message that the relay has left, and more targets; return whether there were."""
        samples = self._displacement.take_rest()
        if samples is not None:
            self._displacement.queue.extend(samples)
        return self._take_inputs() or samples is not None

    def _targets(self) -> tuple[StreamReader, ...]:
        """Return the streams of the trajectory that the scheme needs."""
        return (
            (self._reference, self._feedforward) if self._feeds_forward else (self._reference,))

    def _count_ready(self) -> int:
        """Return of how many samples everything is there, under one law."""
        count = self._count_targets()
        if self._closes_loop:
            count = min(count, len(self._displacement.queue))
        return min(count, MOST_JOINED)

    def _count_targets(self) -> int:
        """Return of how many samples the targets are there, under one law."""
        count = min(len(reader.queue) for reader in self._targets())
        if self._schedule.change_at > self._index:
            count = min(count, self._schedule.change_at - self._index)
        return count

    def _answer(self, count: int) -> None:
        """Send the commands of the next samples."""
        reference_um = self._reference.queue.pull(count)
        nothing = np.zeros(count)
        command_um = self._element.answer(
            self._index, reference_um,
            self._feedforward.queue.pull(count) if self._feeds_forward else nothing,
            self._displacement.queue.pull(count) if self._closes_loop else nothing)
        if self._own_law:
            check_command(self._own_law, self._index, command_um, count)
        self._command.publish(command_um)

    def _take_displacement(self) -> bool:
        """Take what has come of the displacement; only the newest samples are of interest."""
        # A scheme that is to come may ask for the last measurements before its first sample. Played
        # from a bag it may be there, end and all, before anything is commanded: what cannot be an
        # answer yet stays where it is.
        displacement, commanded = self._displacement, self._command.next_index
        wanted = commanded - self._element.recalled_samples
        taken = 0
        while taken < BURST_BLOCKS and displacement.next_index <= commanded:
            if not displacement.take_from(wanted):
                break
            taken += 1
        return taken > 0

    def _skip_feedforward(self) -> None:
        """Take the feedforward also where the scheme does not use it: its writer would wait."""
        while self._feedforward.take_from(self._command.next_index):
            pass

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
        self._end_relay()
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
