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
Amplitude levels of a record: its branches by their span, and what a model leaves at each of them.

A branch runs from one turn of the voltage to the next; its amplitude is half its span. The residual
of a level is averaged over bins of the voltage, upwards and downwards apart, so that the noise of
the sensor is not taken for a loop that is left. Of the means m_up, m_down with standard errors s::

    error = max(|m_up|, |m_down|, |m_up - m_down|), each less 3 s of it,   in percent of the span

|m_up - m_down| is the width of the loop that the compensation with this model leaves.

A triangle goes through the bins at a constant pace, upwards and then downwards: the means in this
order are one period of what is left of a scan, and their discrete Fourier transform, less the
noise, tells at which orders of the scan it is left.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification.hysteresis.records import Record, reversals_of

__all__ = [
    'Branches',
    'LevelError',
    'branches_of',
    'level_errors',
    'noise_rms',
    'weighted_by_amplitude',
]

_LEVELS: Final = 10
_BINS: Final = 24
_FEWEST_IN_BIN: Final = 3
# Smaller loops count as much as loops of this share of the largest amplitude.
SMALLEST_SHARE: Final = 0.1
_NOISE_MARGIN: Final = 3.0
_PARAMETERS_OF_LOOP: Final = 4
_ORDERS: Final = 16  # of 24 that the bins have; higher ones they average away

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Branches:
    """
    The branches of a record of N samples.

    Attributes
    ----------
    number : ndarray of int, shape (N,)
        Branch of each sample, counted from 0.
    amplitude_v : ndarray, shape (B,)
        Half the span of each branch.
    rising : ndarray of bool, shape (B,)
        Whether the voltage rises on it.
    samples : ndarray, shape (B,)
        How long it lasts, in samples of the recording.

    """

    number: NDArray[np.int64]
    amplitude_v: _Floats
    rising: NDArray[np.bool_]
    samples: _Floats


@dataclass(frozen=True)
class LevelError:
    """
    What a model leaves of the loops of about one amplitude.

    Attributes
    ----------
    amplitude_v : float
        Mean amplitude.
    share : float
        Of the largest amplitude.
    percent : float
        Error beyond the noise, percent of the span of the displacement.
    uncertainty_percent : float
        What the noise may hide beside it, two standard errors of some parameters of the loop.
    span_um : float
        That span.
    mean_square_um2 : ndarray, shape (16,)
        Mean square of what is left, beyond the noise, at the orders 1, 2, ... of a triangle.

    """

    amplitude_v: float
    share: float
    percent: float
    uncertainty_percent: float
    span_um: float
    mean_square_um2: _Floats = field(repr=False, compare=False)


def branches_of(record: Record) -> Branches:
    """Return the branches of a record, the curve before the first turn among them."""
    voltage = record.voltage_v
    ends = np.unique([0, *reversals_of(voltage).tolist(), voltage.size - 1])
    change = np.diff(voltage[ends])
    number = np.clip(
        np.searchsorted(ends, np.arange(voltage.size), side='left') - 1, 0, change.size - 1)
    return Branches(
        number, 0.5 * np.abs(change), change > 0.0, np.diff(record.index[ends]))


def weighted_by_amplitude(records: Sequence[Record]) -> list[Record]:
    """Return the records with more weight on small loops: their relative errors count alike."""
    branches = [branches_of(record) for record in records]
    largest_v = max(float(branch.amplitude_v.max()) for branch in branches)
    return [
        replace(record, weight=record.weight * (
            largest_v / np.maximum(branch.amplitude_v, SMALLEST_SHARE * largest_v)
        )[branch.number] ** 2)
        for record, branch in zip(records, branches, strict=True)]


def noise_rms(records: Sequence[Record], residual_um: _Floats) -> float:
    """Return the noise of a sample of the recording, from the changes of the residual."""
    squares, start = [], 0
    for record in records:
        end = start + record.voltage_v.size
        residual = residual_um[start:end]
        variance = 1.0 / np.maximum(record.weight, 1e-300)
        change = np.diff(residual) / np.sqrt(variance[1:] + variance[:-1])
        squares.append(change[np.isfinite(change) & (record.weight[1:] > 0.0)
                              & (record.weight[:-1] > 0.0)])
        start = end
    changes = np.concatenate(squares)
    return float(np.sqrt(np.mean(changes**2))) if changes.size else 0.0


def level_errors(
    records: Sequence[Record], residual_um: _Floats, noise_rms_um: float,
) -> list[LevelError]:
    """
    Return what is left of the loops at each amplitude, the smallest first.

    Parameters
    ----------
    records : sequence of Record
        The data, weighted by the number of samples that each one stands for.
    residual_um : ndarray, shape (N,)
        Residual of all records, NaN where none is known.
    noise_rms_um : float
        Noise of a sample of the recording.

    """
    branches = [branches_of(record) for record in records]
    largest_v = max(float(branch.amplitude_v.max()) for branch in branches)
    amplitude = np.concatenate([branch.amplitude_v[branch.number] for branch in branches])
    rising = np.concatenate([branch.rising[branch.number] for branch in branches])
    voltage, displacement, weight = (
        np.concatenate([getattr(record, name) for record in records])
        for name in ('voltage_v', 'displacement_um', 'weight'))
    known = np.isfinite(residual_um) & (weight > 0.0)
    level = np.minimum(np.round(_LEVELS * amplitude / largest_v), _LEVELS)
    found = []
    for value in np.unique(level[known & (level >= 1.0)]):
        inside = known & (level == value)
        span_um = float(np.ptp(displacement[inside]))
        if span_um == 0.0:
            continue
        means_um, errors_um = _mean_loop(
            voltage[inside], residual_um[inside], weight[inside], rising[inside], noise_rms_um)
        error_um = _error_um(means_um, errors_um)
        mean_v = float(np.average(amplitude[inside], weights=weight[inside]))
        hidden_um = 2.0 * noise_rms_um * np.sqrt(_PARAMETERS_OF_LOOP / np.sum(weight[inside]))
        found.append(LevelError(
            mean_v, mean_v / largest_v, 100.0 * error_um / span_um,
            100.0 * float(hidden_um) / span_um, span_um, _by_order(means_um, errors_um)))
    return found


def _mean_loop(
    voltage_v: _Floats, residual_um: _Floats, weight: _Floats, rising: NDArray[np.bool_],
    noise_rms_um: float,
) -> tuple[_Floats, _Floats]:
    """Return means and standard errors, upwards and downwards, shape (2, bins); NaN for none."""
    edges = np.linspace(voltage_v.min(), voltage_v.max(), _BINS + 1)
    bins = np.clip(np.searchsorted(edges, voltage_v, side='right') - 1, 0, _BINS - 1)
    offset_um = float(np.average(residual_um, weights=weight))
    means, errors = [], []
    for direction in (True, False):
        chosen = rising == direction
        samples = np.bincount(bins[chosen], weight[chosen], _BINS)
        total = np.bincount(bins[chosen], (weight * (residual_um - offset_um))[chosen], _BINS)
        enough = np.bincount(bins[chosen], minlength=_BINS) >= _FEWEST_IN_BIN
        samples = np.where(enough, samples, np.nan)
        means.append(total / samples)
        errors.append(noise_rms_um / np.sqrt(samples))
    return np.array(means), np.array(errors)


def _error_um(means_um: _Floats, errors_um: _Floats) -> float:
    up, down = np.abs(means_um) - _NOISE_MARGIN * errors_um
    width = np.abs(means_um[0] - means_um[1]) - _NOISE_MARGIN * np.hypot(*errors_um)
    return max([0.0, *(float(v) for v in np.concatenate([up, down, width]) if np.isfinite(v))])


def _by_order(means_um: _Floats, errors_um: _Floats) -> _Floats:
    """Return the mean square of a mean loop at the orders of a triangle, less its noise."""
    period_um = np.concatenate([means_um[0], means_um[1, ::-1]])
    known = np.isfinite(period_um)
    if known.sum() < period_um.size // 2:
        return np.zeros(_ORDERS)
    place = np.arange(period_um.size)
    filled_um = np.interp(place, place[known], period_um[known], period=period_um.size)
    amplitude_um = 2.0 / period_um.size * np.abs(np.fft.rfft(filled_um))[1:_ORDERS + 1]
    noise_um2 = 2.0 * float(np.nanmean(errors_um**2)) / period_um.size
    return np.maximum(0.5 * amplitude_um**2 - noise_um2, 0.0)
