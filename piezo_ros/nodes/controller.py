"""The controller: reference, feedforward and displacement in, linearised command out."""

from typing import Any

from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from piezo_ros.control.controller import (
    AUTO,
    ControllerParameters,
    controller_constants,
    controller_step,
    initial_state,
)
from piezo_ros.experiment.node_parameters import DemandParameters
from piezo_ros.nodes.demand import DemandWriter
from piezo_ros.nodes.parameters import read
from piezo_ros.nodes.stage import Stage
from piezo_ros.nodes.streams import StreamFault

__all__ = ['Controller']


class Controller(Stage):
    """
    Sends v[k] once y_d[k], u_ff[k] and, with feedback, y[k] are there.

    Without feedback it follows the blocks of the trajectory; the displacement then only paces the
    demand.
    """

    inputs = ('reference', 'feedforward', 'displacement')
    outputs = ('command',)

    def __init__(self, *, compiled: bool = False) -> None:
        super().__init__('controller', compiled=compiled)
        self._chosen_scheme = ''

    def configure(self) -> None:
        """Make the constants of the control law; decide what the scheme auto stands for."""
        self._law = read(self, ControllerParameters)
        if self._law.scheme == AUTO:
            self._choose_scheme()
        self._flow = read(self, DemandParameters)
        self._constants = controller_constants(
            self._law, self.settings.sample_period_s)

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
        """Return the scheme that is in use."""
        return {'scheme': self._law.scheme}

    def create_endpoints(self) -> None:
        """Create the publisher of the demand."""
        self._demand = DemandWriter(self, self._flow.lookahead_samples)

    def required_inputs(self) -> tuple[str, ...]:
        """Return what the scheme needs; the displacement paces every scheme."""
        if self._law.uses_feedforward:
            return self.inputs
        return ('reference', 'displacement')

    def start(self) -> None:
        """Forget everything and ask for the first samples."""
        self._memory = initial_state(self._law)
        self._reference = self.readers['reference']
        self._feedforward = self.readers['feedforward']
        self._displacement = self.readers['displacement']
        self._command = self.writers['command']
        # A feedforward that the scheme does not use is taken all the same while somebody sends it.
        self._has_feedforward = self._feedforward.subscription.get_publisher_count() > 0
        self._index = 0
        self._commands_ended = False
        self._demand.start(0)

    def poll(self) -> bool:
        """Send every command that can be computed now."""
        if self._law.uses_feedback:
            progress = self._poll_feedback()
        else:
            progress = self._poll_blocks()
        self._demand.update(self._displacement.next_index)
        return progress

    def _poll_feedback(self) -> bool:
        displacement, reference = self._displacement, self._reference
        progress = False
        if not displacement.queue and displacement.fill():
            progress = True
        while displacement.queue and self._next_target():
            reference_um = reference.queue.popleft()
            feedforward_um = self._feedforward.queue.popleft() if self._has_feedforward else 0.0
            self._command.publish_one(controller_step(
                self._memory, self._constants, self._index, reference_um, feedforward_um,
                displacement.queue.popleft()))
            self._index += 1
            progress = True
        return self._check_end() or progress

    def _poll_blocks(self) -> bool:
        progress = self._displacement.fill()
        self._displacement.queue.clear()
        if self._next_target():
            reference, feedforward = self._reference.queue, self._feedforward.queue
            count = len(reference)
            if self._has_feedforward:
                count = min(count, len(feedforward))
            commands = []
            for _ in range(count):
                feedforward_um = feedforward.popleft() if self._has_feedforward else 0.0
                commands.append(controller_step(
                    self._memory, self._constants, self._index, reference.popleft(),
                    feedforward_um, 0.0))
                self._index += 1
            self._command.publish(commands)
            progress = True
        return self._check_end() or progress

    def _next_target(self) -> bool:
        """Return whether reference and feedforward of the next sample are there."""
        if not self._reference.queue and not self._reference.fill():
            return False
        if self._has_feedforward and not self._feedforward.queue:
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
                # The plant ends first only for a fault of its own or upstream of it.
                raise StreamFault(
                    f'{self._displacement.subscription.topic_name} ended at sample '
                    f'{self._displacement.next_index}, before the trajectory')
            return False
        progress = self._displacement.fill()
        self._displacement.queue.clear()
        if self._has_feedforward and not self._feedforward.ended:
            progress = self._feedforward.fill() or progress
            self._feedforward.queue.clear()
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
