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

"""Recorded voltages and displacements as the hysteresis fits see them, and their folds."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.identification.hysteresis.least_squares import NormalEquations

__all__ = [
    'ChunkModel',
    'Record',
    'accumulate',
    'concatenated_residual',
    'cross_validate',
    'delayed',
    'make_records',
    'predict',
    'reversals_of',
]

FOLDS: Final = 5
# Blocks per fold; odd, so that the blocks of a fold fall on other phases of a periodic excitation.
_BLOCKS_PER_FOLD: Final = 11
_FEWEST_SAMPLES: Final = 100
# Share of the peak-to-peak voltage by which it must come back to count as reversed.
_REVERSAL_SHARE: Final = 0.01
_CHUNK_SAMPLES: Final = 4096  # the Jacobian of a chunk stays in the cache of the processor

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
        1 where a sample counts, 0 where it is left out.
    measured : ndarray of bool, shape (N,)
        Whether the displacement is a finite measurement.

    """

    voltage_v: _Floats
    displacement_um: _Floats
    weight: _Floats
    measured: NDArray[np.bool_]


class ChunkModel(Protocol):
    """A model with memory that predicts and differentiates chunk after chunk."""

    def delay(self, theta: _Floats) -> float:
        """Return the samples by which the displacement lags behind the voltage."""

    def initial_state(self) -> tuple[_Floats, ...]:
        """Return the state of a virgin stage."""

    def fill(
        self, state: tuple[_Floats, ...], theta: _Floats, share: float, voltage_v: _Floats,
        weight: _Floats, prediction_um: _Floats, jacobian: _Floats,
    ) -> int:
        """
        Predict N samples, differentiate those of weight 1 and move the state on.

        The prediction is the displacement of the last voltage and ``share`` of the way to that of
        the present one. Fills the prediction, shape (N,), and the first rows of the Jacobian,
        shape (N, m); returns how many rows.
        """


def make_records(
    voltage_v: ArrayLike | Sequence[ArrayLike], displacement_um: ArrayLike | Sequence[ArrayLike],
    *, virgin: bool = True,
) -> list[Record]:
    """
    Check what was recorded and return it as records.

    Parameters
    ----------
    voltage_v, displacement_um : array_like, shape (N,), or sequence of such
        One run, or several. A displacement that is not finite is left out.
    virgin : bool, optional
        Whether every run starts from a virgin stage; if not, what precedes the largest voltage is
        left out, for there the stage forgets its past.

    Raises
    ------
    ValueError
        If the shapes do not belong together, a voltage is not finite, samples are too few, or
        the voltage does not move.

    """
    voltages, displacements = _as_list(voltage_v), _as_list(displacement_um)
    if len(voltages) != len(displacements):
        raise ValueError(
            f'voltage_v has {len(voltages)} runs and displacement_um {len(displacements)}')
    return [
        _record(index, voltage, displacement, virgin)
        for index, (voltage, displacement) in enumerate(zip(voltages, displacements, strict=True))
    ]


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
    if measured.sum() < _FEWEST_SAMPLES:
        raise ValueError(
            f'run {index}: displacement_um has {int(measured.sum())} finite samples, at least '
            f'{_FEWEST_SAMPLES} are needed')
    if np.ptp(voltage) == 0.0:
        raise ValueError(
            f'run {index}: voltage_v is constant at {voltage[0]} V, it must move through its range')
    weight = measured.astype(np.float64)
    if not virgin:
        weight[:np.argmax(np.abs(voltage))] = 0.0
    return Record(voltage, np.where(measured, displacement, 0.0), weight, measured)


def reversals_of(voltage_v: _Floats) -> NDArray[np.int64]:
    """Return the indices at which the voltage turns by more than 1 % of its peak-to-peak."""
    from piezo_ros.identification.hysteresis.kernels import find_reversals
    indices = np.empty(voltage_v.size, dtype=np.int64)
    count = find_reversals(voltage_v, _REVERSAL_SHARE * float(np.ptp(voltage_v)), indices)
    return indices[:count]


def delayed(values: _Floats, delay_samples: float) -> tuple[_Floats, float]:
    """
    Return what a delayed signal lies between.

    Parameters
    ----------
    values : ndarray, shape (N,)
        The signal; before its first and behind its last sample it is held.
    delay_samples : float
        Delay d, negative for an advance.

    Returns
    -------
    later : ndarray, shape (N + 1,)
        The signal by whole samples, one sample more in front.
    share : float
        ``values[k - d]`` is ``later[k] + share * (later[k + 1] - later[k])``.

    """
    whole = math.floor(delay_samples)
    index = np.arange(-1, values.size) - whole
    return values[np.clip(index, 0, values.size - 1)], 1.0 - (delay_samples - whole)


def accumulate(
    model: ChunkModel, records: Sequence[Record], theta: _Floats,
) -> NormalEquations:
    """Return the normal equations of a model over all records."""
    size = theta.size
    cost, gradient, curvature, samples = 0.0, np.zeros(size), np.zeros((size, size)), 0
    jacobian = np.empty((_CHUNK_SAMPLES, size))
    for record in records:
        for chunk, predicted, count in _chunks(model, record, theta, record.weight, jacobian):
            rows = jacobian[:count]
            residual = (record.displacement_um[chunk] - predicted)[record.weight[chunk] > 0.0]
            cost += float(residual @ residual)
            gradient += rows.T @ residual
            curvature += rows.T @ rows
            samples += count
    return NormalEquations(cost, gradient, curvature, samples)


def predict(model: ChunkModel, records: Sequence[Record], theta: _Floats) -> list[_Floats]:
    """Return the displacement that a model predicts for every record, micrometres."""
    no_rows = np.empty((0, theta.size))
    return [
        np.concatenate([
            predicted.copy() for _, predicted, _ in _chunks(
                model, record, theta, np.zeros_like(record.weight), no_rows)])
        for record in records
    ]


def _chunks(
    model: ChunkModel, record: Record, theta: _Floats, weight: _Floats, jacobian: _Floats,
) -> Iterator[tuple[slice, _Floats, int]]:
    """Run a model through a record; yield slice, prediction and rows of the Jacobian."""
    voltage, share = delayed(record.voltage_v, model.delay(theta))
    state = model.initial_state()
    prediction = np.empty(_CHUNK_SAMPLES)
    # Only to have a last voltage and its displacement.
    model.fill(state, theta, share, voltage[:1], np.zeros(1), prediction, jacobian)
    for first in range(0, weight.size, _CHUNK_SAMPLES):
        chunk = slice(first, min(first + _CHUNK_SAMPLES, weight.size))
        part = prediction[:chunk.stop - first]
        count = model.fill(
            state, theta, share, voltage[first + 1:chunk.stop + 1], weight[chunk], part, jacobian)
        yield chunk, part, count


def concatenated_residual(
    records: Sequence[Record], predictions: Sequence[_Floats],
) -> _Floats:
    """Return measured less predicted displacement of all records, nan where left out."""
    return np.concatenate([
        np.where(record.weight > 0.0, record.displacement_um - prediction, np.nan)
        for record, prediction in zip(records, predictions, strict=True)])


def cross_validate(
    records: Sequence[Record], fit_and_predict: Callable[[Sequence[Record]], list[_Floats]],
) -> _Floats:
    """
    Return the mean squared error of each fold as predicted from the others.

    The folds interleave in blocks; the model's memory runs through left-out blocks, whose voltage
    it may see but not their displacement.

    Parameters
    ----------
    records : sequence of Record
        All data.
    fit_and_predict : callable
        Records to the predictions for the same records by the model fitted to them.

    Returns
    -------
    ndarray, shape (5,)
        Mean squared error of every fold, um^2.

    """
    errors = np.empty(FOLDS)
    for fold in range(FOLDS):
        inside = [_fold_mask(record, fold) for record in records]
        training = [
            replace(record, weight=np.where(mask, 0.0, record.weight))
            for record, mask in zip(records, inside, strict=True)]
        test = [
            replace(record, weight=np.where(mask, record.weight, 0.0))
            for record, mask in zip(records, inside, strict=True)]
        errors[fold] = np.nanmean(
            concatenated_residual(test, fit_and_predict(training)) ** 2)
    return errors


def _fold_mask(record: Record, fold: int) -> NDArray[np.bool_]:
    block = np.arange(record.voltage_v.size) * (FOLDS * _BLOCKS_PER_FOLD) // record.voltage_v.size
    return np.asarray(block % FOLDS == fold)
