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
Creep out of a record, by the operator of `piezo_ros.model.creep`.

With K columns X_i that the displacement would have without creep (one for each held voltage, or
the one of a known hysteresis), their relaxations P_ij with the time constants tau_j, and q the
ratio of two of these::

    y = a + v t + sum_i b_i (X_i + c C_i),   C_i = log10(q) sum_j P_ij
    P_ij <- P_ij + (1 - exp(-dt/tau_j)) (X_i - P_ij)

Levels b_i, share c, offset a and drift v are fitted by least squares; t_start and t_end are those
of a grid of half decades that leave least. Standard errors are those of the fit times the root of
(1 + r)/(1 - r), r being the correlation of successive residuals; to that of c is added what other
times t_start and t_end would make of it.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification.creep.creep_points import CreepPoints, creep_points
from piezo_ros.identification.estimation.covariance import Covariance
from piezo_ros.identification.hysteresis.records import Record
from piezo_ros.identification.verdict import Verdict
from piezo_ros.identification.yaml_text import yaml_value
from piezo_ros.model.creep import CreepParameters
from piezo_ros.model.hysteresis import HysteresisParameters

__all__ = ['CreepFit', 'fit_creep']

_PER_DECADE: Final = 2  # as the operator has
_HALF_DECADE: Final = 10.0**0.5
_LEAST_DECADES: Final = 1.0
_SIGNIFICANT: Final = 3.0  # standard errors
_GOOD_PERCENT: Final = 80.0
_BEYOND: Final = 2  # half decades beyond the record, in which the creep may go on
_RESOLVED: Final = 4.0  # points in the shortest time constant of a moved stage
_TIME_ERROR: Final = 0.25 / math.sqrt(12.0)  # decades, of a time on a grid of half decades
_LEFT_SHARE: Final = 0.3  # of the creep, beyond the noise, from which the model class is doubtful
_POOR_PERCENT: Final = 50.0
_MEANS: Final = 20  # of what is held out, so that noise does not hide the creep
_MOST_SHARE: Final = 1.0
_MOST_CORRELATION: Final = 0.999

_Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class CreepFit:
    """
    An identified creep.

    Attributes
    ----------
    parameters : CreepParameters
        Share per decade, and the times between which it is.
    standard_error : float
        Standard error of the share per decade.
    drift_um_per_s, drift_standard_error_um_per_s : float
        Drift beside the creep.
    method : str
        What the displacement without creep is from, in words.
    span_s : float
        Time from the first change of the voltage to the end.
    rms_um, noise_rms_um : float
        Root mean square of the residual, and of its changes from point to point over root 2.
    held_out_percent : float
        Share of the creep in the last half decade that is predicted by a fit without it.
    points : int
        Means of samples that were fitted.
    verdict : Verdict
        How far it may be trusted.
    time_s, displacement_um, still_um, predicted_um : ndarray, shape (N,)
        The fitted points: measured, without creep, and predicted.

    """

    parameters: CreepParameters
    standard_error: float
    drift_um_per_s: float
    drift_standard_error_um_per_s: float
    method: str
    span_s: float
    rms_um: float
    noise_rms_um: float
    held_out_percent: float
    points: int
    verdict: Verdict
    time_s: _Floats
    displacement_um: _Floats
    still_um: _Floats
    predicted_um: _Floats

    def to_parameter_yaml(self, *, source: str) -> str:
        """
        Return a ROS parameter file for the compensator node.

        Parameters
        ----------
        source : str
            Where the data come from, usually the bag.

        """
        p = self.parameters
        lines = [
            'model format_version: 1', 'creep, identified by piezo_ros', f'source: {source}',
            f'verdict: {self.verdict}',
            f'share per decade: {p.creep_per_decade:.5g} +- {self.standard_error:.2g}',
            (f'drift beside it: {1e3 * self.drift_um_per_s:.4g} +- '
             f'{1e3 * self.drift_standard_error_um_per_s:.2g} nm/s (no model inverts it)'),
            'with feedback that has an integral part it is not needed: load it for the scheme ff']
        facts: dict[str, float | int | str] = {
            'verdict': str(self.verdict), 'creep_standard_error': self.standard_error,
            'drift_um_per_s': self.drift_um_per_s,
            'drift_standard_error_um_per_s': self.drift_standard_error_um_per_s,
            'span_s': self.span_s, 'residual_rms_um': self.rms_um,
            'noise_rms_um': self.noise_rms_um, 'held_out_percent': self.held_out_percent,
            'points': self.points, 'method': self.method}
        text = [f'# {line}' for line in lines]
        for node, values in (
                ('compensator', {name: float(getattr(p, name)) for name in p.names()}),
                ('identified_creep', facts)):
            text += [f'/**/{node}:', '  ros__parameters:', *(
                f'    {name}: {yaml_value(value)}' for name, value in values.items())]
        return '\n'.join([*text, ''])


@dataclass(frozen=True)
class _Solution:
    """A least squares fit with given time constants."""

    theta: _Floats  # levels, share, drift, others
    cost: float
    jacobian: _Floats
    predicted_um: _Floats


def fit_creep(
    record: Record, sample_period_s: float, *, hysteresis: HysteresisParameters | None = None,
    settle_s: float = 0.02, is_settled: bool = False,
) -> CreepFit:
    """
    Return the creep of a stage.

    Parameters
    ----------
    record : Record
        Voltage and displacement.
    sample_period_s : float
        Sample period of the recording, seconds.
    hysteresis : HysteresisParameters, optional
        Tells the displacement without creep; without it the voltage must be held for at least half
        of the record.
    settle_s : float, optional
        What is left out after each change of a held voltage, seconds.
    is_settled : bool, optional
        Whether the stage had rested at the first voltage for long; else at 0 V.

    Raises
    ------
    ValueError
        If the voltage is neither held nor a hysteresis given, or the record is too short.

    """
    points = creep_points(record, sample_period_s, hysteresis, settle_s, is_settled)
    span_s = float(points.time_s[-1] - points.time_s[points.changed])
    first_s = _first_time_s(points)
    if not first_s < span_s / _HALF_DECADE:
        raise ValueError(
            f'the record lasts {span_s:g} s after the first change of the voltage, of which the '
            f'first {first_s:g} s tell nothing of creep: a longer one is needed')
    starts = np.arange(
        math.floor(_PER_DECADE * math.log10(first_s)), math.ceil(_PER_DECADE * math.log10(span_s)))
    longest = math.ceil(_PER_DECADE * math.log10(span_s))
    stops = np.arange(starts[0] + 1, longest + _BEYOND + 1)
    time_constants_s = _HALF_DECADE ** (starts[0] + 0.5 + np.arange(stops[-1] - starts[0]))
    relaxed = _relaxations(points, time_constants_s, is_settled)
    used = points.weight > 0.0

    def creep_of(low: int, high: int) -> _Floats:
        return np.asarray(relaxed[:, :, low - starts[0]:high - starts[0]].sum(axis=2)
                          / _PER_DECADE)

    candidates = [
        (low, high) for low in starts.tolist() for high in stops.tolist() if high > low]
    costs = [_solved(points, creep_of(*each), used).cost for each in candidates]
    # Of those that leave about the least, the one that begins and ends last: what is quicker than
    # the record is part of the gain, and of what is slower it does not tell the end.
    least = min(costs) * (1.0 + 4.0 / used.sum())
    low, high = max(
        (each for each, cost in zip(candidates, costs, strict=True) if cost <= least),
        key=lambda each: (each[1], each[0]))
    is_open = bool(high >= longest)
    # How long it goes on beyond the record is not known: what that makes of the share is an error.
    shares = [
        float(_solved(points, creep_of(low, stop), used).theta[points.columns.shape[1]])
        for stop in (stops[-1 - _BEYOND:].tolist() if is_open else [high])]
    of_grid = _TIME_ERROR * abs(shares[-1]) * math.sqrt(2 - is_open) * _PER_DECADE / (high - low)
    of_times = math.hypot((max(shares) - min(shares)) / math.sqrt(12.0), of_grid)
    creep = creep_of(low, high)
    return _result(
        points, creep, _solved(points, creep, used), used,
        (10.0 ** (low / _PER_DECADE), 10.0 ** (high / _PER_DECADE)), span_s, first_s,
        of_times=of_times, is_open=is_open)


def _result(
    points: CreepPoints, creep: _Floats, solution: _Solution, used: NDArray[np.bool_],
    times_s: tuple[float, float], span_s: float, first_s: float, *, of_times: float,
    is_open: bool,
) -> CreepFit:
    levels = points.columns.shape[1]
    share, drift = float(solution.theta[levels]), float(solution.theta[levels + 1])
    root = np.sqrt(points.weight[used])
    residual = points.displacement_um[used] - solution.predicted_um[used]
    weighted = root * residual
    freedom = max(int(used.sum()) - solution.theta.size, 1)
    correlation = float(weighted[1:] @ weighted[:-1]) / max(float(weighted @ weighted), 1e-300)
    correlation = min(max(correlation, 0.0), _MOST_CORRELATION)
    variance = solution.cost / freedom * (1.0 + correlation) / (1.0 - correlation)
    errors = Covariance.of(solution.jacobian, variance).standard_errors(
        np.eye(solution.theta.size))
    still_um = points.columns @ solution.theta[:levels]
    held_out = _held_out_percent(points, creep, used, times_s[1])
    error = math.hypot(float(errors[levels]), of_times)
    crept_um = share * (creep @ solution.theta[:levels])[used]
    rms_um = float(np.sqrt(np.mean(residual**2)))
    noise_um = float(np.sqrt(0.5 * np.mean(np.diff(residual) ** 2)))
    left_share = math.sqrt(max(rms_um**2 - noise_um**2, 0.0)) / max(float(np.std(crept_um)), 1e-300)
    parameters = CreepParameters(
        creep_per_decade=min(max(share, 0.0), _MOST_SHARE), creep_start_s=times_s[0],
        creep_end_s=times_s[1])
    return CreepFit(
        parameters=parameters, standard_error=error, drift_um_per_s=drift,
        drift_standard_error_um_per_s=float(errors[levels + 1]), method=points.method,
        span_s=span_s, rms_um=rms_um, noise_rms_um=noise_um,
        held_out_percent=held_out, points=int(used.sum()),
        verdict=_verdict(
            share, error, held_out, left_share, span_s, first_s, parameters, is_open=is_open),
        time_s=points.time_s[used], displacement_um=points.displacement_um[used],
        still_um=still_um[used], predicted_um=solution.predicted_um[used])


def _verdict(
    share: float, error: float, held_out_percent: float, left_share: float, span_s: float,
    first_s: float, parameters: CreepParameters, *, is_open: bool,
) -> Verdict:
    told = (f'{100.0 * share:.3g} ± {100.0 * error:.2g} % a decade, of which '
            f'{held_out_percent:.3g} % of the last half decade are predicted without it')
    decades = math.log10(span_s / first_s)
    if decades < _LEAST_DECADES:
        return Verdict.poor(
            f'the record covers {decades:.2g} decades of time, from {first_s:.3g} to '
            f'{span_s:.3g} s after a change, at least {_LEAST_DECADES:g} are needed', told)
    if not (math.isfinite(error) and share > _SIGNIFICANT * error):
        return Verdict.poor(
            f'no creep is seen: {100.0 * share:.3g} ± {100.0 * error:.2g} % a decade', 'leave '
            'creep_per_decade at 0')
    if share > _MOST_SHARE:
        return Verdict.poor(f'creep of {100.0 * share:.3g} % a decade is beyond what a stage has')
    if held_out_percent < _POOR_PERCENT:
        return Verdict.poor(told, 'what moves the stage is no creep of this kind')
    if left_share > _LEFT_SHARE:
        return Verdict.poor(
            told, f'beside the noise {100.0 * left_share:.2g} % of the creep is left: the '
            'displacement without creep is not as it was told, or this is no creep')
    reasons = (told,) if held_out_percent >= _GOOD_PERCENT else (
        told, 'so that its inverse leaves much of it')
    if is_open or held_out_percent < _GOOD_PERCENT:
        return Verdict.usable_up_to(
            f'{span_s:.3g} s after a change', *reasons, 'longer times the record does not tell')
    return Verdict.good(*reasons, f'it has ended after {parameters.creep_end_s:.3g} s')


def _held_out_percent(
    points: CreepPoints, creep: _Floats, used: NDArray[np.bool_], creep_end_s: float,
) -> float:
    """Return how much of the creep in its last half decade a fit without it predicts, percent."""
    begin_s = points.time_s[points.last_change]
    since_s = points.time_s - begin_s
    end_s = min(float(since_s[-1]), creep_end_s)
    trained = used & (since_s <= end_s / _HALF_DECADE)
    held_out = used & (since_s <= end_s) & ~trained
    if trained.sum() < 2 * (points.columns.shape[1] + 3) or held_out.sum() < 2:
        return 0.0
    solution = _solved(points, creep, trained)
    # As a change since the end of what is known, which is what has to be predicted.
    place = int(np.flatnonzero(trained)[-1])
    near = np.flatnonzero(trained)[-max(int(held_out.sum()) // _MEANS, 1):]
    shift_um = float(np.mean((points.displacement_um - solution.predicted_um)[near]))
    whole = _solved(points, creep, used)
    levels = points.columns.shape[1]
    crept_um = whole.theta[levels] * (creep @ whole.theta[:levels])
    left = _means((points.displacement_um - solution.predicted_um - shift_um)[held_out])
    grown = _means((crept_um - crept_um[place])[held_out])
    size = float(np.sqrt(np.mean(grown**2)))
    if size == 0.0:
        return 0.0
    return max(0.0, 100.0 * (1.0 - float(np.sqrt(np.mean(left**2))) / size))


def _means(values: _Floats) -> _Floats:
    return np.array([part.mean() for part in np.array_split(values, min(_MEANS, values.size))])


def _solved(points: CreepPoints, creep: _Floats, used: NDArray[np.bool_]) -> _Solution:
    """Fit levels, share, drift and offset with the given time constants."""
    root = np.sqrt(np.where(used, points.weight, 0.0))[:, None]
    levels = points.columns.shape[1]
    beside = points.beside
    share, cost = 0.0, math.inf
    chosen = root[:, 0] > 0.0
    root, measured = root[chosen], points.displacement_um[chosen]
    columns, crept, beside_used = points.columns[chosen], creep[chosen], beside[chosen]
    for _ in range(30):
        still = columns + share * crept
        linear = np.column_stack([still, beside_used])
        coefficients = np.linalg.lstsq(root * linear, root[:, 0] * measured, rcond=None)[0]
        jacobian = np.column_stack([
            still, crept @ coefficients[:levels], beside_used])
        residual = measured - linear @ coefficients
        step = np.linalg.lstsq(root * jacobian, root[:, 0] * residual, rcond=None)[0]
        now = float(np.sum((root[:, 0] * residual) ** 2))
        if cost - now <= 1e-9 * max(now, 1e-300) and math.isfinite(cost):
            break
        cost = now
        share += float(step[levels])
    theta = np.concatenate([coefficients[:levels], [share], coefficients[levels:]])
    predicted = (
        (points.columns + share * creep) @ coefficients[:levels] + beside @ coefficients[levels:])
    return _Solution(theta, cost, root * jacobian, predicted)


def _relaxations(
    points: CreepPoints, time_constants_s: _Floats, is_settled: bool,
) -> _Floats:
    """Return the relaxations of each column with each time constant, shape (N, K, J)."""
    columns = points.columns
    relaxed = np.empty((*columns.shape, time_constants_s.size))
    state = np.zeros(relaxed.shape[1:]) + (columns[0][:, None] if is_settled else 0.0)
    steps_s = np.diff(points.time_s, prepend=points.time_s[0] - np.median(np.diff(points.time_s)))
    for k, (step_s, values) in enumerate(zip(steps_s.tolist(), columns, strict=True)):
        state = state - np.expm1(-step_s / time_constants_s) * (values[:, None] - state)
        relaxed[k] = state
    return relaxed


def _first_time_s(points: CreepPoints) -> float:
    """Return the time after the last change at which the first point that is used lies."""
    used = points.weight > 0.0
    after = np.flatnonzero(used & (np.arange(used.size) > points.last_change))
    if not after.size:
        raise ValueError('after the last change of the voltage no displacement is left')
    spacing_s = float(np.median(np.diff(points.time_s)))
    return max(
        float(points.time_s[after[0]] - points.time_s[points.last_change]), _RESOLVED * spacing_s)
