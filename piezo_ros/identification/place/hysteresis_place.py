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
The place of the hysteresis among the identified poles, decided by records in time.

A compensated command v passes the inverse hysteresis, then the poles before the hysteresis, the
hysteresis, and the poles behind::

    y = Gbehind(s) H(Gbefore(s) H^-1(v))

Only without poles before H is this G(s) v. With them the response depends on the amplitude and has
harmonics, so that records tell the placements apart: for each, the dynamics are refined by half of
the record (alternate stretches) and judged by the other half. The best placement is known if its
squared errors are clearly smaller than those of each other one, stretch by stretch::

    r_b = log(e_other,b^2 / e_best,b^2),   mean(r)/(std(r)/sqrt(B)) > 3   and   rms ratio > 1.1
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from piezo_ros.identification.place.placed_stage import (
    Factors,
    Placement,
    placements,
    simulate_behind,
    simulate_driven,
)
from piezo_ros.model import (
    DynamicsParameters,
    HysteresisParameters,
    MaxwellResistiveCapacitor,
)
from piezo_ros.series import bridged_series

__all__ = ['Candidate', 'HysteresisPlace', 'TimeRecord', 'decide_hysteresis_place']

_STRETCHES: Final = 40
_STRETCH_SAMPLES: Final = 600
_DECAYS: Final = 6.0  # time constants of the slowest mode that a stretch lets pass before
_LONGEST_WARM_UP: Final = 3000  # samples
_MOST_CANDIDATES: Final = 32
_FEW_CANDIDATES: Final = 8  # of more, those with at most one pole or pair before the hysteresis
_CLEAR: Final = 3.0  # standard errors
_CLEAR_RATIO: Final = 1.1
_EXPLAINED: Final = 0.1  # of the displacement, which the best placement may miss
_FARTHEST: Final = 0.7  # logarithm by which a refined parameter may differ
_SIGN_KEPT: Final = 0.99  # share of the last coefficient of the numerator that may vanish
_EVALUATIONS: Final = 8
_FINAL_EVALUATIONS: Final = 25  # of the best, by all stretches


class TimeRecord(NamedTuple):
    """
    A record of a stage, virgin at its first sample.

    Attributes
    ----------
    voltage_v : ndarray, shape (N,)
        Amplifier input; sample k is held until k + 1.
    displacement_um : ndarray, shape (N,)
        Reading k, taken before voltage k acts; NaN where it is lost.
    sample_period_s : float
        Sample period, seconds.

    """

    voltage_v: NDArray[np.float64]
    displacement_um: NDArray[np.float64]
    sample_period_s: float


@dataclass(frozen=True)
class Candidate:
    """
    A placement and how well it explains what its refinement has not seen.

    Attributes
    ----------
    rates_before, pairs_before : frozenset of int
        Indices of the real poles and of the pairs before the hysteresis.
    misfit_um : float
        Rms of the error of the held-out stretches.
    factors : Factors
        The refined dynamics; those of the best by all of the records.

    """

    rates_before: frozenset[int]
    pairs_before: frozenset[int]
    misfit_um: float
    factors: Factors

    @property
    def has_poles_before(self) -> bool:
        """Whether any pole is before the hysteresis."""
        return bool(self.rates_before or self.pairs_before)

    @property
    def before(self) -> Factors:
        """The poles before the hysteresis alone, of dc gain 1."""
        return Factors(
            1.0, tuple(self.factors.rates_rad_per_s[i] for i in sorted(self.rates_before)),
            tuple(self.factors.pairs[i] for i in sorted(self.pairs_before)))

    def __str__(self) -> str:
        names = [
            *(f'rate {self.factors.rates_rad_per_s[i]:.4g} rad/s'
              for i in sorted(self.rates_before)),
            *(f'pair {self.factors.pairs[i][0]:.4g} rad/s' for i in sorted(self.pairs_before))]
        return f'{" and ".join(names) or "nothing"} before the hysteresis'


@dataclass(frozen=True)
class HysteresisPlace:
    """
    Which poles are before the hysteresis.

    Attributes
    ----------
    rates_before, pairs_before : frozenset of int
        Indices of the real poles and of the pairs of the best candidate.
    is_decided : bool
        Whether the records tell it from all others, and it explains them.
    candidates : tuple of Candidate
        Those that the records cannot tell apart, the best first.
    misfit_um : float
        Rms of the error of the best in the held-out stretches.
    displacement_rms_um : float
        Rms of the measured displacement about its mean in the same stretches.
    spread_percent : float
        Largest rms difference between the predictions of these candidates, of the measured
        displacement's rms: what the uncertainty costs a prediction.

    """

    rates_before: frozenset[int]
    pairs_before: frozenset[int]
    is_decided: bool
    candidates: tuple[Candidate, ...]
    misfit_um: float
    displacement_rms_um: float
    spread_percent: float

    def decided_by_points(self) -> 'HysteresisPlace':
        """Return the best candidate as known, as the response too tells it, if it explains."""
        if self.misfit_um >= _EXPLAINED * self.displacement_rms_um:
            return self
        return replace(self, is_decided=True, candidates=self.candidates[:1])

    def __str__(self) -> str:
        best = self.candidates[0]
        percent = 100.0 * self.misfit_um / self.displacement_rms_um
        if self.is_decided:
            return f'{best}: known, misfit {self.misfit_um:.3g} um rms ({percent:.2g} %)'
        if len(self.candidates) == 1:
            return f'undecided: even the best, {best}, misses the record by {percent:.2g} %'
        others = '; '.join(str(each) for each in self.candidates)
        return (
            f'undecided among: {others} (misfit {percent:.2g} %, their predictions differ by '
            f'{self.spread_percent:.2g} % rms)')


def decide_hysteresis_place(
    records: Sequence[TimeRecord],
    hysteresis: HysteresisParameters,
    dynamics: DynamicsParameters | Factors,
) -> HysteresisPlace:
    """
    Decide which of the identified poles are before the hysteresis.

    Parameters
    ----------
    records : sequence of TimeRecord
        Runs from a virgin stage on, that reach the frequencies of the poles at amplitudes at which
        the hysteresis shows; two different amplitudes or speeds tell most.
    hysteresis : HysteresisParameters
        The identified hysteresis, from voltage to displacement.
    dynamics : DynamicsParameters or Factors
        The identified dynamics.

    Returns
    -------
    HysteresisPlace
        The place, or the candidates that cannot be told apart.

    Raises
    ------
    ValueError
        If the records are too short, or the dynamics have too many poles.

    """
    factors = dynamics if isinstance(dynamics, Factors) else Factors.of(dynamics)
    choices = list(placements(factors))
    if len(choices) > _FEW_CANDIDATES:
        # An amplifier is a lag or a pair; to compare everything takes minutes.
        choices = [each for each in choices if len(each.rates) + len(each.pairs) <= 1]
    if len(choices) > _MOST_CANDIDATES:
        raise ValueError(
            f'{len(factors.rates_rad_per_s)} real poles and {len(factors.pairs)} pairs have '
            f'{len(choices)} placements, at most {_MOST_CANDIDATES} are compared')
    operator = MaxwellResistiveCapacitor.of(hysteresis)
    stretches = _stretches(records, operator, factors)
    train, held_out = stretches[::2], stretches[1::2]
    found: list[tuple[Candidate, NDArray[np.float64], list[NDArray[np.float64]]]] = []
    for choice in choices:
        refined = _refined(factors, choice, operator, train)
        errors = _Simulation(choice, operator, held_out).errors(refined)
        squares = np.array([float(np.mean(error**2)) for error in errors])
        found.append((
            Candidate(
                frozenset(choice.rates), frozenset(choice.pairs),
                math.sqrt(float(squares.mean())), refined), squares, errors))
    found.sort(key=lambda entry: entry[0].misfit_um)
    best, best_squares, best_errors = found[0]
    alike = [entry for entry in found[1:] if not _is_clearly_better(best_squares, entry[1])]
    rms = math.sqrt(float(np.mean([np.var(stretch.displacement_um) for stretch in held_out])))
    spread = max((
        math.sqrt(float(np.mean([
            np.mean((one - other)**2) for one, other in zip(best_errors, errors, strict=True)])))
        for _, _, errors in alike), default=0.0)
    choice = Placement(tuple(sorted(best.rates_before)), tuple(sorted(best.pairs_before)))
    best = replace(best, factors=_refined(
        best.factors, choice, operator, stretches, _FINAL_EVALUATIONS))
    return HysteresisPlace(
        best.rates_before, best.pairs_before,
        not alike and best.misfit_um < _EXPLAINED * rms,
        (best, *(entry[0] for entry in alike)), best.misfit_um, rms, 100.0 * spread / rms)


def _is_clearly_better(best: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    ratio = np.log(other / best)
    deviation = float(ratio.std(ddof=1)) / math.sqrt(ratio.size)
    return (
        float(ratio.mean()) > _CLEAR * deviation
        and float(other.mean()) > _CLEAR_RATIO**2 * float(best.mean()))


class _Stretch(NamedTuple):
    """Some samples of a record, what comes before for the modes to settle, and the play values."""

    voltage_v: NDArray[np.float64]  # with the warm-up
    displacement_um: NDArray[np.float64]  # without
    state: NDArray[np.float64]
    sample_period_s: float


def _stretches(
    records: Sequence[TimeRecord], operator: MaxwellResistiveCapacitor, factors: Factors,
) -> list[_Stretch]:
    samples = sum(record.voltage_v.size for record in records)
    stretches = []
    for record in records:
        warm_up = min(_LONGEST_WARM_UP, math.ceil(
            _DECAYS / (factors.slowest_decay_per_s * record.sample_period_s)))
        count = max(4, round(_STRETCHES * record.voltage_v.size / samples))
        length = min(_STRETCH_SAMPLES, record.voltage_v.size // count - warm_up // 4)
        if length < 16:
            raise ValueError(
                f'a record of {record.voltage_v.size} samples is too short to tell where the '
                f'hysteresis is: modes take {warm_up} samples to settle')
        state = operator.virgin_state()
        done = 0
        for start in np.linspace(warm_up, record.voltage_v.size - length, count).astype(int):
            first = max(int(start) - warm_up, 0)
            # The memory of the hysteresis is that of the voltage: a lag before it shifts the turns
            # by little, and the turns within the warm-up are simulated.
            _, state = operator.forward(bridged_series(record.voltage_v[done:first]), state)
            done = first
            voltage_v = bridged_series(record.voltage_v[first:start + length])
            displacement_um = record.displacement_um[start:start + length]
            if np.isfinite(displacement_um).all() and np.ptp(voltage_v) > 0.0:
                stretches.append(_Stretch(
                    voltage_v, displacement_um, state, record.sample_period_s))
    if len(stretches) < 8:
        raise ValueError(
            f'{len(stretches)} stretches of the records are whole and moving, at least 8 are '
            'needed to tell where the hysteresis is')
    return stretches


class _Simulation:
    """
    Simulates stretches under one placement, as the dynamics change from call to call.

    What the hysteresis gives is kept as long as nothing before it changes: most parameters of a
    refinement are behind it.
    """

    def __init__(
        self, placement: Placement, operator: MaxwellResistiveCapacitor,
        stretches: Sequence[_Stretch],
    ) -> None:
        self._placement = placement
        self._operator = operator
        self._stretches = stretches
        self._rest = []
        for stretch in stretches:
            # From the first voltage at rest, so that there is no step at the start.
            first_v = float(stretch.voltage_v[0])
            first_um = float(operator.forward(np.array([first_v]), stretch.state)[0][0])
            self._rest.append((first_v, first_um))
        self._driven: dict[Factors, list[NDArray[np.float64]]] = {}

    def errors(self, factors: Factors) -> list[NDArray[np.float64]]:
        """Return measured minus simulated displacement about its mean, as the sensor may drift."""
        errors = []
        for stretch, rest, driven_um in zip(
                self._stretches, self._rest, self._drive(factors), strict=True):
            simulated_um = simulate_behind(
                factors, self._placement, driven_um, stretch.voltage_v.size,
                stretch.sample_period_s, rest[1])
            error_um = stretch.displacement_um - simulated_um[-stretch.displacement_um.size:]
            errors.append(np.asarray(error_um - error_um.mean()))
        return errors

    def _drive(self, factors: Factors) -> list[NDArray[np.float64]]:
        place = self._placement
        before = Factors(
            1.0, tuple(factors.rates_rad_per_s[i] for i in place.rates),
            tuple(factors.pairs[i] for i in place.pairs), delay_s=factors.delay_s)
        driven_um = self._driven.pop(before, None)
        if driven_um is None:
            driven_um = [
                simulate_driven(
                    factors, place, self._operator, stretch.voltage_v, stretch.sample_period_s,
                    stretch.state, rest=rest)
                for stretch, rest in zip(self._stretches, self._rest, strict=True)]
        # The newest last, the one before it first: that of the point between two differences.
        self._driven = dict([*self._driven.items()][-1:])
        self._driven[before] = driven_um
        return driven_um


def _refined(
    factors: Factors, placement: Placement, operator: MaxwellResistiveCapacitor,
    train: Sequence[_Stretch], evaluations: int = _EVALUATIONS,
) -> Factors:
    """Return the dynamics that explain the stretches best behind and before the hysteresis."""
    size = 1 + len(factors.rates_rad_per_s) + 2 * len(factors.pairs)
    reference = max(
        *factors.rates_rad_per_s, *(pair[0] for pair in factors.pairs), 0.0)
    zeros = len(factors.zeros) - 1

    def changed(vector: NDArray[np.float64]) -> Factors:
        grown = np.exp(vector[:size])
        rates = len(factors.rates_rad_per_s)
        coefficients = [
            each + float(vector[size + i]) / reference**(i + 1)
            for i, each in enumerate(factors.zeros[1:])]
        return factors._replace(
            gain=factors.gain * float(grown[0]),
            rates_rad_per_s=tuple(
                (np.array(factors.rates_rad_per_s) * grown[1:1 + rates]).tolist()),
            pairs=tuple(
                (w * float(grown[1 + rates + 2 * i]), z * float(grown[2 + rates + 2 * i]))
                for i, (w, z) in enumerate(factors.pairs)),
            zeros=(1.0, *coefficients))

    simulation = _Simulation(placement, operator, train)

    def residual(vector: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate(simulation.errors(changed(vector)))

    lower = np.full(size + zeros, -_FARTHEST)
    if zeros and factors.zeros[-1] > 0.0:
        # A numerator of even order keeps the sign that (6) has.
        lower[-1] = max(lower[-1], -_SIGN_KEPT * factors.zeros[-1] * reference**zeros)
    found = least_squares(
        residual, np.zeros(size + zeros), bounds=(lower, _FARTHEST), x_scale='jac',
        diff_step=[1e-4] * (size + zeros), max_nfev=evaluations, ftol=1e-4, xtol=1e-5)
    return changed(found.x)
