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

"""Recorded runs as the hysteresis fits need them: checks, reduction, normal equations."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.identification.estimation.least_squares import NormalEquations

__all__ = [
    'Record',
    'RecordModel',
    'accumulate',
    'concatenated_residual',
    'make_records',
    'predict',
    'record_of_blocks',
    'reduced',
    'refuse_single_branches',
    'reversals_of',
    'turns_of',
    'without_first_rise',
]

_FEWEST_SAMPLES: Final = 100
# Share of the peak-to-peak voltage by which the voltage must turn back to count as a reversal.
_REVERSAL_SHARE: Final = 0.01
# Longer records are averaged over bins to so many samples, beside their turns.
_MOST_SAMPLES: Final = 200_000
# Bins with turns of which all samples stay, one after another, where there are too many of them.
_WHOLE_TOGETHER: Final = 4
# A voltage with more turns than that is a noisy reading: it turns where it does by this many times
# the noise.
_MOST_TURNS: Final = 20_000
_NOISE_BAND: Final = 10.0

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Record:
    """
    One run of N samples, from a virgin stage on.

    Attributes
    ----------
    voltage_v : ndarray, shape (N,)
        Voltage.
    displacement_um : ndarray, shape (N,)
        Measured displacement; any number where the weight is 0.
    weight : ndarray, shape (N,)
        How many samples of the recording it stands for, 0 where it is left out.
    measured : ndarray of bool, shape (N,)
        Whether the displacement is a finite measurement.
    index : ndarray, shape (N,)
        When it was taken, rising, in samples of the recording; not an integer for a mean.
    virgin : bool
        Whether the stage was virgin at the first sample; if not, the largest voltage begins it.
    lost : int
        Samples of the recording without a finite displacement.

    """

    voltage_v: _Floats
    displacement_um: _Floats
    weight: _Floats
    measured: NDArray[np.bool_]
    index: _Floats
    virgin: bool = True
    lost: int = 0

    @property
    def reach_v(self) -> float:
        """Largest threshold of a play that moves: half the span of a branch, or a virgin curve."""
        if self.virgin:
            return float(np.max(np.abs(self.voltage_v)))
        return 0.5 * float(np.ptp(self.voltage_v[np.argmax(np.abs(self.voltage_v)):]))


class RecordModel(Protocol):
    """A model with memory that predicts a record and differentiates by its parameters."""

    def add(
        self, record: Record, theta: _Floats, gradient: _Floats, curvature: _Floats,
    ) -> float:
        """Add J'We to the gradient, J'WJ to the curvature (upper triangle); return e'We."""

    def predict(self, record: Record, theta: _Floats) -> _Floats:
        """Return the displacement at every sample, shape (N,)."""


def make_records(
    voltage_v: ArrayLike | Sequence[ArrayLike], displacement_um: ArrayLike | Sequence[ArrayLike],
    *, virgin: bool = True,
) -> list[Record]:
    """
    Check recorded runs and return them as records.

    Parameters
    ----------
    voltage_v, displacement_um : array_like, shape (N,), or sequence of such
        One run, or several. A displacement that is not finite is left out.
    virgin : bool, optional
        Whether every run starts from a virgin stage; if not, the samples before the largest voltage
        are left out, because the largest voltage erases the earlier history.

    Raises
    ------
    ValueError
        If the shapes do not match, a voltage is not finite, samples are too few, or the voltage is
        constant.

    """
    voltages, displacements = _as_list(voltage_v), _as_list(displacement_um)
    if len(voltages) != len(displacements):
        raise ValueError(
            f'voltage_v has {len(voltages)} runs and displacement_um {len(displacements)}')
    return [
        _record(index, *streams, virgin)
        for index, streams in enumerate(zip(voltages, displacements, strict=True))]


def refuse_single_branches(records: Sequence[Record]) -> None:
    """
    Refuse records without a turn that could tell hysteresis from a curved characteristic.

    Raises
    ------
    ValueError
        If the voltage of no record turns; of a used stage, after its largest value.

    """
    for record in records:
        begin = 0 if record.virgin else int(np.argmax(np.abs(record.voltage_v)))
        turns = reversals_of(record.voltage_v)
        if np.any(turns > begin):
            return
    voltage_v = records[0].voltage_v
    largest_v = voltage_v[np.argmax(np.abs(voltage_v))]
    where = ('does not turn' if records[0].virgin
             else f'does not turn after its largest value, {largest_v:g} V')
    raise ValueError(
        f'voltage_v {where}: a single branch cannot tell hysteresis from a curved characteristic, '
        'so that no loop is identified; at least one further turn is needed'
        + ('' if records[0].virgin else ', or a run from a virgin stage'))


def _as_list(values: ArrayLike | Sequence[ArrayLike]) -> list[_Floats]:
    if isinstance(values, list | tuple) and len(values) and np.ndim(values[0]) > 0:
        return [np.ascontiguousarray(value, dtype=np.float64) for value in values]
    return [np.ascontiguousarray(values, dtype=np.float64)]


def _record(index: int, voltage: _Floats, displacement: _Floats, virgin: bool) -> Record:
    if voltage.ndim != 1 or voltage.shape != displacement.shape:
        raise ValueError(
            f'run {index}: voltage_v has shape {voltage.shape} and displacement_um '
            f'{displacement.shape}, they must be one-dimensional and equally long')
    finite = np.isfinite(voltage)
    if not finite.all():
        first = int(np.argmin(finite))
        raise ValueError(f'run {index}: voltage_v[{first}] is {voltage[first]}, it must be finite')
    measured = np.isfinite(displacement)
    _refuse_too_little(index, voltage, measured)
    record = Record(
        voltage, np.where(measured, displacement, 0.0), measured.astype(np.float64), measured,
        np.arange(voltage.size, dtype=np.float64), virgin, int((~measured).sum()))
    return record if virgin else _from_largest_voltage(record)


def _refuse_too_little(
    index: int, voltage: _Floats, measured: NDArray[np.bool_],
) -> None:
    if measured.sum() < _FEWEST_SAMPLES:
        raise ValueError(
            f'run {index}: displacement_um has {int(measured.sum())} finite samples, at least '
            f'{_FEWEST_SAMPLES} are needed')
    if np.ptp(voltage) == 0.0:
        raise ValueError(
            f'run {index}: voltage_v is constant at {voltage[0]} V, it must move through its range')


def _from_largest_voltage(record: Record) -> Record:
    """Return the record of a used stage without weight before the largest voltage."""
    weight = record.weight.copy()
    weight[:np.argmax(np.abs(record.voltage_v))] = 0.0
    return replace(record, weight=weight)


def without_first_rise(record: Record) -> Record:
    """Return the loops of a virgin stage alone: no weight before the largest voltage."""
    return replace(_from_largest_voltage(record), virgin=False)


def record_of_blocks(
    blocks: Iterable[tuple[_Floats, _Floats]], samples: int, *, virgin: bool = True,
    every: int = 1,
) -> Record:
    """
    Return one run as a reduced record, from blocks that need not be in memory together.

    Parameters
    ----------
    blocks : iterable of (ndarray, ndarray)
        Voltage and displacement of consecutive samples, each of shape (B,).
    samples : int
        Samples of all blocks.
    virgin : bool, optional
        As for `make_records`.
    every : int, optional
        Samples in a bin at least, of which the mean is taken; see `reduced` for those at turns.

    Raises
    ------
    ValueError
        As `make_records`, and if ``every`` leaves too few samples.

    """
    if not 1 <= every <= max(samples // _FEWEST_SAMPLES, 1):
        raise ValueError(
            f'every is {every}, allowed is 1 … {max(samples // _FEWEST_SAMPLES, 1)} for {samples} '
            'samples')
    length = max(every, -(-samples // _MOST_SAMPLES))
    parts, start = [], 0
    for voltage, displacement in blocks:
        finite = np.isfinite(voltage)
        if not finite.all():
            first = int(np.argmin(finite))
            raise ValueError(
                f'voltage_v[{start + first}] is {voltage[first]}, it must be finite')
        measured = np.isfinite(displacement)
        parts.append(_in_bins(Record(
            voltage, np.where(measured, displacement, 0.0), measured.astype(np.float64), measured,
            start + np.arange(voltage.size, dtype=np.float64), virgin, int((~measured).sum())),
            length, -(-_MOST_SAMPLES * voltage.size // samples)))
        start += voltage.size
    record = Record(
        np.concatenate([part.voltage_v for part in parts]),
        np.concatenate([part.displacement_um for part in parts]),
        np.concatenate([part.weight for part in parts]),
        np.concatenate([part.measured for part in parts]),
        np.concatenate([part.index for part in parts]),
        virgin, sum(part.lost for part in parts))
    _refuse_too_little(0, record.voltage_v, record.measured)
    return record if virgin else _from_largest_voltage(record)


def reduced(record: Record, samples: int = _MOST_SAMPLES) -> Record:
    """
    Return a record of about so many samples: means over bins, and every sample about a turn.

    Along a branch the displacement of the model is a straight line but for some bends, so that the
    mean over a bin tells what its samples tell. A bin in which the voltage turns stays as it is.
    Where turns follow each other so fast that more than so many samples would stay, only some of
    these bins do, evenly spread; the others have no weight and tell the voltage alone.

    Parameters
    ----------
    record : Record
        The data.
    samples : int, optional
        Bins at most.

    """
    return _in_bins(record, -(-record.voltage_v.size // samples), samples)


def _in_bins(record: Record, length: int, most_whole: int) -> Record:
    """Return the means over bins of so many samples, and every sample of those with a turn."""
    size = record.voltage_v.size
    if length == 1:
        return record
    bins = -(-size // length)
    kept = np.zeros(bins, dtype=np.bool_)
    turns = turns_of(record.voltage_v)
    for neighbour in (-1, 0, 1):
        kept[np.clip(turns + neighbour, 0, size - 1) // length] = True
    kept[[0, -1]] = True
    dropped = _dropped(kept, most_whole // length)
    turns = turns[dropped[turns // length]]
    first = np.arange(bins) * length
    # A bin of its own for each sample about a turn, or for the turn alone.
    starts = np.unique(np.concatenate([
        first, (first[kept & ~dropped, np.newaxis] + np.arange(length)).ravel(), turns, turns + 1]))
    starts = starts[starts < size]
    count = np.diff(starts, append=size)
    weight = np.add.reduceat(record.weight, starts)
    used = np.maximum(weight, np.finfo(np.float64).tiny)

    def mean(values: _Floats) -> _Floats:
        # Where nothing counts, of all samples; of those that count otherwise.
        plain = np.add.reduceat(values, starts) / count
        weighted = np.add.reduceat(values * record.weight, starts) / used
        return np.where(weight > 0.0, weighted, plain)

    return Record(
        mean(record.voltage_v), mean(record.displacement_um),
        np.where(dropped[starts // length], 0.0, weight),
        np.logical_or.reduceat(record.measured, starts), mean(record.index),
        record.virgin, record.lost)


def _dropped(kept: NDArray[np.bool_], most: int) -> NDArray[np.bool_]:
    """Return which of the bins that shall stay as they are have to go, if most may stay."""
    dropped = np.zeros_like(kept)
    places = np.flatnonzero(kept)
    if places.size > most:
        together = np.arange(places.size) // _WHOLE_TOGETHER
        dropped[places[together % -(-places.size // max(most, 1)) != 0]] = True
    return dropped


def turns_of(voltage_v: _Floats) -> NDArray[np.int64]:
    """Return the indices at which the voltage turns; of a noisy reading those beyond the noise."""
    change = np.diff(voltage_v)
    moving = np.flatnonzero(change)
    turns = 1 + moving[:-1][change[moving[:-1]] * change[moving[1:]] < 0.0]
    if turns.size <= _MOST_TURNS:
        return turns
    noise_v = float(np.median(np.abs(np.diff(change)))) / (0.6745 * np.sqrt(6.0))
    band_v = max(_NOISE_BAND * noise_v, 1e-6 * float(np.ptp(voltage_v)))
    from piezo_ros.identification.hysteresis.fit_kernels import find_reversals
    indices = np.empty(voltage_v.size, dtype=np.int64)
    return indices[:find_reversals(voltage_v, band_v, indices)]


def reversals_of(voltage_v: _Floats) -> NDArray[np.int64]:
    """Return the indices at which the voltage turns by more than 1 % of its peak-to-peak."""
    from piezo_ros.identification.hysteresis.fit_kernels import find_reversals
    indices = np.empty(voltage_v.size, dtype=np.int64)
    count = find_reversals(voltage_v, _REVERSAL_SHARE * float(np.ptp(voltage_v)), indices)
    return indices[:count]


def accumulate(
    model: RecordModel, records: Sequence[Record], theta: _Floats,
) -> NormalEquations:
    """
    Return the normal equations of a model over all records.

    Parameters
    ----------
    model : RecordModel
        The model, with m parameters.
    records : sequence of Record
        The data; only samples with weight count.
    theta : ndarray, shape (m,)
        Parameters.

    """
    size = theta.size
    gradient, curvature = np.zeros(size), np.zeros((size, size))
    cost = sum(model.add(record, theta, gradient, curvature) for record in records)
    lower = np.tril_indices(size, -1)
    curvature[lower] = curvature.T[lower]
    samples = sum(int(np.count_nonzero(record.weight)) for record in records)
    return NormalEquations(cost, gradient, curvature, samples)


def predict(model: RecordModel, records: Sequence[Record], theta: _Floats) -> list[_Floats]:
    """
    Return the displacement that a model predicts for every record.

    Parameters
    ----------
    model : RecordModel
        The model, with m parameters.
    records : sequence of Record
        The data; only the voltage is used.
    theta : ndarray, shape (m,)
        Parameters.

    Returns
    -------
    list of ndarray, shape (N,)
        Displacement of each record, micrometres.

    """
    return [model.predict(record, theta) for record in records]


def concatenated_residual(
    records: Sequence[Record], predictions: Sequence[_Floats],
) -> _Floats:
    """Return measured minus predicted displacement of all records, NaN where left out."""
    return np.concatenate([
        np.where(record.weight > 0.0, record.displacement_um - prediction, np.nan)
        for record, prediction in zip(records, predictions, strict=True)])
