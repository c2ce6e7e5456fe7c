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

"""The plant of a real stage: a device plays the voltages. It alone owns the output."""

from collections.abc import Mapping
from typing import Any

from piezo_ros.hardware.device import DeviceError
from piezo_ros.nodes.demand import DemandWriter
from piezo_ros.nodes.hardware_parts.feedback_refusal import FeedbackRefusal
from piezo_ros.nodes.hardware_parts.hardware_run import HardwareRun
from piezo_ros.nodes.hardware_parts.stage_output import StageOutput
from piezo_ros.nodes.plant_parts.watchdog import Watchdog
from piezo_ros.parameters.hardware_parameters import HardwareParameters
from piezo_ros.parameters.node_parameters import (
    HARDWARE_PLANT,
    BareParameters,
    InitialiseParameters,
    SafetyParameters,
)
from piezo_ros.runtime.node.declared_parameters import read
from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.node.rclpy_node.stream_node import ServiceRefusedError
from piezo_ros.runtime.streams.bursts import BURST_BLOCKS, MOST_JOINED
from piezo_ros.runtime.streams.fault import StreamFault
from piezo_ros.runtime.streams.stream_reader import StreamReader

__all__ = ['HardwarePlant']


class HardwarePlant(LoopNode):
    """
    Answers u[k … k+N-1] with y[k+1 … k+N]; opens with y[0], once the stage is at rest.

    Its parts: `StageOutput`, also between runs, and a `HardwareRun` for each.
    """

    inputs = ('voltage',)
    outputs = ('displacement',)
    program = HARDWARE_PLANT
    troubles = (*LoopNode.troubles, 'overruns')

    def __init__(self, *, compiled: bool = False) -> None:
        self._output = StageOutput()
        self._played: HardwareRun | None = None
        super().__init__('plant', compiled=compiled)
        self.create_trigger('initialise', self.initialise)

    def configure(self) -> None:
        """Read the parameters of device, stage and limits."""
        self._hardware = read(self, HardwareParameters)
        self._safety = read(self, SafetyParameters)
        self._output.configure(
            self._hardware, read(self, InitialiseParameters), self.settings.sample_period_s,
            self._safety.safe_slew_v_per_s)
        self._lookahead = read(self, BareParameters).demand_lookahead_samples

    def create_endpoints(self) -> None:
        """Create the publisher of the demand, where no controller demands."""
        self._demand = DemandWriter(self) if self._lookahead else None
        self._feedback = FeedbackRefusal(self)

    def _refusal(self) -> str:
        """Return why the present scheme of the controller is refused, '' where it is not."""
        return '' if self._hardware.is_on_demand else self._feedback.reason()

    def start(self) -> None:
        """Open the device; nothing is driven before the first poll."""
        if refusal := self._refusal():
            raise ValueError(refusal)
        self._reader, self._writer = self.readers['voltage'], self.writers['displacement']
        self._watchdog = Watchdog(self._reader)
        self._writer.wait_at_most(self._safety.watchdog_s)  # The output stands still meanwhile.
        self.in_blocks = not self._hardware.is_on_demand
        try:
            self._output.open()
        except DeviceError as error:
            raise ValueError(str(error)) from None
        start_index = self.settings.start_index
        self._played = HardwareRun(
            self._output, self._hardware, self.settings.sample_period_s,
            self._writer.publish_one, opens_itself=start_index >= 0)
        if self._demand:
            self._demand.start(max(start_index, 0), self._lookahead)

    def begin_at(self, index: int) -> None:
        """Open with the reading before the first voltage, the index of which is known only now."""
        super().begin_at(index)
        self._run_of_device.open()

    @property
    def _run_of_device(self) -> HardwareRun:
        assert self._played is not None
        return self._played

    def poll(self) -> bool:
        """Prepare the stage, then take voltages and send readings."""
        try:
            return self._poll(self._run_of_device)
        except DeviceError as error:
            raise StreamFault(str(error)) from None

    def _poll(self, run: HardwareRun) -> bool:
        if run.prepare():
            return True
        progress = self._take(run)
        readings_um = run.advance()
        if readings_um is None:
            return progress
        for first in range(0, readings_um.size, MOST_JOINED):
            self._writer.publish(readings_um[first:first + MOST_JOINED])
        if self._demand:
            self._demand.update(self._writer.newest_index)
        if run.is_over:
            # Before the end of the stream is told, so that a recorder hears of the rest voltage.
            self._output.come_to_rest()
            self.status.report()
            self.finish()
        return True

    def _take(self, run: HardwareRun) -> bool:
        """Take the voltages that have come; return whether there were any."""
        for blocks in range(BURST_BLOCKS):
            if self._reader.ended or (samples := self._reader.take_array()) is None:
                return blocks > 0
            try:
                run.accept(samples, is_last=self._reader.ended)
            except DeviceError as error:
                raise StreamFault(str(error)) from None
        return True

    def watch(self, now_s: float) -> None:
        """End the run when the voltage stays away; not while what has come is played."""
        if refusal := self._refusal():
            raise StreamFault(refusal)
        run = self._run_of_device
        try:
            self._watchdog.check(self._safety.watchdog_s, is_waiting=run.is_making_progress())
        except StreamFault as fault:
            raise StreamFault(f'{fault}{run.why_waiting}') from None
        except DeviceError as error:
            raise StreamFault(str(error)) from None

    def has_waiting(self, reader: StreamReader) -> bool:
        """Return whether samples have come that were not taken yet, or may have."""
        run = self._run_of_device
        return not run.is_prepared or self._take(run)

    def change_parameters(self, changes: Mapping[str, Any]) -> str:
        """Refuse a slew that the amplifier does not take, or at which no ramp would end."""
        slew_v_per_s = changes.get('safe_slew_v_per_s')
        if slew_v_per_s is None or not self.is_configured:
            return ''
        return self._hardware.refusal_of_slew(slew_v_per_s)

    def parameters_changed(self) -> None:
        """Take over new limits of the watchdog and of the safe slew."""
        self._safety = read(self, SafetyParameters)
        if self.running:
            self._writer.wait_at_most(self._safety.watchdog_s)
        self._output.use_slew(self._safety.safe_slew_v_per_s)

    def quiesce(self) -> None:
        """Ramp the output to rest and release the device."""
        if self._demand:
            self._demand.end()
        self._writer.wait_at_most()  # for the end: no limit at rest
        self._output.leave()

    def initialise(self) -> str:
        """Demagnetise the stage with a decaying triangle; the inverse assumes one without past."""
        try:
            self.requests.between_runs(
                lambda: self._output.initialise(lambda: self.stop_requested))
        except DeviceError as error:
            raise ServiceRefusedError(str(error)) from None
        return self._output.describe_triangle()

    def counts(self) -> dict[str, int]:
        """Return the counts of every node, and how often software timing came too late."""
        return {**super().counts(), 'overruns': self._played.overruns if self._played else 0}

    def status_fields(self) -> dict[str, Any]:
        """Return device, rate, the voltage that is held, and how the run is played."""
        run = self._played
        return {
            **self._output.status_fields(), 'elapsed_s': run.elapsed_s if run else 0.0,
            'overruns': self.counts()['overruns'], **(run.status_fields() if run else {})}
