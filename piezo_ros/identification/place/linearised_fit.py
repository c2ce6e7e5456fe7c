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
A frequency response without what a hysteresis behind poles does to it.

A compensated command v passes the inverse hysteresis, poles, the hysteresis, and the rest::

    y = Gbehind(s) w,   w = H(Gbefore(s) H^-1(v)),   w_lin = Gbefore(s) v

With poles before H the phasor W of w is not that of w_lin: the loops get smaller and later with
the frequency. No linear model explains the measured points Y/V then, however many poles it has; but

    Y/V W_lin/W = Gbehind Gbefore = G

is linear, and only the poles before H have to be found: those for which a model explains these
points best. Looked for are a lag and a pole pair. What is taken must explain the points clearly
better than any model of the points as they were measured.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from piezo_ros.identification.dynamics.dynamics_fit import DynamicsFit, fit_dynamics
from piezo_ros.identification.dynamics.dynamics_validation import AGREED_MAGNITUDE, AGREED_PHASE
from piezo_ros.identification.dynamics.rational_fit import (
    Effort,
    RationalProblem,
    fit_rational,
)
from piezo_ros.identification.dynamics.rational_model import Sections
from piezo_ros.identification.dynamics.structure_choice import shape_of
from piezo_ros.identification.place.hysteresis_place import TimeRecord
from piezo_ros.identification.place.placed_stage import Factors, Placement, simulate_placed
from piezo_ros.identification.response.frequency_response import FrequencyResponse
from piezo_ros.model import (
    DynamicsParameters,
    HysteresisParameters,
    LinearDynamics,
    MaxwellResistiveCapacitor,
)
from piezo_ros.series import bridged_series

__all__ = [
    'SMALLEST_ERROR', 'LinearisedFit', 'fit_linearised', 'fit_with_poles_before', 'same_to_hz',
]

_LEAST_ERROR: Final = 1e-3  # of a model; less of the response is not explained better
_CLEARLY: Final = 0.5  # share of the error of the points as measured, below which poles are taken
SMALLEST_ERROR: Final = 2e-3  # of a model of the points as measured, above which poles are tried
_ORDERS: Final = (3, 6)  # of the model in the search: as chosen for the points, within these
_HIGHEST: Final = 3.0  # over the highest measured frequency: faster poles do not show
_RATES: Final = 9
_FREQUENCIES: Final = 5
_DAMPING_RATIOS: Final = (0.4, 0.8)
_EVALUATIONS: Final = 30
_NEARLY: Final = 20.0  # difference of the criterion up to which the other kind is refined too
_EFFORT: Final = Effort(starts=1, evaluations=20, tolerance=1e-4)
_TOLERANCE: Final = 2e-3  # of a logarithm
_GRID: Final = 4  # steps per sample period of the simulation
_COARSE_GRID: Final = 2  # of the first look at starts

_Floats = NDArray[np.float64]
_Respond = Callable[[Sequence[_Floats]], FrequencyResponse]


class LinearisedFit(NamedTuple):
    """
    A model of points from which the effect of the hysteresis was taken out.

    Attributes
    ----------
    fit : DynamicsFit
        The model.
    response : FrequencyResponse
        The points.
    before : Factors
        The poles before the hysteresis that explain the measured points.

    """

    fit: DynamicsFit
    response: FrequencyResponse
    before: Factors

    def __str__(self) -> str:
        poles = [
            *(f'a lag of {rate:.4g} rad/s' for rate in self.before.rates_rad_per_s),
            *(f'a pole pair of {frequency:.4g} rad/s, damping ratio {damping:.3g},'
              for frequency, damping in self.before.pairs)]
        return f'{" and ".join(poles)} before the hysteresis'


def fit_linearised(
    fit: DynamicsFit, measured: FrequencyResponse, records: Sequence[TimeRecord],
    hysteresis: HysteresisParameters, respond: _Respond, *, delay_samples: float = 0.0,
) -> LinearisedFit | None:
    """
    Return a model that explains points by poles before the hysteresis, where none does without.

    Parameters
    ----------
    fit : DynamicsFit
        The model of the points as they were measured.
    measured : FrequencyResponse
        These points.
    records : sequence of TimeRecord
        The records that they are from, each of a virgin stage.
    hysteresis : HysteresisParameters
        The identified hysteresis.
    respond : callable
        Returns the frequency response of the records with other displacements, one for each.
    delay_samples : float, optional
        Known delay, in samples.

    Returns
    -------
    LinearisedFit or None
        None where the points are explained as they are, or no poles before the hysteresis explain
        them clearly better.

    """
    if fit.model_error < SMALLEST_ERROR:
        return None
    search = _Search(
        measured, _whole(records), MaxwellResistiveCapacitor.of(hysteresis), respond, delay_samples,
        min(max(fit.orders[1], _ORDERS[0]), _ORDERS[1]))
    without = search.criterion(measured)
    kinds = sorted(
        (search.best_start(starts) for starts in (_lags(measured), _pairs(measured))),
        key=lambda found: found[0])
    best = search.refined(kinds[0])
    if kinds[1][0] < best[0] + _NEARLY:
        best = min(best, search.refined(kinds[1]), key=lambda found: found[0])
    if best[0] >= without:
        return None
    response = search.linearised(best[1])
    assert response is not None  # its criterion is finite
    better = fit_dynamics(response, structure='auto', delay_samples=delay_samples)
    if better.model_error > _CLEARLY * fit.model_error:
        return None
    return LinearisedFit(better, response, best[1])


def fit_with_poles_before(
    measured: FrequencyResponse, records: Sequence[TimeRecord], hysteresis: HysteresisParameters,
    respond: _Respond, before: Factors, *, delay_samples: float = 0.0,
) -> LinearisedFit | None:
    """
    Return a model of points from which the effect of known poles before the hysteresis is taken.

    Parameters
    ----------
    measured, records, hysteresis, respond, delay_samples
        As for `fit_linearised`.
    before : Factors
        The poles before the hysteresis.

    Returns
    -------
    LinearisedFit or None
        None where these poles would have distorted some of the points too much.

    """
    points = _without_fits(measured, records, hysteresis, respond).linearised(before)
    if points is None:
        return None
    return LinearisedFit(
        fit_dynamics(points, structure='auto', delay_samples=delay_samples), points, before)


def same_to_hz(
    measured: FrequencyResponse, records: Sequence[TimeRecord], hysteresis: HysteresisParameters,
    respond: _Respond, candidates: Sequence[Factors],
) -> float:
    """
    Return up to where it does not matter which poles are before the hysteresis.

    Parameters
    ----------
    measured, records, hysteresis, respond
        As for `fit_linearised`.
    candidates : sequence of Factors
        Poles that may be before the hysteresis; none is one more candidate.

    Returns
    -------
    float
        Hertz: below the first point that one of the candidates changes by more than 3 % or
        2 degrees; inf if there is none.

    """
    search = _without_fits(measured, records, hysteresis, respond)
    same = math.inf
    for before in candidates:
        points = search.linearised(before)
        if points is None:
            continue
        ratio = points.response / measured.response
        changed = (np.abs(np.abs(ratio) - 1.0) > AGREED_MAGNITUDE) | (
            np.abs(np.angle(ratio)) > AGREED_PHASE)
        if changed.any():
            first = int(np.argmax(changed))
            same = min(same, float(measured.frequency_hz[first - 1]) if first else 0.0)
    return same


def _without_fits(
    measured: FrequencyResponse, records: Sequence[TimeRecord], hysteresis: HysteresisParameters,
    respond: _Respond,
) -> '_Search':
    """Return a search of which the points behind known poles alone are asked for."""
    return _Search(
        measured, _whole(records), MaxwellResistiveCapacitor.of(hysteresis), respond, 0.0, 1)


def _whole(records: Sequence[TimeRecord]) -> list[TimeRecord]:
    return [record._replace(voltage_v=bridged_series(record.voltage_v)) for record in records]


def _lags(measured: FrequencyResponse) -> Iterator[Factors]:
    for rate in 2.0 * np.pi * _corners_hz(measured, _RATES):
        yield Factors(1.0, (float(rate),), ())


def _pairs(measured: FrequencyResponse) -> Iterator[Factors]:
    for omega in 2.0 * np.pi * _corners_hz(measured, _FREQUENCIES):
        for damping in _DAMPING_RATIOS:
            yield Factors(1.0, (), ((float(omega), damping),))


def _corners_hz(measured: FrequencyResponse, number: int) -> _Floats:
    low, high = float(measured.frequency_hz[0]), float(measured.frequency_hz[-1])
    return np.asarray(np.geomspace(max(low, 1e-2 * high), _HIGHEST * high, number))


class _Search:
    """The poles before the hysteresis for which a model explains the points best."""

    def __init__(
        self, measured: FrequencyResponse, records: Sequence[TimeRecord],
        operator: MaxwellResistiveCapacitor, respond: _Respond, delay_samples: float, order: int,
    ) -> None:
        self._measured = measured
        self._records = records
        self._operator = operator
        self._respond = respond
        self._delay_samples = delay_samples
        self._shape = shape_of(order - 1, order)
        self._starts: list[Sections] = []

    def best_start(self, starts: Iterator[Factors]) -> tuple[float, Factors]:
        """Return the best of some starts with its criterion; the poles are parameters too."""
        return min(
            ((self._criterion_of(before, _COARSE_GRID), before) for before in starts),
            key=lambda found: found[0])

    def refined(self, found: tuple[float, Factors]) -> tuple[float, Factors]:
        """Return the best poles about a start, with their criterion."""
        if not math.isfinite(found[0]):
            return found
        start = found[1]
        vector = _vector(start)
        simplex = np.vstack([vector, *(vector + 0.1 * unit for unit in np.eye(vector.size))])
        options: Any = {
            'initial_simplex': simplex, 'maxfev': _EVALUATIONS, 'xatol': _TOLERANCE, 'fatol': 0.1}

        def criterion(changed: _Floats) -> float:
            return self._criterion_of(_changed(start, changed))
        best = minimize(criterion, vector, method='Nelder-Mead', options=options)
        return min(
            found, (float(best.fun), _changed(start, best.x)), key=lambda other: other[0])

    def criterion(self, points: FrequencyResponse) -> float:
        """Return the Bayesian criterion of a model of points."""
        fit = fit_rational(
            RationalProblem.of(self._shape, points, self._delay_samples), self._starts, _EFFORT)
        self._starts = [fit.sections]  # that of poles which differ by little
        return fit.bayesian_criterion(_LEAST_ERROR)

    def linearised(self, before: Factors, steps: int = _GRID) -> FrequencyResponse | None:
        """
        Return the measured points times W_lin/W.

        None where some of them would have been too distorted to be points, with these poles.
        """
        all_before = Placement(
            tuple(range(len(before.rates_rad_per_s))), tuple(range(len(before.pairs))))
        true = self._respond([
            simulate_placed(
                before, all_before, self._operator, record.voltage_v, record.sample_period_s,
                finest=steps)
            for record in self._records])
        linear = _linear(before).sampled_response(
            self._measured.frequency_hz, self._measured.sample_period_s)
        with np.errstate(invalid='ignore'):
            ratio = linear / _at(self._measured, true)
        if not np.isfinite(ratio).all():
            return None
        return replace(
            self._measured, response=self._measured.response * ratio,
            variance=self._measured.variance * np.abs(ratio)**2)

    def _criterion_of(self, before: Factors, steps: int = _GRID) -> float:
        points = self.linearised(before, steps)
        if points is None:
            return math.inf
        size = _vector(before).size
        return self.criterion(points) + size * math.log(2 * self._measured.frequency_hz.size)


def _vector(before: Factors) -> _Floats:
    return np.log([*before.rates_rad_per_s, *(each for pair in before.pairs for each in pair)])


def _changed(before: Factors, vector: _Floats) -> Factors:
    values = np.exp(vector).tolist()
    if before.pairs:
        return before._replace(pairs=((values[0], values[1]),))
    return before._replace(rates_rad_per_s=(values[0],))


def _linear(before: Factors) -> LinearDynamics:
    return LinearDynamics(DynamicsParameters(
        dynamics='sections', pole_rates_rad_per_s=before.rates_rad_per_s,
        pole_frequencies_rad_per_s=tuple(omega for omega, _ in before.pairs),
        pole_damping_ratios=tuple(damping for _, damping in before.pairs),
        pairs_before_hysteresis=0))


def _at(measured: FrequencyResponse, other: FrequencyResponse) -> NDArray[np.complex128]:
    """Return another response of the same records at the measured points; NaN for none."""
    keys = [
        list(zip(each.frequency_hz.tolist(), each.amplitude.tolist(), each.offset.tolist(),
                 strict=True))
        for each in (measured, other)]
    place = {key: index for index, key in enumerate(keys[1])}
    return np.array([
        other.response[place[key]] if key in place else np.nan for key in keys[0]],
        dtype=np.complex128)
