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
What a stage would do without creep, at the points of a record: held voltages or a hysteresis.

A held voltage has a column that is 1 while it is held and 0 while another one is, with a straight
line between; a known hysteresis has the one column of its displacement.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification.hysteresis.records import Record
from piezo_ros.model.hysteresis import HysteresisParameters
from piezo_ros.model.hysteresis_and_inverse import MaxwellResistiveCapacitor

__all__ = ['CreepPoints', 'creep_points']

_SAME_VOLTAGE: Final = 1e-4  # of the span: smaller changes from sample to sample are none
_LEVEL_RANGE: Final = 1e-2  # of the span, within one held voltage
_MOST_LEVELS: Final = 100
_HELD_SHARE: Final = 0.5  # of the record, from which the held voltages are enough

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CreepPoints:
    """What is fitted: times, measured displacement, its weight, and the columns without creep."""

    time_s: _Floats  # (N,)
    displacement_um: _Floats
    weight: _Floats
    columns: _Floats  # (N, K)
    beside: _Floats  # (N, B) drift, and what else is fitted linearly
    method: str
    changed: int  # point at which the voltage first moves
    last_change: int


def creep_points(
    record: Record, sample_period_s: float, hysteresis: HysteresisParameters | None,
    settle_s: float, is_settled: bool,
) -> CreepPoints:
    """
    Return the points of a record.

    Parameters
    ----------
    record, sample_period_s, hysteresis, settle_s, is_settled
        As for `piezo_ros.identification.creep.creep_fit.fit_creep`.

    Raises
    ------
    ValueError
        If the voltage does not change, or is neither held nor a hysteresis given.

    """
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
        return CreepPoints(
            time_s, record.displacement_um, weight, still_um[:, None], np.column_stack([
                time_s - time_s[0], np.ones(time_s.size), np.gradient(still_um, time_s)]),
            'the known hysteresis', int(changed[0]), int(changed[0]))
    return _held_points(
        record, time_s, weight, moves, settle_s, span_v, is_settled=is_settled)


def _held_points(
    record: Record, time_s: _Floats, weight: _Floats, moves: NDArray[np.bool_], settle_s: float,
    span_v: float, *, is_settled: bool,
) -> CreepPoints:
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
    return CreepPoints(
        time_s, record.displacement_um, np.where(used, weight, 0.0), columns,
        np.column_stack([time_s - time_s[0]] + [np.ones(time_s.size)] * begins_at_rest), method,
        first, held[-1][0])
