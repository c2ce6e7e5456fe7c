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
The shape of the feedback loop: sensitivity, margins, bandwidth, robustness.

    L = K G;   S = 1/(1 + L), (16) in Liu 2015;   T = L/(1 + L);   accepted when |W T| < 1, (10)

with K(s) = kP + kI/s, (8). A sampled loop is what the controller's step does: the backward
rectangle rule for the integral, G behind a zero-order hold, a measurement that is some samples old.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq, minimize_scalar

from piezo_ros.identification.linear_plant import (
    Bound,
    LinearPlant,
    Model,
    SampledPlant,
    bound_magnitude,
)
from piezo_ros.model.state_space import StateSpace, discretise_zero_order_hold

__all__ = ['LoopShape', 'PiLoop', 'loop_shape']

_POINTS = 1500
_LOWEST = 1e-3  # of the slowest rate of the loop
_HIGHEST = 1e2  # of the fastest pole, for a loop that is not sampled
_BELOW_NYQUIST = 1.0 - 1e-9
_RESONANCE_WIDTHS = np.linspace(-8.0, 8.0, 65)  # half widths around each resonance
_HALF_POWER = math.sqrt(0.5)

_Floats = NDArray[np.float64]
_Complexes = NDArray[np.complex128]


@dataclass(frozen=True)
class PiLoop:
    """
    A linear plant under PI control.

    Attributes
    ----------
    plant : LinearPlant
        G(s).
    proportional_gain : float
        kP.
    integral_gain_per_s : float
        kI, 1/s.
    sampled_plant : SampledPlant or None
        The plant behind its hold; None for the continuous loop of the paper.
    measurement_delay_samples : int
        Age d of the measurement in e[k] = y_d[k] - y[k-d].

    """

    plant: LinearPlant
    proportional_gain: float
    integral_gain_per_s: float
    sampled_plant: SampledPlant | None
    measurement_delay_samples: int

    def __post_init__(self) -> None:
        for name in ('proportional_gain', 'integral_gain_per_s'):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f'{name} is {value}, it must be finite and not below 0')
        if self.proportional_gain == self.integral_gain_per_s == 0.0:
            raise ValueError('both gains are 0, one at least must be above 0')
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
    ) -> 'PiLoop':
        """Return the loop around any linear model; see `loop_shape` for the parameters."""
        plant = LinearPlant.of(model)
        sampled = None if sample_period_s is None else plant.sampled(sample_period_s)
        return cls(
            plant, float(proportional_gain), float(integral_gain_per_s), sampled,
            measurement_delay_samples)

    @property
    def sample_period_s(self) -> float | None:
        """Sample period, seconds; None for a continuous loop."""
        return None if self.sampled_plant is None else self.sampled_plant.sample_period_s

    def with_gains(self, proportional_gain: float, integral_gain_per_s: float) -> 'PiLoop':
        """Return the same loop with other gains."""
        return replace(
            self, proportional_gain=proportional_gain, integral_gain_per_s=integral_gain_per_s)

    def plant_response(self, frequency_hz: ArrayLike) -> _Complexes:
        """Return G, sampled in a sampled loop, at frequencies in hertz."""
        if self.sampled_plant is None:
            return self.plant.response(frequency_hz)
        return self.sampled_plant.response(frequency_hz)

    def controller_response(self, frequency_hz: ArrayLike) -> _Complexes:
        """Return K, (8) in Liu 2015, at frequencies in hertz above 0."""
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
        period_s = self.sample_period_s
        integral = 1.0 / s if period_s is None else period_s / -np.expm1(-s * period_s)
        return np.asarray(self.proportional_gain + self.integral_gain_per_s * integral)

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
        """Return frequencies from below the slowest rate to the fastest, dense at resonances."""
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
            Step of a continuous loop, whose reference is held in between, seconds; a sampled loop
            has its own.

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
        # States: plant, outputs y[k-1] … y[k-delay] before the plant's own delay, integral.
        size = order + delay + 1
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
        transition[:order, :order] = a
        transition[:order] += b @ (integral - gain * measured)
        entry[:order] = gain * b
        if delay:
            transition[order, :order] = c[0]
            transition[order + 1:order + delay, order:order + delay - 1] = np.eye(delay - 1)
        transition[-1:] = integral - increment * measured
        entry[-1] = increment
        return StateSpace(transition, entry, -output, np.ones((1, 1)))

    def _continuous_error_system(self) -> StateSpace:
        a, b, c, _ = self.plant.state_space
        order = a.shape[0]
        whole = np.zeros((order + 1, order + 1))
        whole[:order, :order] = a - self.proportional_gain * (b @ c)
        whole[:order, order:] = b
        whole[order:, :order] = -self.integral_gain_per_s * c
        entry = np.vstack([self.proportional_gain * b, [[self.integral_gain_per_s]]])
        output = np.hstack([-c, [[0.0]]])
        return StateSpace(whole, entry, output, np.ones((1, 1)))

    def slowest_decay(self, step_s: float) -> float:
        """
        Return by how much the slowest mode of the closed loop shrinks in a step, stable below 1.

        Parameters
        ----------
        step_s : float
            As for `error_system`.

        """
        sampled = self.sampled_plant is not None
        transition = (self.error_system(step_s) if sampled else self._continuous_error_system()).a
        if self.integral_gain_per_s == 0.0:
            # What nothing is ever added to decides nothing.
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


@dataclass(frozen=True)
class LoopShape:
    """
    What there is to say of a loop.

    Attributes
    ----------
    loop : PiLoop
        Plant and gains.
    stable : bool
        Whether the closed loop is stable; margins mean nothing where it is not.
    gain_margin : float
        Factor by which the gain may rise; infinite where the phase never crosses -180 degrees.
    phase_margin_deg : float
        Distance of the phase from -180 degrees where |L| = 1; infinite where it never is.
    delay_margin_s : float
        Further delay that the loop bears, seconds.
    crossover_frequency_hz : float
        Highest frequency at which |L| = 1; 0 where it never is.
    feedback_acceptable_frequency_hz : float
        Where |S| first exceeds 1: below it feedback lessens the error of a sine, (18) in Liu 2015.
    bandwidth_hz : float
        Where |T| first falls 3 dB below its value at low frequencies.
    max_sensitivity, max_sensitivity_frequency_hz : float
        Largest |S| and where.
    weighted_peak : float or None
        Largest |W T|, (10) in Liu 2015; None without a bound W.
    frequency_hz : ndarray, shape (N,)
        Frequencies for plots of `loop`'s responses, hertz.

    """

    loop: PiLoop
    stable: bool
    gain_margin: float
    phase_margin_deg: float
    delay_margin_s: float
    crossover_frequency_hz: float
    feedback_acceptable_frequency_hz: float
    bandwidth_hz: float
    max_sensitivity: float
    max_sensitivity_frequency_hz: float
    weighted_peak: float | None
    frequency_hz: _Floats = field(repr=False, compare=False)

    @property
    def gain_margin_db(self) -> float:
        """The gain margin in decibels."""
        return 20.0 * math.log10(self.gain_margin) if self.gain_margin < math.inf else math.inf

    def record(self) -> dict[str, float | bool | None]:
        """Return every scalar under its name, for report.json; None for what is not finite."""
        names = (
            'stable', 'gain_margin', 'phase_margin_deg', 'delay_margin_s',
            'crossover_frequency_hz', 'feedback_acceptable_frequency_hz', 'bandwidth_hz',
            'max_sensitivity', 'max_sensitivity_frequency_hz', 'weighted_peak')
        scalars: dict[str, float | bool | None] = {
            'proportional_gain': self.loop.proportional_gain,
            'integral_gain_per_s': self.loop.integral_gain_per_s,
            **{name: getattr(self, name) for name in names}}
        return {
            name: value if value is not None and math.isfinite(value) else None
            for name, value in scalars.items()}


def loop_shape(
    model: Model,
    proportional_gain: float,
    integral_gain_per_s: float,
    *,
    sample_period_s: float | None = None,
    measurement_delay_samples: int = 0,
    bound: Bound | None = None,
) -> LoopShape:
    """
    Return margins, bandwidth, sensitivity and robustness of a PI loop.

    Parameters
    ----------
    model : LinearDynamics, DynamicsFit or control.TransferFunction
        G(s), (6) in Liu 2015 or any other that falls off at high frequencies.
    proportional_gain : float
        kP of (8).
    integral_gain_per_s : float
        kI of (8), 1/s.
    sample_period_s : float, optional
        Sample period, seconds; by default the loop is the continuous one of the paper.
    measurement_delay_samples : int, optional
        Age of the measurement.
    bound : UncertaintyBound, control.TransferFunction or callable, optional
        W(s), (19) in Liu 2015, or its magnitude as a function of the frequency in hertz.

    Returns
    -------
    LoopShape
        The numbers.

    Raises
    ------
    ValueError
        If a gain or the period is out of range, both gains are 0, or G(s) does not fall off.

    """
    loop = PiLoop.of(
        model, proportional_gain, integral_gain_per_s, sample_period_s, measurement_delay_samples)
    frequency_hz = loop.frequencies_hz()
    response = loop.loop(frequency_hz)

    def at(frequency: float) -> complex:
        return complex(loop.loop([frequency])[0])

    phase_crossings = [
        crossing for crossing in _crossings(frequency_hz, response.imag, lambda f: at(f).imag)
        if at(crossing).real < 0.0]
    gain_crossings = _crossings(
        frequency_hz, np.abs(response) - 1.0, lambda f: abs(at(f)) - 1.0)
    gain_margins = [-1.0 / at(crossing).real for crossing in phase_crossings]
    phase_margins = [float(np.angle(-at(crossing))) for crossing in gain_crossings]
    delay_margins = [
        margin % (2.0 * np.pi) / (2.0 * np.pi * crossing)
        for margin, crossing in zip(phase_margins, gain_crossings, strict=True)]
    peak_hz, peak = _largest(
        frequency_hz, lambda f: np.abs(loop.sensitivity(f)))
    weighted_peak = None
    if bound is not None:
        weighted_peak = _largest(
            frequency_hz,
            lambda f: bound_magnitude(bound, f) * np.abs(loop.complementary(f)))[1]
    return LoopShape(
        loop=loop,
        stable=loop.is_stable,
        gain_margin=min((margin for margin in gain_margins if margin > 1.0), default=math.inf),
        phase_margin_deg=math.degrees(min(phase_margins, key=abs, default=math.inf)),
        delay_margin_s=min(delay_margins, default=math.inf),
        crossover_frequency_hz=max(gain_crossings, default=0.0),
        feedback_acceptable_frequency_hz=_first_above(
            frequency_hz, lambda f: np.abs(loop.sensitivity(f)) - 1.0),
        bandwidth_hz=_bandwidth(loop, frequency_hz),
        max_sensitivity=peak,
        max_sensitivity_frequency_hz=peak_hz,
        weighted_peak=weighted_peak,
        frequency_hz=frequency_hz)


def _crossings(
    frequency_hz: _Floats, values: _Floats, function: Callable[[float], float],
) -> list[float]:
    """Return the frequencies at which a function changes its sign between two of the grid's."""
    positive = values > 0.0
    return [
        float(brentq(function, frequency_hz[i], frequency_hz[i + 1]))
        for i in np.flatnonzero(positive[:-1] != positive[1:])]


def _first_above(frequency_hz: _Floats, function: Callable[[ArrayLike], _Floats]) -> float:
    """Return where a function first exceeds zero: 0 if from the start, infinite if never."""
    above = np.flatnonzero(function(frequency_hz) > 0.0)
    if above.size == 0:
        return math.inf
    first = int(above[0])
    if first == 0:
        return 0.0
    return float(brentq(
        lambda f: float(function([f])[0]), frequency_hz[first - 1], frequency_hz[first]))


def _bandwidth(loop: PiLoop, frequency_hz: _Floats) -> float:
    level = _HALF_POWER * abs(complex(loop.complementary(frequency_hz[:1])[0]))
    return _first_above(frequency_hz, lambda f: level - np.abs(loop.complementary(f)))


def _largest(
    frequency_hz: _Floats, function: Callable[[ArrayLike], _Floats],
) -> tuple[float, float]:
    """Return where a function is largest, and its value there."""
    values = function(frequency_hz)
    best = int(np.argmax(values))
    low, high = frequency_hz[max(best - 1, 0)], frequency_hz[min(best + 1, frequency_hz.size - 1)]
    refined = minimize_scalar(
        lambda f: -float(function([f])[0]), bounds=(low, high), method='bounded',
        options={'xatol': 1e-6 * low})
    if -refined.fun > values[best]:
        return float(refined.x), float(-refined.fun)
    return float(frequency_hz[best]), float(values[best])
