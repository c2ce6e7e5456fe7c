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
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.demagnetisation import demagnetising_voltage
from piezo_ros.model.noise import NoiseSource
from piezo_ros.model.rig import RigParameters, measure_step, rig_constants
from piezo_ros.model.stepping import packed_memory, rig_stepper, saturated_samples
from piezo_ros.nodes.bursts import answer_burst, publish_blocks
from piezo_ros.nodes.demand import DemandWriter
from piezo_ros.nodes.pace import Pace
from piezo_ros.nodes.parameters import read
from piezo_ros.nodes.running_time import RunningTime
from piezo_ros.nodes.simulated_clock import SimulatedClock
from piezo_ros.nodes.stage import Stage
from piezo_ros.nodes.stream_node import ServiceRefusedError
from piezo_ros.nodes.streams import StreamFault, StreamReader
from piezo_ros.parameters.node_parameters import (
    BareParameters,
    HistoryParameters,
    PaceParameters,
    SafetyParameters,
)

if TYPE_CHECKING:
    from piezo_ros.nodes.relay import Relay

__all__ = ['Plant']

_SETTLE_S = 0.02  # simulated time at zero after the last of the decaying triangle
_NAP_S = 0.005  # a paced plant sleeps so long at once, and then looks whether it shall stop


class Plant(Stage):
    """Answers u[k … k+N-1] with y[k+1 … k+N]; opens with y[0]."""

    inputs = ('voltage',)
    outputs = ('displacement',)
    troubles = (*Stage.troubles, 'overruns', 'rail_samples', 'slew_samples')

    def __init__(self, *, compiled: bool = False) -> None:
        self._held_v = np.zeros(1)
        self._elapsed_s = 0.0
        self._stage_of: tuple[Any, ...] = ()  # what the stage that is kept was made of
        self._saturated_before = (0, 0)
        self._pace: Pace | None = None
        self._clock_writer: SimulatedClock | None = None
        super().__init__('plant', compiled=compiled)
        self.create_trigger('initialise', self.initialise)

    @property
    def _index(self) -> int:
        """Index of the newest reading, 0 before the first."""
        displacement = self.writers.get('displacement')
        return max(displacement.next_index - 1, 0) if displacement else 0

    @property
    def _voltage_v(self) -> float:
        """The voltage that the rig is driven with."""
        return float(self._held_v[0])

    @_voltage_v.setter
    def _voltage_v(self, value: float) -> None:
        self._held_v[0] = value

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
        self._kept = self._history.keep_state and self._has_stage()
        if not self._kept:
            self._make_stage()
        self._saturated_before = saturated_samples(self._hold)
        self._noise = NoiseSource(self._rig.seed)
        self._voltage = self.readers['voltage']
        self._displacement = self.writers['displacement']
        self._voltage_v = 0.0
        self._received = -1
        self._silent: RunningTime | None = None  # since the newest voltage
        self._began_s = time.perf_counter()
        self._elapsed_s = 0.0
        factor = self._timing.realtime_factor
        self._pace = Pace(factor, period_s) if factor else None
        self._held: NDArray[np.float64] | None = None
        self._relay = (
            self._make_relay() if self.settings.compiled and not (factor or self._demand) else None)
        if start_index >= 0:
            self._open()
        if self._demand:
            self._demand.start(max(start_index, 0), self._lookahead)
        if self._clock_writer:
            self._clock_writer.start(period_s)

    def _has_stage(self) -> bool:
        return self._stage_of == (
            self._rig, self.settings.sample_period_s, self.settings.compiled)

    def _make_stage(self) -> None:
        self._hold = rig_stepper(
            self._rig, self.settings.sample_period_s, compiled=self.settings.compiled)
        self._creeps = rig_constants(self._rig, self.settings.sample_period_s).creep is not None
        self._saturated_before = (0, 0)
        # Last: diagnostics may ask meanwhile.
        self._stage_of = (self._rig, self.settings.sample_period_s, self.settings.compiled)

    def _make_relay(self) -> 'Relay':
        from piezo_ros.bag.relay_kernels import relay_rig
        from piezo_ros.nodes.relay import Relay
        relay = Relay(self, self._voltage, self._displacement, relay_rig, self._poll_other)
        self._bind(relay)  # what must be compiled or loaded is so before the first sample
        return relay

    def begin_at(self, index: int) -> None:
        """Open with the reading before the first voltage, whose index is known only now."""
        super().begin_at(index)
        self._open()

    def _open(self) -> None:
        """Send the reading before the first voltage."""
        noise = self._noise(self._displacement.next_index)
        # A stage that has been driven rests at zero volts, wherever that is.
        self._displacement.publish_one(
            self._hold(0.0, noise) if self._kept else measure_step(
                rig_constants(self._rig, self.settings.sample_period_s), 0.0, noise))

    def poll(self) -> bool:
        """Answer one block."""
        if self._pace is not None:
            return self._poll_paced(self._pace)
        sample = self._voltage.take_one()
        if sample is None:
            return self._poll_other()
        self.in_blocks = False
        self._answer_one(sample)
        if self._relay:
            self._lend(self._relay)
        return True

    def _lend(self, relay: 'Relay') -> None:
        """Let the relay go on as far as there is noise at hand."""
        self._bind(relay)
        self.quick = relay.look

    def _bind(self, relay: 'Relay') -> None:
        window = self._noise.window(self._displacement.next_index)
        relay.bind(packed_memory(self._hold), self._held_v, int(self._creeps), *window)

    def _poll_other(self) -> bool:
        # At the end of its noise the relay cannot go on either.
        self.quick = self.look
        return bool(self._voltage.raw) and self._answer_waiting()

    def _answer_one(self, sample: float) -> None:
        self._voltage_v = sample
        index = self._displacement.next_index
        self._displacement.publish_one(self._hold(sample, self._noise(index)))
        if self._demand:
            self._demand.update(index)

    def _answer_waiting(self) -> bool:
        """Answer the block at hand and those that wait; return whether there was anything."""
        longest = answer_burst(self._voltage, self._displacement, self._hold_block)
        if longest:
            self.in_blocks = longest > 1
        elif not self._voltage.ended:
            return False
        self._after_block()
        return True

    def _after_block(self) -> None:
        if self._voltage.ended:
            self._elapsed_s = time.perf_counter() - self._began_s
            self.finish()
        if self._demand:
            self._demand.update(self._index)

    def _hold_block(self, voltage_v: NDArray[np.float64]) -> list[float] | NDArray[np.float64]:
        if self._displacement.sent == 1:
            self._began_s = time.perf_counter()  # the first block never comes by `take_one`
        self._voltage_v = voltage_v[-1]
        noise = self._noise.block(self._displacement.next_index, voltage_v.size)
        if not self.settings.compiled:
            return [
                self._hold(voltage, unit) for voltage, unit in
                zip(voltage_v.tolist(), noise.tolist(), strict=True)]
        from piezo_ros.model.kernels import hold_packed_array, hold_packed_creeping_array
        displacement_um = np.empty_like(voltage_v)
        (hold_packed_creeping_array if self._creeps else hold_packed_array)(
            packed_memory(self._hold), voltage_v, noise, displacement_um)
        return displacement_um

    def _poll_paced(self, pace: Pace) -> bool:
        """Answer one block when its time has come."""
        if self._held is None:
            self._held = self._voltage.take_array()
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
            publish_blocks(self._displacement, self._hold_block(samples), [samples.size])
        self._after_block()
        return True

    def watch(self, now_s: float) -> None:
        """End the run when the voltage stays away; a killed peer leaves discovery only later."""
        if self._voltage.received != self._received or self._held is not None:
            self._received = self._voltage.received
            if self._received:
                self._silent = RunningTime()
        elif self._silent is not None and self._silent.elapsed_s() > self._safety.watchdog_s:
            raise StreamFault(
                f'no voltage for {self._safety.watchdog_s:g} s after sample '
                f'{self._voltage.next_index - 1}')

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
        while self._voltage_v != 0.0:
            if abs(self._voltage_v) <= step_v:
                self._voltage_v = 0.0
            else:
                self._voltage_v -= math.copysign(step_v, self._voltage_v)
            self._hold(self._voltage_v, 0.0)
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
        if not self._has_stage():
            self._make_stage()
        period_s = self.settings.sample_period_s
        for voltage_v in demagnetising_voltage(
            self._initial_amplitude_v(), self._history.initialise_levels,
            self._safety.safe_slew_v_per_s, period_s,
        ):
            self._hold(voltage_v, 0.0)
        for _ in range(round(_SETTLE_S / period_s)):
            self._hold(0.0, 0.0)

    def counts(self) -> dict[str, int]:
        """Return the counts of every stage, those of the pace, and of what the drive cannot do."""
        rail, slew = saturated_samples(self._hold) if self._stage_of else (0, 0)
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
