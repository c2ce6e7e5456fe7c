"""The simulated rig: voltage in, measured displacement out. It alone owns the voltage."""

import math
import time
from typing import Any

from piezo_ros.experiment.node_parameters import SafetyParameters
from piezo_ros.model.noise import NoiseSource
from piezo_ros.model.rig import (
    RigParameters,
    initial_state,
    measure_step,
    rig_constants,
    rig_step,
)
from piezo_ros.nodes.parameters import read
from piezo_ros.nodes.stage import Stage
from piezo_ros.nodes.streams import StreamFault

__all__ = ['Plant']


class Plant(Stage):
    """Answers u[k … k+N-1] with y[k+1 … k+N]; opens with y[0]."""

    inputs = ('voltage',)
    outputs = ('displacement',)

    def __init__(self) -> None:
        self._voltage_v = 0.0
        self._elapsed_s = 0.0
        super().__init__('plant')

    def configure(self) -> None:
        """Make the constants of the rig."""
        self._rig = read(self, RigParameters)
        self._safety = read(self, SafetyParameters)
        self._constants = rig_constants(self._rig, self.settings.sample_period_s)

    def start(self) -> None:
        """Put the rig to rest at its operating point and send its first reading."""
        self._rig_state = initial_state(self._constants)
        self._noise = NoiseSource(self._rig.seed)
        self._voltage = self.readers['voltage']
        self._displacement = self.writers['displacement']
        self._voltage_v = 0.0
        self._received = -1
        self._received_at_s = math.inf
        self._began_s = time.perf_counter()
        self._elapsed_s = 0.0
        first = max(self.settings.start_index, 0)
        self._index = self._first = first
        self._displacement.publish_one(measure_step(self._constants, 0.0, self._noise(first)))

    def poll(self) -> bool:
        """Answer one block."""
        block = self._voltage.take()
        if block is None:
            return False
        if block.index == self._first:
            self._began_s = time.perf_counter()
        samples = block.samples
        if len(samples) == 1:
            self._displacement.publish_one(self._hold(samples[0]))
        elif samples:
            self._displacement.publish([self._hold(sample) for sample in samples])
        else:
            self._elapsed_s = time.perf_counter() - self._began_s
            self.finish()
        return True

    def _hold(self, voltage_v: float) -> float:
        self._voltage_v = voltage_v
        self._index += 1
        true_um = rig_step(self._rig_state, self._constants, voltage_v)
        return measure_step(self._constants, true_um, self._noise(self._index))

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

    def quiesce(self) -> None:
        """Ramp the voltage to zero deviation at the safe slew."""
        step_v = self._safety.safe_slew_v_per_s * self.settings.sample_period_s
        while self._voltage_v != 0.0:
            if abs(self._voltage_v) <= step_v:
                self._voltage_v = 0.0
            else:
                self._voltage_v -= math.copysign(step_v, self._voltage_v)
            rig_step(self._rig_state, self._constants, self._voltage_v)

    def status_fields(self) -> dict[str, Any]:
        """Return the voltage that the rig is driven with and how long the run took."""
        return {'voltage_v': self._voltage_v, 'elapsed_s': self._elapsed_s}
