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

"""
A linear plant under PI control: its frequency responses and its closed loop.

    L = K G,   K(s) = kP + kI/s, (8) in Liu 2015
    S = 1/(1 + L), (16),   T = L/(1 + L)

In a sampled loop K uses the backward rectangle rule, as the step of the controller does, G stands
behind a zero-order hold, and the measurement is d samples old. A lead section may stand before K,
(1 + s/wz)/(1 + s/wp), sampled as in the controller.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.control.controller_step import ControllerParameters, lead_coefficients
from piezo_ros.identification.tuning.linear_plant import LinearPlant, Model, SampledPlant
from piezo_ros.model.state_space import StateSpace, discretise_zero_order_hold

__all__ = ['Lead', 'PiLoop']

_POINTS = 1500
_LOWEST = 1e-3  # of the slowest rate of the loop
_HIGHEST = 1e2  # of the fastest pole, for a loop that is not sampled
_BELOW_NYQUIST = 1.0 - 1e-9
_RESONANCE_WIDTHS = np.linspace(-8.0, 8.0, 65)  # half widths around each resonance

_Floats = NDArray[np.float64]
_Complexes = NDArray[np.complex128]


class Lead(NamedTuple):
    """
    A lead section before the gains.

    Attributes
    ----------
    zero_hz, pole_hz : float
        Its zero, and its pole above that.

    """

    zero_hz: float
    pole_hz: float

    @classmethod
    def of(cls, parameters: ControllerParameters) -> 'Lead | None':
        """Return the lead of a controller, None without one."""
        if not parameters.lead_zero_hz:
            return None
        return cls(parameters.lead_zero_hz, parameters.lead_pole_hz)

    def response(
        self, frequency_hz: _Floats, sample_period_s: float | None,
    ) -> _Complexes:
        """Return its frequency response, sampled unless there is no sample period."""
        if sample_period_s is None:
            return (1.0 + 1j * frequency_hz / self.zero_hz) / (
                1.0 + 1j * frequency_hz / self.pole_hz)
        gain, zero, pole = lead_coefficients(self.zero_hz, self.pole_hz, sample_period_s)
        back = np.exp(-2j * np.pi * frequency_hz * sample_period_s)
        return np.asarray(gain * (1.0 - zero * back) / (1.0 - pole * back))


@dataclass(frozen=True)
class PiLoop:
    """
    A linear plant under PI control.

    Attributes
    ----------
    plant : LinearPlant
        The plant G(s).
    proportional_gain : float
        kP.
    integral_gain_per_s : float
        kI, 1/s.
    sampled_plant : SampledPlant or None
        The plant behind its hold; None for the continuous loop of the paper.
    measurement_delay_samples : int
        Age d of the measurement in e[k] = y_d[k] - y[k-d].
    lead : Lead or None
        Lead section before the gains.

    """

    plant: LinearPlant
    proportional_gain: float
    integral_gain_per_s: float
    sampled_plant: SampledPlant | None
    measurement_delay_samples: int
    lead: Lead | None = None

    def __post_init__(self) -> None:
        for name in ('proportional_gain', 'integral_gain_per_s'):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f'{name} is {value}, it must be finite and not below 0')
        if self.proportional_gain == self.integral_gain_per_s == 0.0:
            raise ValueError('both gains are 0, one at least must be above 0')
        if self.lead and not 0.0 < self.lead.zero_hz < self.lead.pole_hz < math.inf:
            raise ValueError(
                f'lead has its zero at {self.lead.zero_hz} Hz and its pole at {self.lead.pole_hz} '
                'Hz; both must be above 0 and the pole above the zero')
        if self.measurement_delay_samples < 0:
            raise ValueError(
                f'measurement_delay_samples is {self.measurement_delay_samples}, it must not be '
                'below 0')
        if self.sampled_plant is None:
            late = [
                f'{name} is {value}' for name, value in (
                    ('measurement_delay_samples', self.measurement_delay_samples),
                    ('delay_s of the model', self.plant.delay_s)) if value]
            if late:
                raise ValueError(
                    f'{" and ".join(late)}: a loop with delay needs its sample_period_s')

    @classmethod
    def of(
        cls, model: Model, proportional_gain: float, integral_gain_per_s: float,
        sample_period_s: float | None = None, measurement_delay_samples: int = 0,
        lead: Lead | None = None,
    ) -> 'PiLoop':
        """Return the loop around a linear model; see `loop_shape` for the parameters."""
        plant = LinearPlant.of(model)
        sampled = None if sample_period_s is None else plant.sampled(sample_period_s)
        return cls(
            plant, float(proportional_gain), float(integral_gain_per_s), sampled,
            measurement_delay_samples, lead)

    @property
    def sample_period_s(self) -> float | None:
        """Sample period, seconds; None for a continuous loop."""
        return None if self.sampled_plant is None else self.sampled_plant.sample_period_s

    def with_gains(self, proportional_gain: float, integral_gain_per_s: float) -> 'PiLoop':
        """Return a copy with other gains."""
        return replace(
            self, proportional_gain=proportional_gain, integral_gain_per_s=integral_gain_per_s)

    def plant_response(self, frequency_hz: ArrayLike) -> _Complexes:
        """Return G, sampled in a sampled loop, at frequencies in hertz."""
        if self.sampled_plant is None:
            return self.plant.response(frequency_hz)
        return self.sampled_plant.response(frequency_hz)

    def controller_response(self, frequency_hz: ArrayLike) -> _Complexes:
        """Return K, (8) in Liu 2015, and the lead, at frequencies in hertz above 0."""
        frequency = np.asarray(frequency_hz, dtype=np.float64)
        s = 2j * np.pi * frequency
        period_s = self.sample_period_s
        integral = 1.0 / s if period_s is None else period_s / -np.expm1(-s * period_s)
        response = np.asarray(self.proportional_gain + self.integral_gain_per_s * integral)
        return response * self.lead.response(frequency, period_s) if self.lead else response

    def measurement_response(self, frequency_hz: ArrayLike) -> _Complexes:
        """Return the delay of the measurement at frequencies in hertz."""
        delay_s = self.measurement_delay_samples * (self.sample_period_s or 0.0)
        return np.asarray(np.exp(
            -2j * np.pi * np.asarray(frequency_hz, dtype=np.float64) * delay_s))

    def loop(self, frequency_hz: ArrayLike) -> _Complexes:
        """Return L = K G and the delay of the measurement, at frequencies in hertz above 0."""
        return np.asarray(
            self.controller_response(frequency_hz) * self.plant_response(frequency_hz)
            * self.measurement_response(frequency_hz))

    def sensitivity(self, frequency_hz: ArrayLike) -> _Complexes:
        """Return S, (16) in Liu 2015, at frequencies in hertz above 0."""
        return np.asarray(1.0 / (1.0 + self.loop(frequency_hz)))

    def complementary(self, frequency_hz: ArrayLike) -> _Complexes:
        """Return T = L/(1 + L) at frequencies in hertz above 0."""
        loop = self.loop(frequency_hz)
        return np.asarray(loop / (1.0 + loop))

    def frequencies_hz(self) -> _Floats:
        """Return a grid from below the slowest rate to above the fastest, dense at resonances."""
        poles = self.plant.poles_rad_per_s
        rates = np.abs(poles)
        rates = rates[rates > 0.0]
        crossover = self.integral_gain_per_s * abs(self.plant.dc_gain)  # of a slow integral loop
        slowest = min([*rates, crossover] if 0.0 < crossover < math.inf else rates)
        if self.sample_period_s is None:
            highest_hz = _HIGHEST * float(rates.max()) / (2.0 * np.pi)
        else:
            highest_hz = 0.5 / self.sample_period_s * _BELOW_NYQUIST
        lowest_hz = min(_LOWEST * slowest / (2.0 * np.pi), 0.5 * highest_hz)
        grids = [np.geomspace(lowest_hz, highest_hz, _POINTS)]
        grids += [
            (abs(pole.imag) + abs(pole.real) * _RESONANCE_WIDTHS) / (2.0 * np.pi)
            for pole in poles if pole.imag > 0.0]
        grid = np.unique(np.concatenate(grids))
        return np.asarray(grid[(grid >= lowest_hz) & (grid <= highest_hz)])

    def error_system(self, step_s: float) -> StateSpace:
        """
        Return the discrete system y_d[k] -> y_d[k] - y[k] of the closed loop.

        Parameters
        ----------
        step_s : float
            Step of a continuous loop, in which the reference is held, seconds; not used for a
            sampled loop.

        Returns
        -------
        StateSpace
            It is stable if and only if the loop is.

        """
        if self.sampled_plant is None:
            return discretise_zero_order_hold(self._continuous_error_system(), step_s)
        a, b, c, _ = self.sampled_plant.system
        order = a.shape[0]
        period_s = self.sampled_plant.sample_period_s
        plant_delay = self.sampled_plant.delay_samples
        delay = plant_delay + self.measurement_delay_samples
        # States: plant, outputs y[k-1] … y[k-delay] before the delay of the plant, lead, integral.
        size = order + delay + bool(self.lead) + 1
        output, measured = np.zeros((1, size)), np.zeros((1, size))
        for row, age in ((output, plant_delay), (measured, delay)):
            if age:
                row[0, order + age - 1] = 1.0
            else:
                row[0, :order] = c[0]
        integral = np.zeros((1, size))
        integral[0, -1] = 1.0
        increment = self.integral_gain_per_s * period_s
        gain = self.proportional_gain + increment
        transition, entry = np.zeros((size, size)), np.zeros((size, 1))
        # The error behind the lead: led_gain (y_d - measured) + remembered.
        led_gain, remembered = 1.0, np.zeros((1, size))
        if self.lead:
            led_gain, zero, pole = lead_coefficients(*self.lead, period_s)
            remembered[0, -2] = 1.0
            transition[-2:-1] = pole * remembered - led_gain * (pole - zero) * measured
            entry[-2] = led_gain * (pole - zero)
        acting = remembered - led_gain * measured
        transition[:order, :order] = a
        transition[:order] += b @ (integral + gain * acting)
        entry[:order] = led_gain * gain * b
        if delay:
            transition[order, :order] = c[0]
            transition[order + 1:order + delay, order:order + delay - 1] = np.eye(delay - 1)
        transition[-1:] = integral + increment * acting
        entry[-1] = led_gain * increment
        return StateSpace(transition, entry, -output, np.ones((1, 1)))

    def _continuous_error_system(self) -> StateSpace:
        a, b, c, _ = self.plant.state_space
        order = a.shape[0]
        size = order + bool(self.lead) + 1
        whole, entry = np.zeros((size, size)), np.zeros((size, 1))
        output = np.zeros((1, size))
        output[:, :order] = c
        led_gain, acting = 1.0, -output
        if self.lead:
            # (1 + s/wz)/(1 + s/wp) = r + (1 - r)/(1 + s/wp), r = wp/wz
            led_gain = self.lead.pole_hz / self.lead.zero_hz
            rate = 2.0 * np.pi * self.lead.pole_hz
            whole[order] = -rate * output[0]
            whole[order, order] = -rate
            entry[order] = rate
            acting = -led_gain * output
            acting[0, order] = 1.0 - led_gain
        whole[:order, :order] = a
        whole[:order] += self.proportional_gain * (b @ acting)
        whole[:order, -1:] += b
        whole[-1:] = self.integral_gain_per_s * acting
        entry[:order] = led_gain * self.proportional_gain * b
        entry[-1] = led_gain * self.integral_gain_per_s
        return StateSpace(whole, entry, -output, np.ones((1, 1)))

    def slowest_decay(self, step_s: float) -> float:
        """
        Return the factor per step of the slowest mode of the closed loop; stable below 1.

        Parameters
        ----------
        step_s : float
            As for `error_system`.

        """
        sampled = self.sampled_plant is not None
        transition = (self.error_system(step_s) if sampled else self._continuous_error_system()).a
        if self.integral_gain_per_s == 0.0:
            # Without integral action the state of the integral stays 0: its mode does not count.
            transition = transition[:-1, :-1]
        eigenvalues = np.linalg.eigvals(transition)
        if sampled:
            return float(np.max(np.abs(eigenvalues)))
        return math.exp(float(np.max(eigenvalues.real)) * step_s)

    @property
    def is_stable(self) -> bool:
        """Whether the closed loop is stable."""
        rates = np.abs(self.plant.poles_rad_per_s)
        return self.slowest_decay(1.0 / float(rates.max())) < 1.0
