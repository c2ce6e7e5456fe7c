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

"""The trajectory generator: reference and feedforward in blocks, as far as they are demanded."""

from typing import Any

from piezo_ros.control.trajectory import TrajectoryParameters
from piezo_ros.control.trajectory_blocks import trajectory_blocks
from piezo_ros.nodes.joint_demand import JointDemand
from piezo_ros.parameters.node_parameters import BlockParameters
from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.node.parameters import read
from piezo_ros.runtime.streams.bursts import BURST_BLOCKS

__all__ = ['Trajectory']


class Trajectory(LoopNode):
    """Sends the samples below the newest demand."""

    outputs: tuple[str, ...] = ('reference', 'feedforward')
    urgent = False

    def __init__(self, *, compiled: bool = False) -> None:
        super().__init__('trajectory', compiled=compiled)

    def configure(self) -> None:
        """Make the constants of waveform and feedforward."""
        parameters = read(self, TrajectoryParameters)
        self._blocks = trajectory_blocks(parameters, compiled=self.settings.compiled)
        self._samples = parameters.samples
        bare = parameters.output == 'voltage'
        self.outputs = ('voltage',) if bare else ('reference', 'feedforward')
        self._block_samples = read(self, BlockParameters).block_samples

    def create_endpoints(self) -> None:
        """Create the subscriptions of the demand, and of that of rigs in step."""
        self._demand = JointDemand(self, read(self, BlockParameters).rigs_in_step)

    def missing_peers(self) -> str:
        """Return why no samples can be demanded, '' where they can."""
        return self._demand.wrong_writers()

    def start(self) -> None:
        """Begin at the first sample."""
        self._streams = [self.writers[stream] for stream in self.outputs]
        self._index = max(self.settings.start_index, 0)
        self._limit = 0
        self._demand.start()

    def poll(self) -> bool:
        """Send some blocks of what is demanded."""
        if self._index >= self._limit:
            if not self._demand.take():
                return False
            if self._demand.ended:
                self.stop(self._demand.why_ended(), by_peer=True)
                return True
            self._limit = min(self._demand.limit, self._samples)
        count = min(self._limit - self._index, self._block_samples * BURST_BLOCKS)
        if count > 0:
            samples = self._blocks(self._index, count)
            self._index += count
            for first in range(0, count, self._block_samples):
                # The voltage of the bare actuator is the reference alone.
                for stream, ours in zip(self._streams, samples, strict=False):
                    stream.publish(ours[first:first + self._block_samples])
        if self._index >= self._samples:
            self.finish()
        return True

    def watch(self, now_s: float) -> None:
        """End the run when no node is left to demand samples."""
        self._demand.check_writer(self.settings.lost_writer_timeout_s)

    def status_fields(self) -> dict[str, Any]:
        """Return the length of the run."""
        return {'total': getattr(self, '_samples', 0)}
