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

"""The simulated rig: voltage in, measured displacement out. It alone owns the voltage."""

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.demagnetisation import demagnetising_voltage
from piezo_ros.model import Rig, RigParameters
from piezo_ros.nodes.demand import DemandWriter
from piezo_ros.nodes.pace import Pace
from piezo_ros.nodes.simulated_clock import SimulatedClock
from piezo_ros.parameters.node_parameters import (
    BareParameters,
    HistoryParameters,
    PaceParameters,
    SafetyParameters,
)
from piezo_ros.runtime.node.answering import AnsweringNode
from piezo_ros.runtime.node.parameters import read
from piezo_ros.runtime.node.stream_node import ServiceRefusedError
from piezo_ros.runtime.process.running_time import RunningTime
from piezo_ros.runtime.streams.bursts import publish_blocks
from piezo_ros.runtime.streams.fault import StreamFault
from piezo_ros.runtime.streams.reader import StreamReader

__all__ = ['Plant']

_SETTLE_S = 0.02  # simulated time at zero after the last of the decaying triangle
_NAP_S = 0.005  # a paced plant sleeps so long at once, and then looks whether it shall stop


class Plant(AnsweringNode):
    """Answers u[k … k+N-1] with y[k+1 … k+N]; opens with y[0]."""

    inputs = ('voltage',)
    outputs = ('displacement',)
    troubles = (*AnsweringNode.troubles, 'overruns', 'rail_samples', 'slew_samples')

    def __init__(self, *, compiled: bool = False) -> None:
        self._elapsed_s = 0.0
        self._simulated: Rig | None = None
        self._saturated_before = (0, 0)
        self._pace: Pace | None = None
        self._clock_writer: SimulatedClock | None = None
        super().__init__('plant', compiled=compiled)
        self.create_trigger('initialise', self.initialise)

    @property
    def _voltage_v(self) -> float:
        """The voltage that the rig is asked to hold."""
        return self._simulated.commanded_v if self._simulated else 0.0

    @property
    def _index(self) -> int:
        """Index of the newest reading, 0 before the first."""
        displacement = self.writers.get('displacement')
        return max(displacement.next_index - 1, 0) if displacement else 0

    def configure(self) -> None:
        """Read the parameters of the rig."""
        self._rig = read(self, RigParameters)
        self._safety = read(self, SafetyParameters)
        self._history = read(self, HistoryParameters)
        self._timing = read(self, PaceParameters)
        self._lookahead = read(self, BareParameters).demand_lookahead_samples

    def create_endpoints(self) -> None:
        """Create the publisher of the demand, where no controller demands, and of the clock."""
        self._demand = DemandWriter(self) if self._lookahead else None
        self._clock_writer = (
            SimulatedClock(self, lambda: self._index) if self._timing.publish_clock else None)

    def start(self) -> None:
        """Put the rig to rest at its operating point and send its first reading."""
        period_s, start_index = self.settings.sample_period_s, self.settings.start_index
        factor = self._timing.realtime_factor
        self._pace = Pace(factor, period_s) if factor else None
        super().start()
        self._received = -1
        self._silent: RunningTime | None = None  # since the newest voltage
        self._began_s = time.perf_counter()
        self._elapsed_s = 0.0
        self._held: NDArray[np.float64] | None = None
        if start_index >= 0:
            self._open()
        if self._demand:
            self._demand.start(max(start_index, 0), self._lookahead)
        if self._clock_writer:
            self._clock_writer.start(period_s)

    def make_element(self) -> Rig:
        """Return the rig as it was left, if it shall be kept, else one that was never driven."""
        if not self._history.keep_state:
            self._simulated = None
        known = self._simulated
        rig = self._present_rig()
        if rig is known:
            rig.drive(np.zeros(1))  # once driven, it rests at zero volts wherever that is
        self._saturated_before = rig.saturated_samples
        return rig

    def relayed(self) -> Rig | None:
        """Return the rig, unless each answer needs more than its mathematics."""
        is_bare = not (self._pace or self._demand)
        return self._simulated if self.settings.compiled and is_bare else None

    def beside(self, index: int) -> tuple[int, NDArray[np.float64]]:
        """Return the noise of the readings that answer the voltages from an index on."""
        rig = self._simulated
        return rig.noise_around(index) if rig else super().beside(index)

    def _present_rig(self) -> Rig:
        """Return the rig, a new one where its parameters have changed."""
        rig, period_s = self._simulated, self.settings.sample_period_s
        if rig is None or (rig.parameters, rig.sample_period_s, rig.is_compiled) != (
                self._rig, period_s, self.settings.compiled):
            rig = self._simulated = Rig(self._rig, period_s, compiled=self.settings.compiled)
            self._saturated_before = (0, 0)
        return rig

    def begin_at(self, index: int) -> None:
        """Open with the reading before the first voltage, whose index is known only now."""
        super().begin_at(index)
        self._open()

    def _open(self) -> None:
        """Send the reading before the first voltage."""
        rig = self._present_rig()
        rig.index = self.writer.next_index
        self.writer.publish_one(rig.measure())

    def poll(self) -> bool:
        """Answer what waits, or one block when its time has come."""
        return super().poll() if self._pace is None else self._poll_paced(self._pace)

    def answer(self, index: int, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the readings that voltages cause."""
        if self.writer.sent == 1:
            self._began_s = time.perf_counter()
        return super().answer(index, samples)

    def after_answer(self) -> None:
        """Ask for more voltages, where no controller does."""
        if self.reader.ended:
            self._elapsed_s = time.perf_counter() - self._began_s
        if self._demand:
            self._demand.update(self._index)

    def _poll_paced(self, pace: Pace) -> bool:
        """Answer one block when its time has come."""
        if self._held is None:
            self._held = self.reader.take_array()
            if self._held is None:
                return False
            self._due_s = pace.due_s(self._index, len(self._held), time.monotonic())
        left_s = self._due_s - time.monotonic()
        if left_s > 0.0 and self._held.size:
            # Everybody waits for this stage; none is kept waiting for longer than a nap.
            time.sleep(min(left_s, _NAP_S))
            if left_s > _NAP_S:
                return False
        samples, self._held = self._held, None
        if samples.size:
            index = self.reader.next_index - samples.size
            publish_blocks(self.writer, self.answer(index, samples), [samples.size])
        self.after_answer()
        if self.reader.ended:
            self.finish()
        return True

    def watch(self, now_s: float) -> None:
        """End the run when the voltage stays away; a killed peer leaves discovery only later."""
        if self.reader.received != self._received or self._held is not None:
            self._received = self.reader.received
            if self._received:
                self._silent = RunningTime()
        elif self._silent is not None and self._silent.elapsed_s() > self._safety.watchdog_s:
            raise StreamFault(
                f'no voltage for {self._safety.watchdog_s:g} s after sample '
                f'{self.reader.next_index - 1}')

    def has_waiting(self, reader: StreamReader) -> bool:
        """Return whether a paced plant has not come to what was sent yet."""
        return self._held is not None

    def parameters_changed(self) -> None:
        """Take over new limits of the watchdog and of the safe slew."""
        self._safety = read(self, SafetyParameters)
        self._history = read(self, HistoryParameters)

    def quiesce(self) -> None:
        """Ramp the voltage to zero deviation at the safe slew."""
        step_v = self._safety.safe_slew_v_per_s * self.settings.sample_period_s
        rig = self._simulated
        # What was asked for may lie far beyond the rails.
        voltage_v = rig.driven_v if rig else 0.0
        while rig and rig.commanded_v != 0.0:
            voltage_v -= math.copysign(min(step_v, abs(voltage_v)), voltage_v)
            rig.drive(np.array([voltage_v]))
        if self._clock_writer:
            self._clock_writer.stop()
        if self._demand:
            self._demand.end()

    def initialise(self) -> str:
        """Demagnetise the stage with a decaying triangle; the inverse assumes one without past."""
        if self.running:
            raise ServiceRefusedError('a run is going on; call ~/stop or deactivate first')
        if not self.is_configured:
            raise ServiceRefusedError('the node is not configured')
        self.between_samples(self._demagnetise)
        return (
            f'{self._history.initialise_levels} periods of a triangle, from '
            f'{self._initial_amplitude_v():g} V to 0 V')

    def _initial_amplitude_v(self) -> float:
        rig = self._rig
        reach_v = min(
            rig.operating_point_v - rig.voltage_minimum_v,
            rig.voltage_maximum_v - rig.operating_point_v)
        return self._history.initialise_amplitude_v or reach_v

    def _demagnetise(self) -> None:
        rig, period_s = self._present_rig(), self.settings.sample_period_s
        rig.drive(np.fromiter(demagnetising_voltage(
            self._initial_amplitude_v(), self._history.initialise_levels,
            self._safety.safe_slew_v_per_s, period_s), np.float64))
        rig.drive(np.zeros(round(_SETTLE_S / period_s)))

    def counts(self) -> dict[str, int]:
        """Return the counts of every stage, those of the pace, and of what the drive cannot do."""
        rig = self._simulated
        rail, slew = rig.saturated_samples if rig else (0, 0)
        return {
            **super().counts(), 'overruns': self._pace.overruns if self._pace else 0,
            'rail_samples': max(0, rail - self._saturated_before[0]),
            'slew_samples': max(0, slew - self._saturated_before[1])}

    def status_fields(self) -> dict[str, Any]:
        """Return the voltage that the rig is driven with and how long the run took."""
        counts = self.counts()
        return {
            'voltage_v': self._voltage_v, 'elapsed_s': self._elapsed_s,
            **{name: counts[name] for name in ('overruns', 'rail_samples', 'slew_samples')}}
