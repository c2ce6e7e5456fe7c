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

import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros.model import ParameterError, Rig, RigParameters
from piezo_ros.nodes.demand import DemandWriter
from piezo_ros.nodes.plant_parts.kept_rig import KeptRig
from piezo_ros.nodes.plant_parts.pace import Pace
from piezo_ros.nodes.plant_parts.paced_block import PacedBlock
from piezo_ros.nodes.plant_parts.simulated_clock import SimulatedClock
from piezo_ros.nodes.plant_parts.watchdog import Watchdog
from piezo_ros.parameters.node_parameters import (
    BareParameters,
    HistoryParameters,
    PaceParameters,
    SafetyParameters,
)
from piezo_ros.runtime.node.answering import AnsweringNode
from piezo_ros.runtime.node.declared_parameters import read
from piezo_ros.runtime.streams.stream_reader import StreamReader

__all__ = ['Plant']

_SATURATIONS = ('rail_samples', 'slew_samples', 'average_current_samples')


class Plant(AnsweringNode):
    """Answers u[k … k+N-1] with y[k+1 … k+N]; opens with y[0]."""

    inputs = ('voltage',)
    outputs = ('displacement',)
    troubles = (*AnsweringNode.troubles, 'overruns', *_SATURATIONS)

    def __init__(self, *, compiled: bool = False) -> None:
        self._kept = KeptRig()
        self._paced: PacedBlock | None = None
        self._elapsed_s = 0.0
        super().__init__('plant', compiled=compiled)
        self.create_trigger('initialise', self.initialise)

    def configure(self) -> None:
        """Read the parameters of the rig."""
        self._kept.configure(
            read(self, RigParameters), self.settings.sample_period_s,
            compiled=self.settings.compiled)
        self._safety = read(self, SafetyParameters)
        if refusal := self._kept.refusal(self._safety.safe_slew_v_per_s):
            raise ParameterError(refusal)
        self._history = read(self, HistoryParameters)
        self._timing = read(self, PaceParameters)
        self._lookahead = read(self, BareParameters).demand_lookahead_samples

    def create_endpoints(self) -> None:
        """Create the publisher of the demand, where no controller demands, and of the clock."""
        self._demand = DemandWriter(self) if self._lookahead else None
        readings = self.writers['displacement']
        self._clock_writer = (
            SimulatedClock(self, readings) if self._timing.publish_clock else None)

    def start(self) -> None:
        """Put the rig to rest at its operating point and send its first reading."""
        period_s, start_index = self.settings.sample_period_s, self.settings.start_index
        voltage, factor = self.readers['voltage'], self._timing.realtime_factor
        self._paced = PacedBlock(voltage, Pace(factor, period_s)) if factor else None
        super().start()
        self._watchdog = Watchdog(voltage)
        self._began_s = time.perf_counter()
        self._elapsed_s = 0.0
        if start_index >= 0:
            self._open()
        if self._demand:
            self._demand.start(max(start_index, 0), self._lookahead)
        if self._clock_writer:
            self._clock_writer.start(period_s)

    def make_element(self) -> Rig:
        """Return the rig as it was left, if it shall be kept, else one that was never driven."""
        return self._kept.begin_run(keep_state=self._history.keep_state)

    def relayed(self) -> Rig | None:
        """Return the rig, unless each answer needs more than its mathematics."""
        is_bare = not (self._paced or self._demand)
        return self._kept.rig if self.settings.compiled and is_bare else None

    def beside(self, index: int) -> tuple[int, NDArray[np.float64]]:
        """Return the noise of the readings that answer the voltages from an index on."""
        rig = self._kept.rig
        return rig.noise_around(index) if rig else super().beside(index)

    def begin_at(self, index: int) -> None:
        """Open with the reading before the first voltage, the index of which is known only now."""
        super().begin_at(index)
        self._open()

    def _open(self) -> None:
        """Send the reading before the first voltage."""
        rig = self._kept.present()
        rig.index = self.writer.next_index
        self.writer.publish_one(rig.measure())

    def poll(self) -> bool:
        """Answer what waits, or one block when its time has come."""
        if self._paced is None:
            return super().poll()
        samples = self._paced.take(self.writer.newest_index)
        if samples is None:
            return False
        if samples.size:
            index = self.reader.next_index - samples.size
            self.writer.publish(self.answer(index, samples))
        self.after_answer()
        if self.reader.ended:
            self.finish()
        return True

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
            self._demand.update(self.writer.newest_index)

    def watch(self, now_s: float) -> None:
        """End the run when the voltage stays away."""
        self._watchdog.check(self._safety.watchdog_s, is_waiting=self.has_waiting(self.reader))

    def has_waiting(self, reader: StreamReader) -> bool:
        """Return whether a paced plant has not come to what was sent yet."""
        return self._paced is not None and self._paced.is_waiting

    def change_parameters(self, changes: Mapping[str, Any]) -> str:
        """Refuse a slew at which the ramp to zero would not end."""
        slew_v_per_s = changes.get('safe_slew_v_per_s')
        return self._kept.refusal(slew_v_per_s) if slew_v_per_s and self.is_configured else ''

    def parameters_changed(self) -> None:
        """Take over new limits of the watchdog and of the safe slew."""
        self._safety = read(self, SafetyParameters)
        self._history = read(self, HistoryParameters)

    def quiesce(self) -> None:
        """Ramp the voltage to zero deviation at the safe slew."""
        self._kept.come_to_rest(self._safety.safe_slew_v_per_s)
        if self._clock_writer:
            self._clock_writer.stop()
        if self._demand:
            self._demand.end()

    def initialise(self) -> str:
        """Demagnetise the stage with a decaying triangle; the inverse assumes one without past."""
        self.requests.between_runs(
            lambda: self._kept.demagnetise(self._history, self._safety.safe_slew_v_per_s))
        return self._kept.describe_triangle(self._history)

    def counts(self) -> dict[str, int]:
        """Return the counts of every node, those of the pace, and of what the drive cannot do."""
        rail, slew = self._kept.saturated_samples
        return {
            **super().counts(), 'overruns': self._paced.overruns if self._paced else 0,
            'rail_samples': rail, 'slew_samples': slew,
            'average_current_samples': self._kept.average_current_samples}

    def status_fields(self) -> dict[str, Any]:
        """Return the voltage that the rig is driven with and how long the run took."""
        told = ('overruns', *_SATURATIONS)
        return {
            'voltage_v': self._kept.commanded_v, 'elapsed_s': self._elapsed_s,
            **{name: count for name, count in self.counts().items() if name in told}}
