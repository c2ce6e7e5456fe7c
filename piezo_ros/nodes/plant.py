"""The simulated rig: voltage in, measured displacement out. It alone owns the voltage."""

import math
import time
from typing import Any

from piezo_ros.experiment.node_parameters import BareParameters, SafetyParameters
from piezo_ros.model.noise import NoiseSource
from piezo_ros.model.rig import RigParameters, measure_step, rig_constants
from piezo_ros.model.stepping import rig_stepper
from piezo_ros.nodes.demand import DemandWriter
from piezo_ros.nodes.parameters import read
from piezo_ros.nodes.stage import Stage
from piezo_ros.nodes.streams import StreamFault

__all__ = ['Plant']


class Plant(Stage):
    """Answers u[k … k+N-1] with y[k+1 … k+N]; opens with y[0]."""

    inputs = ('voltage',)
    outputs = ('displacement',)

    def __init__(self, *, compiled: bool = False) -> None:
        self._voltage_v = 0.0
        self._elapsed_s = 0.0
        super().__init__('plant', compiled=compiled)

    def configure(self) -> None:
        """Read the parameters of the rig."""
        self._rig = read(self, RigParameters)
        self._safety = read(self, SafetyParameters)
        self._lookahead = read(self, BareParameters).demand_lookahead_samples

    def create_endpoints(self) -> None:
        """Create the publisher of the demand, where there is no controller to demand."""
        if self._lookahead:
            self.demand = DemandWriter(self, self._lookahead)

    def start(self) -> None:
        """Put the rig to rest at its operating point and send its first reading."""
        period_s = self.settings.sample_period_s
        self._hold = rig_stepper(self._rig, period_s, compiled=self.settings.compiled)
        self._noise = NoiseSource(self._rig.seed)
        self._voltage = self.readers['voltage']
        self._displacement = self.writers['displacement']
        self._voltage_v = 0.0
        self._received = -1
        self._received_at_s = math.inf
        self._began_s = time.perf_counter()
        self._elapsed_s = 0.0
        first = max(self.settings.start_index, 0)
        self._index = first
        self._displacement.publish_one(
            measure_step(rig_constants(self._rig, period_s), 0.0, self._noise(first)))
        if self._lookahead:
            self.demand.start(self._index)

    def poll(self) -> bool:
        """Answer one block."""
        samples = self._voltage.take()
        if samples is None:
            return False
        if self._displacement.sent == 1:
            self._began_s = time.perf_counter()
        if len(samples) == 1:
            self._index += 1
            self._voltage_v = samples[0]
            self._displacement.publish_one(self._hold(samples[0], self._noise(self._index)))
        elif samples:
            self._displacement.publish([
                self._hold(sample, self._noise(index))
                for index, sample in enumerate(samples, start=self._index + 1)])
            self._index += len(samples)
            self._voltage_v = samples[-1]
        else:
            self._elapsed_s = time.perf_counter() - self._began_s
            self.finish()
        if self._lookahead:
            self.demand.update(self._index)
        return True

    def watch(self, now_s: float) -> None:
        """End the run when the voltage stays away; a killed peer leaves discovery only later."""
        if self._voltage.received != self._received:
            self._received = self._voltage.received
            if self._received:
                self._received_at_s = now_s
        elif now_s - self._received_at_s > self._safety.watchdog_s:
            raise StreamFault(
                f'no voltage for {self._safety.watchdog_s:g} s after sample '
                f'{self._voltage.next_index - 1}')

    def parameters_changed(self) -> None:
        """Take over new limits of the watchdog and of the safe slew."""
        self._safety = read(self, SafetyParameters)

    def quiesce(self) -> None:
        """Ramp the voltage to zero deviation at the safe slew."""
        step_v = self._safety.safe_slew_v_per_s * self.settings.sample_period_s
        while self._voltage_v != 0.0:
            if abs(self._voltage_v) <= step_v:
                self._voltage_v = 0.0
            else:
                self._voltage_v -= math.copysign(step_v, self._voltage_v)
            self._hold(self._voltage_v, 0.0)

    def status_fields(self) -> dict[str, Any]:
        """Return the voltage that the rig is driven with and how long the run took."""
        return {'voltage_v': self._voltage_v, 'elapsed_s': self._elapsed_s}
