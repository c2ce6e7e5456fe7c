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
Recorded runs as the hysteresis fits need them: checks, delay, normal equations, cross-validation.

A displacement that lags by d samples behind the voltage, n = floor(d):

    x(k - d) = x_{k-n-1} + s (x_{k-n} - x_{k-n-1}),   s = 1 - (d - n)

Cross-validation: each run is cut into 55 blocks, block b belongs to fold b mod 5. The score of a
fold is its mean squared error under the model that is fitted to the other folds.
"""

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
# Blocks per fold; odd, so that the blocks of a fold meet different phases of a periodic excitation.
_BLOCKS_PER_FOLD: Final = 11
_FEWEST_SAMPLES: Final = 100
# Share of the peak-to-peak voltage by which the voltage must turn back to count as a reversal.
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
        Predict N samples, differentiate those of weight 1 and advance the state.

        The prediction is interpolated between the displacements of the last and the present
        voltage, with the weight ``share`` of the present one. Fills the prediction, shape (N,), and
        the first rows of the Jacobian, shape (N, m); returns the number of rows.
        """


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
    Return the two samples between which each sample of a delayed signal lies.

    Parameters
    ----------
    values : ndarray, shape (N,)
        The signal; it is constant before its first and after its last sample.
    delay_samples : float
        Delay d, negative for an advance.

    Returns
    -------
    later : ndarray, shape (N + 1,)
        The signal delayed by whole samples, with one more sample in front.
    share : float
        ``values[k - d]`` is ``later[k] + share * (later[k + 1] - later[k])``.

    """
    whole = math.floor(delay_samples)
    index = np.arange(-1, values.size) - whole
    return values[np.clip(index, 0, values.size - 1)], 1.0 - (delay_samples - whole)


def accumulate(
    model: ChunkModel, records: Sequence[Record], theta: _Floats,
) -> NormalEquations:
    """
    Return the normal equations of a model over all records.

    Parameters
    ----------
    model : ChunkModel
        The model, with m parameters.
    records : sequence of Record
        The data; only samples of weight 1 count.
    theta : ndarray, shape (m,)
        Parameters.

    """
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
    """
    Return the displacement that a model predicts for every record.

    Parameters
    ----------
    model : ChunkModel
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
    """Run a model through a record; yield slice, prediction and number of rows of the Jacobian."""
    voltage, share = delayed(record.voltage_v, model.delay(theta))
    state = model.initial_state()
    prediction = np.empty(_CHUNK_SAMPLES)
    # The first sample only sets the last voltage and its displacement.
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
    """Return measured minus predicted displacement of all records, NaN where left out."""
    return np.concatenate([
        np.where(record.weight > 0.0, record.displacement_um - prediction, np.nan)
        for record, prediction in zip(records, predictions, strict=True)])


def cross_validate(
    records: Sequence[Record], fit_and_predict: Callable[[Sequence[Record]], list[_Floats]],
) -> _Floats:
    """
    Return the mean squared error of each fold as predicted from the others.

    The folds are interleaved blocks. In a block that is left out the model still follows the
    voltage, as its memory needs it; the displacement there is not used.

    Parameters
    ----------
    records : sequence of Record
        All data.
    fit_and_predict : callable
        Fits a model to the records and returns its predictions for the same records.

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
