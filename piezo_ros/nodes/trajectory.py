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

from collections.abc import Mapping
from typing import Any

from rclpy.parameter import Parameter

from piezo_ros.control.trajectory_blocks import ChangingTable, trajectory_blocks
from piezo_ros.control.trajectory_step import TrajectoryParameters
from piezo_ros.control.waveform import FILE
from piezo_ros.model import ParameterError
from piezo_ros.nodes.joint_demand import JointDemand
from piezo_ros.parameters.node_parameters import BlockParameters, FileChangeParameters
from piezo_ros.runtime.node.declared_parameters import read
from piezo_ros.runtime.node.loop_node import LoopNode
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
        at_sample = read(self, FileChangeParameters).apply_at_sample
        if at_sample >= 0:
            raise ParameterError(_without_run(at_sample))
        self._trajectory = parameters
        self._make_blocks()
        self._samples = parameters.samples
        bare = parameters.output == 'voltage'
        self.outputs = ('voltage',) if bare else ('reference', 'feedforward')
        self._block_samples = read(self, BlockParameters).block_samples

    def _make_blocks(self) -> None:
        """Make what computes the samples; files that came during a run are forgotten."""
        compiled = self.settings.compiled
        self._changing = (
            ChangingTable(self._trajectory, compiled=compiled)
            if self._trajectory.waveform == FILE else None)
        self._blocks = self._changing or trajectory_blocks(self._trajectory, compiled=compiled)

    def create_endpoints(self) -> None:
        """Create the subscriptions of the demand, and of that of rigs in step."""
        self._demand = JointDemand(
            self, read(self, BlockParameters).namespaces_in_step(self.get_namespace()))

    def missing_peers(self) -> str:
        """Return why no samples can be demanded, '' where they can."""
        return self._demand.wrong_writers()

    def start(self) -> None:
        """Begin at the first sample."""
        self._streams = [self.writers[stream] for stream in self.outputs]
        self._index = max(self.settings.start_index, 0)
        self._limit = 0
        if self._changing and self._changing.has_grown:
            self._make_blocks()
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
        self._demand.warn_of_none()

    def status_fields(self) -> dict[str, Any]:
        """Return the length of the run, and which file is played from which sample on."""
        fields: dict[str, Any] = {'total': getattr(self, '_samples', 0)}
        if table := getattr(self, '_changing', None):
            newest = table.newest
            fields |= {
                'file': newest.file, 'changed_at': newest.at_sample or None}
        return fields

    def change_parameters(self, changes: Mapping[str, Any]) -> str:
        """Schedule another file of a running trajectory."""
        at_sample = int(changes.get('apply_at_sample', -1))
        if not (self.running and 'file' in changes):
            return '' if at_sample < 0 else _without_run(at_sample)
        refusals: list[str] = []
        self.requests.during_run(
            lambda: refusals.append(self._change_file(str(changes['file']), at_sample)))
        return refusals[0]

    def _change_file(self, file: str, at_sample: int) -> str:
        """Play another file from a sample on; return why not, '' if so."""
        if self._changing is None:
            return f'file is {file!r}: only the waveform file has a file that can change'
        if self._changing.newest == (at_sample, file):
            return ''  # asked for once more, for the answer was lost
        if 0 <= at_sample < self._index:
            return f'apply_at_sample is {at_sample}; the next sample is {self._index} already'
        try:
            if at_sample < 0:
                at_sample = self._changing.nearest_sample(file, self._index)
            self._changing.add(at_sample, file)
        except ParameterError as error:
            return str(error)
        self.get_logger().info(f'from sample {at_sample} on: {file}')
        self.status.report()
        return ''

    def parameters_changed(self) -> None:
        """Forget the sample of a change; it applies to one call alone."""
        if self.get_parameter('apply_at_sample').value != -1:
            self.set_parameters([Parameter('apply_at_sample', value=-1)])


def _without_run(at_sample: int) -> str:
    return (
        f'apply_at_sample is {at_sample}; it goes with file in one call of '
        'set_parameters_atomically, during a run')
