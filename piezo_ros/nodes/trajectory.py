"""The trajectory generator: reference and feedforward in blocks, as far as they are demanded."""

from typing import Any

from std_msgs.msg import UInt64

from piezo_ros.control.trajectory import (
    TrajectoryParameters,
    trajectory_constants,
    trajectory_step,
)
from piezo_ros.experiment.node_parameters import BlockParameters
from piezo_ros.nodes.parameters import read
from piezo_ros.nodes.qos import LATCHED
from piezo_ros.nodes.stage import Stage

__all__ = ['Trajectory']


class Trajectory(Stage):
    """Sends the samples below the newest demand."""

    outputs = ('reference', 'feedforward')

    def __init__(self) -> None:
        super().__init__('trajectory')

    def configure(self) -> None:
        """Make the constants of waveform and feedforward."""
        parameters = read(self, TrajectoryParameters)
        self._constants = trajectory_constants(parameters)
        self._samples = parameters.samples
        self._block_samples = read(self, BlockParameters).block_samples

    def create_endpoints(self) -> None:
        """Create the subscription of the demand."""
        self._demand = self.create_stream_subscription(UInt64, 'demand', LATCHED)
        self._take_demand = self._demand.handle.take_message

    def missing_peers(self) -> str:
        """Return whether somebody demands samples."""
        writers = self._demand.get_publisher_count()
        if writers != 1:
            return f'{self._demand.topic_name} has {writers} writers, exactly one is needed'
        return ''

    def start(self) -> None:
        """Begin at the first sample."""
        self._reference = self.writers['reference']
        self._feedforward = self.writers['feedforward']
        self._index = max(self.settings.start_index, 0)
        self._limit = 0

    def poll(self) -> bool:
        """Send one block of what is demanded."""
        if self._index >= self._limit:
            taken = self._take_demand(UInt64, False)
            if taken is None:
                return False
            self._limit = min(max(self._limit, taken[0].data), self._samples)
        count = min(self._limit - self._index, self._block_samples)
        if count > 0:
            pairs = [trajectory_step(self._constants, self._index + i) for i in range(count)]
            self._index += count
            self._reference.publish([reference_um for reference_um, _ in pairs])
            self._feedforward.publish([feedforward_um for _, feedforward_um in pairs])
        if self._index >= self._samples:
            self.finish()
        return True

    def status_fields(self) -> dict[str, Any]:
        """Return the length of the run."""
        return {'total': getattr(self, '_samples', 0)}
