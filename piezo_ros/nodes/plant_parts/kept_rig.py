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

"""The simulated rig from run to run: driven, left, demagnetised, brought to rest."""

import math

import numpy as np

from piezo_ros.control.demagnetisation import demagnetising_voltage
from piezo_ros.model import Rig, RigParameters
from piezo_ros.parameters.node_parameters import HistoryParameters

__all__ = ['KeptRig']

_MOST_STEPS = 100_000  # of the ramp to zero, which nothing interrupts
_SETTLE_S = 0.02  # simulated time at zero after the last of the decaying triangle


class KeptRig:
    """
    Keeps a rig with its history as long as its parameters stay.

    Attributes
    ----------
    rig : Rig or None
        The rig, None before it is needed for the first time.

    """

    def __init__(self) -> None:
        self.rig: Rig | None = None
        self._saturated_before, self._average_before = (0, 0), 0

    def configure(
        self, parameters: RigParameters, sample_period_s: float, *, compiled: bool,
    ) -> None:
        """Take parameters over, for `present` to act on."""
        self._parameters = parameters
        self._period_s = sample_period_s
        self._is_compiled = compiled

    def present(self) -> Rig:
        """Return the rig, a new one where its parameters have changed."""
        rig, wanted = self.rig, (self._parameters, self._period_s, self._is_compiled)
        if rig is None or (rig.parameters, rig.sample_period_s, rig.is_compiled) != wanted:
            rig = self.rig = Rig(
                self._parameters, self._period_s, compiled=self._is_compiled)
            self._saturated_before, self._average_before = (0, 0), 0
        return rig

    def begin_run(self, *, keep_state: bool) -> Rig:
        """Return the rig as it was left, if it shall be kept, else one that was never driven."""
        if not keep_state:
            self.rig = None
        known = self.rig
        rig = self.present()
        if rig is known:
            rig.drive(np.zeros(1))  # once driven, it rests at zero volts wherever that is
        self._saturated_before = rig.saturated_samples
        self._average_before = rig.average_current_samples
        return rig

    @property
    def commanded_v(self) -> float:
        """The voltage that the rig is asked for."""
        return self.rig.commanded_v if self.rig else 0.0

    @property
    def saturated_samples(self) -> tuple[int, int]:
        """Number of samples of the run beyond the rails and beyond the slew limit."""
        rail, slew = self.rig.saturated_samples if self.rig else (0, 0)
        rail_before, slew_before = self._saturated_before
        return max(0, rail - rail_before), max(0, slew - slew_before)

    @property
    def average_current_samples(self) -> int:
        """Number of samples of the run beyond the average current."""
        whole = self.rig.average_current_samples if self.rig else 0
        return max(0, whole - self._average_before)

    def refusal(self, slew_v_per_s: float) -> str:
        """Return why the ramp to zero cannot have a slew: it would not end; '' if it can."""
        rig = self._parameters
        reach_v = max(
            rig.operating_point_v - rig.voltage_minimum_v,
            rig.voltage_maximum_v - rig.operating_point_v)
        least = reach_v / (_MOST_STEPS * self._period_s)
        if slew_v_per_s >= least:
            return ''
        return (
            f'safe_slew_v_per_s is {slew_v_per_s:g}; at a sample period of {self._period_s:g} s '
            f'the ramp of {reach_v:g} V to zero would have more than {_MOST_STEPS} samples, '
            f'it must be at least {least:g}')

    def come_to_rest(self, slew_v_per_s: float) -> None:
        """Ramp the voltage to zero deviation at a slew."""
        rig = self.rig
        if rig is None:
            return
        step_v = slew_v_per_s * self._period_s
        # What was asked for may lie far beyond the rails.
        voltage_v = rig.driven_v
        while rig.commanded_v != 0.0:
            voltage_v -= math.copysign(min(step_v, abs(voltage_v)), voltage_v)
            rig.drive(np.array([voltage_v]))

    def demagnetise(self, history: HistoryParameters, slew_v_per_s: float) -> None:
        """Drive a decaying triangle, and wait at zero."""
        rig = self.present()
        rig.drive(np.fromiter(demagnetising_voltage(
            self._amplitude_v(history), history.initialise_levels, slew_v_per_s,
            self._period_s), np.float64))
        rig.drive(np.zeros(round(_SETTLE_S / self._period_s)))

    def describe_triangle(self, history: HistoryParameters) -> str:
        """Return what `demagnetise` does in words."""
        return (
            f'{history.initialise_levels} periods of a triangle, from '
            f'{self._amplitude_v(history):g} V to 0 V')

    def _amplitude_v(self, history: HistoryParameters) -> float:
        """Return the first amplitude of the triangle: what is set, or all that the rails allow."""
        rig = self._parameters
        reach_v = min(
            rig.operating_point_v - rig.voltage_minimum_v,
            rig.voltage_maximum_v - rig.operating_point_v)
        return history.initialise_amplitude_v or reach_v
