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
A stage as linear dynamics before a hysteresis and behind it, simulated with an input that is held.

    y(t) = Gbehind(s) H(w(t)),   w(t) = Gbefore(s) u(t),   u(t) = u[k] from sample k to k + 1

Gbefore(0) = 1. Gbefore is sampled exactly behind the hold, m times per sample period; H is applied
to these samples, and Gbehind exactly to the straight lines through them. The modes p with residue r
of both are (T: step of the grid)::

    hold:   x[j+1] = e x[j] + r (e - 1)/p u[j],                     e = exp(p T)
    lines:  x[j+1] = e x[j] + r (e - c)/p u[j] + r (c - 1)/p u[j+1],  c = (e - 1)/(p T)
"""

import itertools
import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from piezo_ros.model import DynamicsParameters, MaxwellResistiveCapacitor

__all__ = [
    'Factors', 'Placement', 'placements', 'simulate_behind', 'simulate_driven', 'simulate_placed',
]

_FINEST: Final = 8  # steps of the grid per sample period
_RESOLVED: Final = 0.15  # rate times step of the grid up to which a lag counts as resolved
_APART: Final = 1e-6  # relative; equal poles are set apart by it, so that modes exist


class Placement(NamedTuple):
    """Which poles are before the hysteresis: indices of the real poles, and of the pairs."""

    rates: tuple[int, ...] = ()
    pairs: tuple[int, ...] = ()


class Factors(NamedTuple):
    """
    A transfer function by its poles.

    Attributes
    ----------
    gain : float
        At s = 0.
    rates_rad_per_s : tuple of float
        Of the real poles.
    pairs : tuple of (float, float)
        Natural frequency, rad/s, and damping ratio of the pairs of poles.
    zeros : tuple of float
        Coefficients of the numerator without its gain, lowest power of s first; the first is 1.
    delay_s : float
        Pure delay.

    """

    gain: float
    rates_rad_per_s: tuple[float, ...]
    pairs: tuple[tuple[float, float], ...]
    zeros: tuple[float, ...] = (1.0,)
    delay_s: float = 0.0

    @classmethod
    def of(cls, dynamics: DynamicsParameters) -> 'Factors':
        """Return the factors of (6) in Liu 2015, or of listed poles and zeros."""
        p: Any = dynamics
        delay_s = float(getattr(p, 'delay_s', 0.0))
        if getattr(p, 'dynamics', 'liu') == 'liu':
            return cls(
                p.dc_gain, (1.0 / p.time_constant_s,),
                ((p.natural_frequency_1_rad_per_s, p.damping_ratio_1),
                 (p.natural_frequency_2_rad_per_s, p.damping_ratio_2)),
                (1.0, p.zero_b1_rad_per_s / p.zero_b2_rad2_per_s2, 1.0 / p.zero_b2_rad2_per_s2),
                delay_s)
        zeros = np.ones(1)
        for rate in p.zero_rates_rad_per_s:
            zeros = np.polymul(zeros, [1.0 / rate, 1.0])
        for w, z in zip(p.zero_frequencies_rad_per_s, p.zero_damping_ratios, strict=True):
            zeros = np.polymul(zeros, [1.0 / w**2, 2.0 * z / w, 1.0])
        return cls(
            p.dc_gain, tuple(p.pole_rates_rad_per_s),
            tuple(zip(p.pole_frequencies_rad_per_s, p.pole_damping_ratios, strict=True)),
            tuple(zeros[::-1].tolist()), delay_s)

    @property
    def slowest_decay_per_s(self) -> float:
        """Rate at which the slowest mode decays."""
        return min(float(-pole.real) for pole in _poles(self.rates_rad_per_s, self.pairs))


def placements(factors: Factors) -> Iterator[Placement]:
    """Return every placement that leaves as many poles as zeros behind the hysteresis."""
    rates, pairs = len(factors.rates_rad_per_s), len(factors.pairs)
    for number in range(rates + 1):
        for some_rates in itertools.combinations(range(rates), number):
            for some_pairs in _subsets(pairs):
                behind = rates - number + 2 * (pairs - len(some_pairs))
                if behind >= len(factors.zeros) - 1:
                    yield Placement(some_rates, some_pairs)


def _subsets(count: int) -> Iterator[tuple[int, ...]]:
    for number in range(count + 1):
        yield from itertools.combinations(range(count), number)


def simulate_placed(
    factors: Factors, placement: Placement, hysteresis: MaxwellResistiveCapacitor,
    voltage_v: NDArray[np.float64], sample_period_s: float,
    state: NDArray[np.float64] | None = None, *, finest: int = _FINEST,
    rest: tuple[float, float] = (0.0, 0.0),
) -> NDArray[np.float64]:
    """
    Return the displacement of a stage at rest that a held voltage causes.

    Parameters
    ----------
    factors : Factors
        The linear dynamics.
    placement : Placement
        Which of its poles are before the hysteresis.
    hysteresis : MaxwellResistiveCapacitor
        The hysteresis.
    voltage_v : ndarray, shape (N,)
        Input, held from sample to sample.
    sample_period_s : float
        Sample period, seconds.
    state : ndarray, optional
        Play values of the hysteresis before the first sample; virgin by default.
    finest : int, optional
        Most steps of the grid per sample period.
    rest : tuple of float, optional
        Voltage, and what the hysteresis makes of it, at which the stage has been resting.

    Returns
    -------
    ndarray, shape (N,)
        Displacement, micrometres; sample k before voltage k acts.

    """
    driven_um = simulate_driven(
        factors, placement, hysteresis, voltage_v, sample_period_s, state, finest=finest,
        rest=rest)
    return simulate_behind(factors, placement, driven_um, voltage_v.size, sample_period_s, rest[1])


def simulate_driven(
    factors: Factors, placement: Placement, hysteresis: MaxwellResistiveCapacitor,
    voltage_v: NDArray[np.float64], sample_period_s: float,
    state: NDArray[np.float64] | None = None, *, finest: int = _FINEST,
    rest: tuple[float, float] = (0.0, 0.0),
) -> NDArray[np.float64]:
    """
    Return what the hysteresis gives to the poles behind it, less its value at rest.

    Parameters
    ----------
    factors, placement, hysteresis, voltage_v, sample_period_s, state, finest, rest
        As for `simulate_placed`; of the factors, what is behind the hysteresis does not matter.

    Returns
    -------
    ndarray, shape (m N,)
        Micrometres, on the grid of m steps per sample period.

    """
    rest_v, rest_um = rest
    rates, pairs = _before(factors, placement)
    steps = _grid_steps(factors, rates, pairs, sample_period_s, finest)
    if not (rates or pairs):
        return np.repeat(hysteresis.forward(voltage_v, state)[0] - rest_um, steps)
    inner_v = rest_v + _modes(rates, pairs, (1.0,), 1.0).held(
        np.repeat(voltage_v - rest_v, steps), sample_period_s / steps)
    return np.asarray(hysteresis.forward(inner_v, state)[0] - rest_um)


def simulate_behind(
    factors: Factors, placement: Placement, driven_um: NDArray[np.float64], samples: int,
    sample_period_s: float, rest_um: float = 0.0,
) -> NDArray[np.float64]:
    """
    Return the displacement that follows from what the hysteresis gives.

    Parameters
    ----------
    factors, placement, sample_period_s
        As for `simulate_placed`.
    driven_um : ndarray, shape (m N,)
        What `simulate_driven` returned.
    samples : int
        N.
    rest_um : float, optional
        What the hysteresis gave at rest.

    Returns
    -------
    ndarray, shape (N,)
        Displacement, micrometres.

    """
    behind = _modes(
        tuple(rate for i, rate in enumerate(factors.rates_rad_per_s) if i not in placement.rates),
        tuple(pair for i, pair in enumerate(factors.pairs) if i not in placement.pairs),
        factors.zeros, factors.gain)
    steps = driven_um.size // samples
    is_straight = bool(placement.rates or placement.pairs)
    fine = (behind.straight if is_straight else behind.held)(driven_um, sample_period_s / steps)
    shift = factors.delay_s / sample_period_s * steps
    index = np.arange(samples) * steps
    fine = fine + factors.gain * rest_um
    if shift == 0.0:
        return np.asarray(fine[index])
    return np.asarray(np.interp(index - shift, np.arange(fine.size), fine))


def _before(
    factors: Factors, placement: Placement,
) -> tuple[tuple[float, ...], tuple[tuple[float, float], ...]]:
    """Return the real poles and the pairs before the hysteresis."""
    return (
        tuple(factors.rates_rad_per_s[i] for i in placement.rates),
        tuple(factors.pairs[i] for i in placement.pairs))


def _grid_steps(
    factors: Factors, rates: tuple[float, ...], pairs: tuple[tuple[float, float], ...],
    sample_period_s: float, finest: int,
) -> int:
    """Return the steps per sample period that resolve a delay and the poles before."""
    delay = factors.delay_s / sample_period_s
    steps = 1 if abs(delay - round(delay)) < 1e-6 else finest
    if not (rates or pairs):
        return steps
    fastest = max(*rates, *(pair[0] for pair in pairs), 0.0)
    needed = math.ceil(fastest * sample_period_s / _RESOLVED)
    return min(max(needed, steps, 2), finest)


@lru_cache(maxsize=4)  # many stretches of a record have one stage
def _modes(
    rates: tuple[float, ...], pairs: tuple[tuple[float, float], ...], zeros: tuple[float, ...],
    gain: float,
) -> '_Modes':
    """Return the modes of a transfer function."""
    poles = _poles(rates, pairs)
    # gain n(s) prod(-p)/prod(s - p): the residue at p_i leaves out its own factor.
    scale = gain * np.prod([-pole for pole in poles]) if poles else complex(gain)
    residues = [
        complex(
            scale * np.polyval(zeros[::-1], pole)
            / np.prod([pole - other for other in poles if other is not pole]))
        for pole in poles]
    is_even = len(zeros) - 1 == len(poles)
    return _Modes(poles, residues, float((scale * zeros[-1]).real) if is_even else 0.0)


def _poles(
    rates: tuple[float, ...],
    pairs: tuple[tuple[float, float], ...],
) -> list[complex]:
    poles = [complex(-rate) for rate in rates]
    for frequency, damping in pairs:
        root = np.sqrt(complex(damping**2 - 1.0))
        poles += [-frequency * (damping + root), -frequency * (damping - root)]
    apart: list[complex] = []
    for pole in poles:
        while any(abs(pole - other) < 0.5 * _APART * abs(pole) for other in apart):
            pole *= 1.0 + _APART
        apart.append(pole)
    return apart


class _Modes(NamedTuple):
    """A transfer function as a sum of modes."""

    poles: list[complex]
    residues: list[complex]
    direct: float

    def held(self, values: NDArray[np.float64], step_s: float) -> NDArray[np.float64]:
        """Return the output for an input that is held."""
        total = self.direct * values
        for pole, residue in self._upper():
            e = np.exp(pole * step_s)
            total = total + lfilter(
                [0.0, residue * (e - 1.0) / pole], [1.0, -e], values).real
        return np.asarray(total)

    def straight(self, values: NDArray[np.float64], step_s: float) -> NDArray[np.float64]:
        """Return the output for an input that is straight between its samples, 0 before."""
        total = self.direct * values
        for pole, residue in self._upper():
            e = np.exp(pole * step_s)
            mean = (e - 1.0) / (pole * step_s)
            total = total + lfilter(
                [residue * (mean - 1.0) / pole, residue * (e - mean) / pole], [1.0, -e],
                values).real
        return np.asarray(total)

    def _upper(self) -> Iterator[tuple[complex, complex]]:
        """Return poles with residues; of a conjugate pair one, with twice its residue."""
        for pole, residue in zip(self.poles, self.residues, strict=True):
            if pole.imag == 0.0:
                yield pole, residue
            elif pole.imag > 0.0:
                yield pole, 2.0 * residue
