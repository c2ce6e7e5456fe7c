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

    gain margin:           -1/L where Im L = 0, Re L < 0
    phase margin:          arg(-L) where |L| = 1
    delay margin:          phase margin/w
    feedback acceptable:   |S| < 1, (18) in Liu 2015
    robust:                |W T| < 1, (10)

with L, S and T of `pi_loop`. Crossings are refined between the points of a grid of frequencies.

Examples
--------
An integral loop around a lag tau of 1 ms, L = kI/(s (tau s + 1)), kI tau = 1:

>>> from piezo_ros.identification.tuning.linear_plant import LinearPlant
>>> lag = LinearPlant(np.array([1.0]), np.array([1e-3, 1.0]))
>>> shape = loop_shape(lag, 0.0, 1e3)
>>> shape.stable, round(shape.phase_margin_deg, 1), shape.gain_margin
(True, 51.8, inf)

"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq, minimize_scalar

from piezo_ros.identification.tuning.linear_plant import Bound, Model, bound_magnitude
from piezo_ros.identification.tuning.pi_loop import Lead, PiLoop

__all__ = ['LoopShape', 'loop_shape']

_HALF_POWER = math.sqrt(0.5)

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LoopShape:
    """
    Margins, bandwidth, sensitivity and robustness of a loop.

    Attributes
    ----------
    loop : PiLoop
        Plant and gains.
    stable : bool
        Whether the closed loop is stable; margins are meaningless if not.
    gain_margin : float
        Factor by which the gain may rise; infinite if the phase does not cross -180 degrees.
    phase_margin_deg : float
        Distance of the phase from -180 degrees where |L| = 1; infinite if |L| is not 1 anywhere.
    delay_margin_s : float
        Further delay at which the loop becomes unstable, seconds.
    crossover_frequency_hz : float
        Highest frequency at which |L| = 1; 0 if there is none.
    feedback_acceptable_frequency_hz : float
        Where |S| first exceeds 1: below it feedback lessens the error of a sine, (18) in Liu 2015.
    bandwidth_hz : float
        Where |T| first falls 3 dB below its value at low frequencies.
    max_sensitivity, max_sensitivity_frequency_hz : float
        Largest |S| and its frequency.
    weighted_peak : float or None
        Largest |W T|, (10) in Liu 2015; None without a bound W.
    frequency_hz : ndarray, shape (N,)
        Frequencies for plots of the responses of `loop`, hertz.

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
        """Return every scalar by its name, for report.json; None in place of infinity and NaN."""
        names = (
            'stable', 'gain_margin', 'phase_margin_deg', 'delay_margin_s',
            'crossover_frequency_hz', 'feedback_acceptable_frequency_hz', 'bandwidth_hz',
            'max_sensitivity', 'max_sensitivity_frequency_hz', 'weighted_peak')
        scalars: dict[str, float | bool | None] = {
            'proportional_gain': self.loop.proportional_gain,
            'integral_gain_per_s': self.loop.integral_gain_per_s,
            'lead_zero_hz': self.loop.lead.zero_hz if self.loop.lead else 0.0,
            'lead_pole_hz': self.loop.lead.pole_hz if self.loop.lead else 0.0,
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
    lead: Lead | None = None,
) -> LoopShape:
    """
    Return margins, bandwidth, sensitivity and robustness of a PI loop.

    Parameters
    ----------
    model : LinearDynamics, DynamicsFit or control.TransferFunction
        G(s), (6) in Liu 2015 or any other that vanishes at high frequencies.
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
    lead : Lead, optional
        Lead section before the gains.

    Returns
    -------
    LoopShape
        Margins, bandwidth, sensitivity and robustness.

    Raises
    ------
    ValueError
        If a gain or the period is out of range, both gains are 0, or G(s) does not vanish at high
        frequencies.

    """
    loop = PiLoop.of(
        model, proportional_gain, integral_gain_per_s, sample_period_s, measurement_delay_samples,
        lead)
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
    """Return the frequency where a function first exceeds zero; 0 from the start, inf if never."""
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
    """Return the frequency of the largest value of a function, and the value."""
    values = function(frequency_hz)
    best = int(np.argmax(values))
    low, high = frequency_hz[max(best - 1, 0)], frequency_hz[min(best + 1, frequency_hz.size - 1)]
    refined = minimize_scalar(
        lambda f: -float(function([f])[0]), bounds=(low, high), method='bounded',
        options={'xatol': 1e-6 * low})
    if -refined.fun > values[best]:
        return float(refined.x), float(-refined.fun)
    return float(frequency_hz[best]), float(values[best])
