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
from typing import Any

from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from piezo_ros.control.changes import ChangeParameters
from piezo_ros.control.control_law import ControlLaw, check_command
from piezo_ros.control.controller_step import ControllerParameters
from piezo_ros.nodes.controller_parts.automatic_scheme import AutomaticScheme
from piezo_ros.nodes.controller_parts.change_request import ChangeRequest
from piezo_ros.nodes.controller_parts.controller_inputs import ControllerInputs
from piezo_ros.nodes.controller_parts.input_alignment import reason_to_stop, unfed_topic
from piezo_ros.nodes.controller_parts.law_schedule import LawSchedule
from piezo_ros.nodes.controller_parts.make_law import make_law
from piezo_ros.nodes.controller_parts.target_relay import TargetRelay
from piezo_ros.nodes.demand import DemandWriter
from piezo_ros.parameters.node_parameters import DemandParameters
from piezo_ros.runtime.node.declared_parameters import read
from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.streams.stream_reader import StreamReader

__all__ = ['Controller']


class Controller(LoopNode):
    """
    Sends v[k] once y_d[k], u_ff[k] and, with feedback, y[k] are there.

    Without feedback it follows the blocks of the trajectory; the displacement then only paces the
    demand. Its parts: `ControllerInputs`, `LawSchedule` and, for the mathematics, a `ControlLaw`.
    """

    inputs = ('reference', 'feedforward', 'displacement')
    outputs = ('command',)

    def __init__(
        self, *, compiled: bool = False, control_law: type[ControlLaw] | None = None,
    ) -> None:
        self._own_law = control_law
        self._schedule = LawSchedule(ControllerParameters())
        super().__init__('controller', compiled=compiled)
        self._automatic_scheme = AutomaticScheme(self)

    def configure(self) -> None:
        """Make the constants of the control law; decide what the scheme auto stands for."""
        law = self._automatic_scheme.resolve(read(self, ControllerParameters))
        self._flow = read(self, DemandParameters)
        self._schedule = LawSchedule.listed(law, read(self, ChangeParameters))

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget what the scheme auto stood for."""
        self._automatic_scheme.forget()
        return super().on_cleanup(state)

    def status_fields(self) -> dict[str, Any]:
        """Return the scheme that is in use, and the sample from which it and the gains apply."""
        changed_at = self._schedule.changed_at
        return {
            'scheme': self._schedule.law.scheme,
            'changed_at': None if changed_at is None else changed_at + self._paired.first}

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
        self._schedule.restart()
        self._command = self.writers['command']
        self._commands_ended = False
        self._law = make_law(self._own_law, self._schedule.law, self.settings)
        self._paired = ControllerInputs(
            self.readers, self._command, self._law, self._schedule.law, self.settings.start_index)
        self._relay = TargetRelay(self, self._paired, self._command, self._law, self._poll_left)
        self.in_blocks = not self._paired.closes_loop
        self._demand.start(0, self._flow.lookahead_samples)

    def begin_at(self, index: int) -> None:
        """Wait for the other streams: the run begins where all of them have begun."""

    def poll(self) -> bool:
        """Send every command that can be computed now."""
        return self._poll_with(self._paired.take)

    def _poll_left(self) -> bool:
        """Do as `poll`, after the displacement that the relay has taken and not used."""
        self._relay.end()
        return self._poll_with(self._paired.take_left)

    def _poll_with(self, take: Callable[[], bool]) -> bool:
        """Take inputs, answer them and ask for more; return whether there was anything to do."""
        paired, schedule = self._paired, self._schedule
        if not (paired.is_ready or paired.prepare()):
            return self._check_end()
        progress = take()
        while count := paired.count(schedule.samples_before_change(paired.index)):
            if paired.index == schedule.change_at:
                self._change_law()
                if not paired.is_ready:
                    return True
                continue
            index = paired.index
            command_um = self._law.answer(index, *paired.pull(count))
            if self._own_law:
                check_command(self._own_law, index, command_um, count)
            self._command.publish(command_um)
            progress = True
        self._demand.update(paired.displacement.next_index)
        if self._check_end():
            return True
        if progress and paired.index != schedule.change_at:
            self._relay.begin(schedule.samples_before_change(paired.index))
        return progress

    def _change_law(self) -> None:
        """Go over to the gains and the scheme that apply from the next sample on."""
        self._schedule.apply()
        parameters = self._schedule.law
        self._law.change(parameters, bumpless=self._paired.index > 0)
        self._paired.change(parameters)
        self.in_blocks = not self._paired.closes_loop
        self.get_logger().info(
            f'from sample {self._command.next_index} on: {parameters.scheme}, '
            f'kP {parameters.proportional_gain:g}, kI {parameters.integral_gain_per_s:g} 1/s')
        self.status.report('active')

    def _check_end(self) -> bool:
        """Pass the end of the trajectory on; finish once the plant has ended too."""
        reference, displacement = self._paired.reference, self._paired.displacement
        if self._commands_ended:
            progress = self._paired.take_after_end()
            if displacement.ended:
                self.finish()
            return progress
        if reference.ended and not reference.queue:
            self._commands_ended = True
            self._command.end()
            return True
        if reason := reason_to_stop(displacement, self._paired.targets):
            self.stop(reason, by_peer=True)
            return True
        return False

    def watch(self, now_s: float) -> None:
        """End the run when a foreign source ignores the demand and sends far too much."""
        self._demand.check_kept(self.readers.values(), self._flow.max_buffer_samples)

    def change_parameters(self, changes: Mapping[str, Any]) -> str:
        """Schedule new gains and another scheme of a running controller."""
        request = ChangeRequest.among(changes)
        if not (self.running and request.values):
            return request.refusal_without_run
        refusals: list[str] = []

        def schedule() -> None:
            self._relay.end()
            is_known = self._command.sent or self.settings.start_index >= 0
            refusals.append(request.add_to(
                self._schedule, next_index=self._command.next_index,
                first=self._paired.first if is_known else None,
                unfed_topic=unfed_topic(self._paired.feedforward)))

        self.requests.during_run(schedule)
        return refusals[0]

    def has_waiting(self, reader: StreamReader) -> bool:
        """Return whether samples wait: in blocks, one stream comes long before the others."""
        return bool(reader.queue) or reader.fill()

    def quiesce(self) -> None:
        """Ask for nothing more."""
        self._demand.end()

    def parameters_changed(self) -> None:
        """Forget the sample of a change; it applies to one call alone."""
        if self.get_parameter('apply_at_sample').value != -1:
            self.set_parameters([Parameter('apply_at_sample', value=-1)])
