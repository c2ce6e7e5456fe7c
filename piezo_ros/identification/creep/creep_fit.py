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

from piezo_ros.identification.estimation.covariance import Covariance
from piezo_ros.identification.hysteresis.records import Record
from piezo_ros.identification.verdict import Verdict
from piezo_ros.identification.yaml_text import yaml_value
from piezo_ros.model.creep import CreepParameters
from piezo_ros.model.hysteresis import HysteresisParameters
from piezo_ros.model.hysteresis_and_inverse import MaxwellResistiveCapacitor

__all__ = ['CreepFit', 'fit_creep']

_PER_DECADE: Final = 2  # as the operator has
_HALF_DECADE: Final = 10.0**0.5
_SAME_VOLTAGE: Final = 1e-4  # of the span: smaller changes from sample to sample are none
_LEVEL_RANGE: Final = 1e-2  # of the span, within one held voltage
_MOST_LEVELS: Final = 100
_HELD_SHARE: Final = 0.5  # of the record, from which the held voltages are enough
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
class _Points:
    """What is fitted: times, measured displacement, its weight, and the columns without creep."""

    time_s: _Floats  # (N,)
    displacement_um: _Floats
    weight: _Floats
    columns: _Floats  # (N, K)
    beside: _Floats  # (N, B) drift, and what else is fitted linearly
    method: str
    changed: int  # point at which the voltage first moves
    last_change: int


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
    points = _points(record, sample_period_s, hysteresis, settle_s, is_settled)
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
    points: _Points, creep: _Floats, solution: _Solution, used: NDArray[np.bool_],
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
    points: _Points, creep: _Floats, used: NDArray[np.bool_], creep_end_s: float,
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


def _solved(points: _Points, creep: _Floats, used: NDArray[np.bool_]) -> _Solution:
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
    points: _Points, time_constants_s: _Floats, is_settled: bool,
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


def _first_time_s(points: _Points) -> float:
    """Return the time after the last change at which the first point that is used lies."""
    used = points.weight > 0.0
    after = np.flatnonzero(used & (np.arange(used.size) > points.last_change))
    if not after.size:
        raise ValueError('after the last change of the voltage no displacement is left')
    spacing_s = float(np.median(np.diff(points.time_s)))
    return max(
        float(points.time_s[after[0]] - points.time_s[points.last_change]), _RESOLVED * spacing_s)


def _points(
    record: Record, sample_period_s: float, hysteresis: HysteresisParameters | None,
    settle_s: float, is_settled: bool,
) -> _Points:
    voltage_v, time_s = record.voltage_v, record.index * sample_period_s
    weight = np.where(record.measured, record.weight, 0.0)
    if voltage_v.size < 20:
        raise ValueError(f'the record has {voltage_v.size} points, at least 20 are needed')
    span_v = float(np.ptp(np.append(voltage_v, [] if is_settled else 0.0)))
    if span_v == 0.0:
        raise ValueError(
            f'the voltage is {voltage_v[0]:g} V from first to last: creep follows a change of it')
    moves = np.abs(np.diff(voltage_v, prepend=voltage_v[0] if is_settled else 0.0)) > (
        _SAME_VOLTAGE * span_v)
    changed = np.flatnonzero(moves)
    if not changed.size:
        changed = np.array([0])
    if hysteresis is not None:
        still_um, _ = MaxwellResistiveCapacitor.of(hysteresis).forward(voltage_v)
        # The stage lags: a little of the slope is added.
        return _Points(
            time_s, record.displacement_um, weight, still_um[:, None], np.column_stack([
                time_s - time_s[0], np.ones(time_s.size), np.gradient(still_um, time_s)]),
            'the known hysteresis', int(changed[0]), int(changed[0]))
    return _held_points(
        record, time_s, weight, moves, settle_s, span_v, is_settled=is_settled)


def _held_points(
    record: Record, time_s: _Floats, weight: _Floats, moves: NDArray[np.bool_], settle_s: float,
    span_v: float, *, is_settled: bool,
) -> _Points:
    """Return a column for each held voltage, points of moves and of settling left out."""
    voltage_v = record.voltage_v
    starts = np.unique(np.concatenate([[0], np.flatnonzero(moves)]))
    stops = np.append(starts[1:], voltage_v.size)
    held = [
        (int(start), int(stop)) for start, stop in zip(starts, stops, strict=True)
        if time_s[stop - 1] - time_s[start] > 2.0 * settle_s
        and np.ptp(voltage_v[start:stop]) <= _LEVEL_RANGE * span_v]
    share = sum(time_s[stop - 1] - time_s[start] for start, stop in held) / (
        time_s[-1] - time_s[0])
    if share < _HELD_SHARE or len(held) > _MOST_LEVELS:
        raise ValueError(
            f'the voltage is held for {100.0 * share:.0f} % of the record at {len(held)} levels; '
            f'allowed is {100.0 * _HELD_SHARE:.0f} % at least and {_MOST_LEVELS} levels at most, '
            'or tell the hysteresis (--compensator FILE)')
    used = np.zeros(voltage_v.size, dtype=bool)
    levels_v, corner, at = [], [], []
    for start, stop in held:
        part = np.arange(start, stop)
        used[part[time_s[part] - time_s[start] >= (settle_s if start else 0.0)]] = True
        levels_v.append(float(np.median(voltage_v[part])))
        corner += [start, stop - 1]
        at += [len(levels_v) - 1] * 2
    rest_v = levels_v[0] if is_settled else 0.0
    begins_at_rest = abs(levels_v[0] - rest_v) <= _LEVEL_RANGE * span_v and held[0][0] == 0
    # Between two held voltages the stage moves from one level to the other, in proportion.
    columns = np.column_stack([
        np.interp(np.arange(voltage_v.size), corner, np.equal(at, level).astype(np.float64))
        for level in range(len(held))])
    if begins_at_rest:
        columns = columns[:, 1:]
    if not columns.shape[1]:
        raise ValueError('the voltage is held at rest only: creep follows a change of it')
    first = held[1][0] if begins_at_rest else held[0][0]
    method = f'{columns.shape[1]} held voltages' + (
        '' if begins_at_rest else ', the displacement at rest being 0')
    return _Points(
        time_s, record.displacement_um, np.where(used, weight, 0.0), columns,
        np.column_stack([time_s - time_s[0]] + [np.ones(time_s.size)] * begins_at_rest), method,
        first, held[-1][0])
