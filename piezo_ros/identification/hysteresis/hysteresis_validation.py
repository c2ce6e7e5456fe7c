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
Validation of an identified hysteresis on loops that its fit has not seen, and the verdict.

The record is cut into loops, two branches each; every third one is held out in turn, so that each
is predicted by a fit without it. Only the largest loop is always in the fit: no model knows what
lies beyond it. A record of few loops is cut into blocks instead.

Cross-validation: each run is cut into 55 blocks, block b belongs to fold b mod 5. The score of a
fold is its mean squared error under the model that is fitted to the other folds.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification.hysteresis.levels import (
    SMALLEST_SHARE,
    LevelError,
    branches_of,
    level_errors,
    noise_rms,
)
from piezo_ros.identification.hysteresis.records import Record, concatenated_residual
from piezo_ros.identification.verdict import Verdict

__all__ = ['Validation', 'cross_validate', 'validate', 'verdict_of']

_FOLDS: Final = 3
_BLOCK_FOLDS: Final = 5
# Odd, so that the blocks of a fold meet different phases of a periodic excitation.
_BLOCKS_PER_FOLD: Final = 11
_FEWEST_LOOPS: Final = 4
# Error of a loop, in percent of its span, up to which a model is good, and beyond which it is poor.
GOOD_PERCENT: Final = 0.5
POOR_PERCENT: Final = 2.0
_NAMED_PERCENT: Final = 0.1
_SIGNIFICANT: Final = 5.0  # standard errors
_OTHER_SPEED: Final = 1.5  # ratio of two speeds at one amplitude that tells of rate dependence
_LAG_SAMPLES: Final = 0.5
RATE_DEPENDENCE: Final = 'rate dependence'
_TOO_FEW_ELEMENTS: Final = 0.6  # share of the error that more elements leave

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Validation:
    """
    What a model leaves of loops that it has not seen.

    Attributes
    ----------
    fit_percent : float
        100 (1 - |residual| / |displacement less its mean|), on what is held out.
    levels : tuple of LevelError
        The error of the loops of each amplitude, the smallest first.
    noise_rms_um : float
        Noise of a sample, from the changes of the residual.
    whiteness : float
        Noise over root mean square of the residual: 1 where the residual is noise alone.
    findings : tuple of str
        What was seen in the residual: drift or creep, rate dependence.

    """

    fit_percent: float
    levels: tuple[LevelError, ...]
    noise_rms_um: float
    whiteness: float
    findings: tuple[str, ...]

    @property
    def worst(self) -> LevelError | None:
        """The largest error at an amplitude from 10 % of the largest one on."""
        counted = [level for level in self.levels if level.share >= 0.95 * SMALLEST_SHARE]
        return max(counted, key=lambda level: level.percent, default=None)

    @property
    def hidden(self) -> LevelError | None:
        """The level of which the noise hides most."""
        counted = [level for level in self.levels if level.share >= 0.95 * SMALLEST_SHARE]
        return max(counted, key=lambda level: level.uncertainty_percent, default=None)

    @property
    def order_shares(self) -> _Floats:
        """Share of each order of a scan in what is left of the loops, shape (16,); 0 for none."""
        left = [level.mean_square_um2 for level in self.levels if level.mean_square_um2.any()]
        if not left:
            return np.zeros(0)
        return np.asarray(np.mean([by_order / by_order.sum() for by_order in left], axis=0))

    @property
    def worst_percent(self) -> float:
        """The error of the worst level, percent of its span; 0 for none beyond the noise."""
        return self.worst.percent if self.worst else 0.0


def validate(
    records: Sequence[Record], fit_and_predict: Callable[[Sequence[Record]], list[_Floats]],
) -> Validation:
    """
    Predict every loop by a fit without it.

    Parameters
    ----------
    records : sequence of Record
        The data, weighted by the number of samples that each one stands for.
    fit_and_predict : callable
        Fits a model to records and returns its predictions for the same records.

    """
    residual, held_out = _held_out_residual(records, fit_and_predict)
    displacement = np.concatenate([record.displacement_um for record in records])
    weight = np.concatenate([record.weight for record in records])
    used = held_out & np.isfinite(residual)
    mean = np.average(displacement[used], weights=weight[used])
    left = float(np.sum(weight[used] * residual[used] ** 2))
    whole = float(np.sum(weight[used] * (displacement[used] - mean) ** 2))
    noise_um = noise_rms(records, residual)
    known = np.isfinite(residual)
    rms_um = float(np.sqrt(np.mean(weight[known] * residual[known] ** 2)))
    return Validation(
        100.0 * (1.0 - np.sqrt(left / whole)),
        tuple(level_errors(records, residual, noise_um)), noise_um,
        min(noise_um / rms_um, 1.0) if rms_um > 0.0 else 1.0,
        tuple(_findings(records, residual)))


def _held_out_residual(
    records: Sequence[Record], fit_and_predict: Callable[[Sequence[Record]], list[_Floats]],
) -> tuple[_Floats, NDArray[np.bool_]]:
    """Return the residual, predicted without the sample where it is held out, and where it is."""
    folds = [_loop_folds(record) for record in records]
    held_out = np.concatenate(folds) >= 0
    if sum(np.unique(fold[fold >= 0]).size for fold in folds) < _FOLDS:
        residual = cross_validate(records, fit_and_predict)[1]
        return residual, np.isfinite(residual)
    residual = np.full(held_out.size, np.nan)
    for number in range(_FOLDS):
        masks = [fold == number for fold in folds]
        predicted = np.concatenate(fit_and_predict(_split(records, masks)[0]))
        difference = np.concatenate(
            [record.displacement_um for record in records]) - predicted
        chosen = np.concatenate(masks)
        if number == 0:
            chosen |= ~held_out  # the largest loop, in every fit
        residual = np.where(chosen, difference, residual)
    counted = np.concatenate([record.weight for record in records]) > 0.0
    return np.where(counted, residual, np.nan), held_out & counted


def _loop_folds(record: Record) -> NDArray[np.int64]:
    """Return the fold of each sample, -1 where it is always in the fit."""
    branches = branches_of(record)
    count = branches.amplitude_v.size
    if count // 2 < _FEWEST_LOOPS:
        return np.full(record.voltage_v.size, -1)
    largest = int(np.argmax(branches.amplitude_v > 0.99 * branches.amplitude_v.max()))
    of_branch = (np.arange(count) + 1) // 2 % _FOLDS
    of_branch[:largest + 2] = -1
    return np.asarray(of_branch[branches.number])


def _findings(records: Sequence[Record], residual_um: _Floats) -> list[str]:
    """Return drift or creep and rate dependence, where the residual shows them."""
    findings, start = [], 0
    for record in records:
        part = residual_um[start:start + record.voltage_v.size]
        start += record.voltage_v.size
        findings += [text for text in (_drift(record, part), _rate(record, part)) if text]
    return list(dict.fromkeys(findings))


def _of_branches(record: Record, residual_um: _Floats) -> tuple[_Floats, _Floats]:
    """Return mean residual of each branch's middle half and time of its centre; NaN for none."""
    branches = branches_of(record)
    count = branches.amplitude_v.size
    known = np.isfinite(residual_um)
    number, weight = branches.number[known], record.weight[known]
    samples = np.bincount(number, weight, count)
    with np.errstate(invalid='ignore', divide='ignore'):
        return (
            np.bincount(number, weight * residual_um[known], count) / samples,
            np.bincount(number, weight * record.index[known], count) / samples)


def _drift(record: Record, residual_um: _Floats) -> str:
    mean, time = _of_branches(record, residual_um)
    # Of a rising and a falling branch together, so that no width of a loop is a drift.
    loops, times = 0.5 * (mean[1:] + mean[:-1]), 0.5 * (time[1:] + time[:-1])
    loops, times = loops[1::2], times[1::2]
    known = np.isfinite(loops)
    if known.sum() < _FEWEST_LOOPS:
        return ''
    span_um = float(np.ptp(record.displacement_um[record.measured]))
    change, error = _trend(times[known], loops[known])
    percent = 100.0 * abs(change) / span_um
    if percent < _NAMED_PERCENT or abs(change) < _SIGNIFICANT * error:
        return ''
    return f'the loops move by {percent:.2g} % of the largest over the record: drift or creep'


def _rate(record: Record, residual_um: _Floats) -> str:
    """Compare width and height of what is left at one amplitude and different speeds."""
    branches = branches_of(record)
    share = branches.amplitude_v / branches.amplitude_v.max()
    span_um = share * float(np.ptp(record.displacement_um[record.measured]))
    mean, _ = _of_branches(record, residual_um)
    width = 200.0 * mean * np.where(branches.rising, 1.0, -1.0) / span_um
    height = 200.0 * branches.amplitude_v * _slope_of_branches(record, residual_um) / span_um
    pace = np.log(branches.amplitude_v / branches.samples)
    for name, percents in (('width', width), ('height', height)):
        percent, ratio = _by_pace(np.round(10.0 * share), pace, percents)
        if abs(percent) >= _NAMED_PERCENT:
            more = (percent < 0.0) if name == 'width' else (percent > 0.0)
            return (
                f'{RATE_DEPENDENCE}: at {ratio:.2g} times the speed the {name} of a loop is by '
                f'{abs(percent):.2g} % of its span {"larger" if more else "smaller"}')
    return ''


def _slope_of_branches(record: Record, residual_um: _Floats) -> _Floats:
    """Return the slope of the residual over the voltage on each branch; NaN for none."""
    number = branches_of(record).number
    known = np.isfinite(residual_um)
    number, weight = number[known], record.weight[known]
    voltage, residual = record.voltage_v[known], residual_um[known]
    count = int(branches_of(record).amplitude_v.size)

    def total(values: _Floats) -> _Floats:
        return np.asarray(np.bincount(number, weight * values, count), dtype=np.float64)
    with np.errstate(invalid='ignore', divide='ignore'):
        ones, sum_v = total(np.ones_like(voltage)), total(voltage)
        return np.asarray((total(voltage * residual) - sum_v * total(residual) / ones) / (
            total(voltage**2) - sum_v**2 / ones))


def _by_pace(groups: _Floats, pace: _Floats, percents: _Floats) -> tuple[float, float]:
    """Return the significant change from the slowest to the fastest branch, and their ratio."""
    changes, paces = [], []
    for group in np.unique(groups[groups >= 1.0]):
        alike = np.isfinite(percents) & (groups == group)
        if alike.any() and np.ptp(pace[alike]) > np.log(_OTHER_SPEED):
            # Less the mean at this amplitude: what is left there at any speed is no dependence.
            changes.append(percents[alike] - percents[alike].mean())
            paces.append(pace[alike] - pace[alike].mean())
    if sum(group.size for group in changes) < 2 * _FEWEST_LOOPS:
        return 0.0, 1.0
    change, error = _trend(np.concatenate(paces), np.concatenate(changes))
    ratio = float(np.exp(np.ptp(np.concatenate(paces))))
    return (change if abs(change) >= _SIGNIFICANT * error else 0.0), ratio


def _trend(x: _Floats, y: _Floats) -> tuple[float, float]:
    """Return the change of a straight line over the range of x, and its standard error."""
    centred = x - x.mean()
    squares = float(centred @ centred)
    slope = float(centred @ y) / squares
    left = y - y.mean() - slope * centred
    error = np.sqrt(float(left @ left) / max(y.size - 2, 1) / squares)
    return slope * float(np.ptp(x)), float(error) * float(np.ptp(x))


def verdict_of(
    validation: Validation, elements: int, richer: tuple[int, float] | None, *,
    delay_samples: float = 0.0, coverage_warning: str = '',
) -> Verdict:
    """
    Return how far a hysteresis may be trusted.

    Parameters
    ----------
    validation : Validation
        Of the model.
    elements : int
        Its number of limited elements.
    richer : tuple of (int, float) or None
        A larger number of elements, and the error that they leave, percent of the span; None where
        it is not known.
    delay_samples : float, optional
        Samples by which the displacement lags: dynamics that may ring at the turns.
    coverage_warning : str, optional
        What the record does not cover.

    """
    worst, percent = validation.worst, validation.worst_percent
    findings = validation.findings
    hidden = validation.hidden
    if hidden is not None and hidden.uncertainty_percent > GOOD_PERCENT:
        findings = (*findings, (
            f'the noise may hide {hidden.uncertainty_percent:.2g} % of loops of '
            f'{hidden.amplitude_v:.3g} V: a longer record tells more'))
    coverage = (coverage_warning,) if coverage_warning else ()
    if worst is None or percent <= GOOD_PERCENT:
        text = (
            f'fit {validation.fit_percent:.2f} % on loops held out',
            f'at most {percent:.2g} % of the span left of a loop'
            + (f', ± {hidden.uncertainty_percent:.2g} % by the noise' if hidden else ''),
            *findings)
        if any(finding.startswith(RATE_DEPENDENCE) for finding in findings):
            return Verdict.usable_up_to('the speeds of the record', *coverage, *text)
        return (Verdict.usable_up_to('the range of the record', *coverage, *text) if coverage
                else Verdict.good(*text))
    where = (
        f'{percent:.2g} % of the span is left of loops of {worst.amplitude_v:.3g} V '
        f'({1e3 * worst.span_um * percent / 100.0:.3g} nm)')
    reason = 'the model class is the limit'
    if abs(delay_samples) > _LAG_SAMPLES:
        reason += (
            f', or the dynamics: the displacement lags by {delay_samples:.3g} samples and may ring '
            'at the turns, which a slower record tells')
    if richer is not None and richer[1] < _TOO_FEW_ELEMENTS * percent:
        reason = (f'{elements} elements are too few, {richer[0]} leave {richer[1]:.2g} %: '
                  '--elements auto')
    reasons = (f'{where}: {reason}', *findings, *coverage)
    if percent > POOR_PERCENT:
        return Verdict.poor(*reasons)
    return Verdict.usable_up_to(f'{percent:.2g} % of the amplitude', *reasons)


def cross_validate(
    records: Sequence[Record], fit_and_predict: Callable[[Sequence[Record]], list[_Floats]],
) -> tuple[_Floats, _Floats]:
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
    errors : ndarray, shape (5,)
        Mean squared error of every fold, um^2.
    residual_um : ndarray, shape (N,)
        Measured displacement less that predicted from the other folds, all records.

    """
    errors = np.empty(_BLOCK_FOLDS)
    whole = np.full(sum(record.voltage_v.size for record in records), np.nan)
    for fold in range(_BLOCK_FOLDS):
        inside = [_fold_mask(record, fold) for record in records]
        training, test = _split(records, inside)
        residual = concatenated_residual(test, fit_and_predict(training))
        errors[fold] = np.nanmean(residual ** 2)
        whole = np.where(np.isfinite(residual), residual, whole)
    return errors, whole


def _split(
    records: Sequence[Record], held_out: Sequence[NDArray[np.bool_]],
) -> tuple[list[Record], list[Record]]:
    """Return the records with the weight of what is not held out, and of what is."""
    training = [
        replace(record, weight=np.where(mask, 0.0, record.weight))
        for record, mask in zip(records, held_out, strict=True)]
    test = [
        replace(record, weight=np.where(mask, record.weight, 0.0))
        for record, mask in zip(records, held_out, strict=True)]
    return training, test


def _fold_mask(record: Record, fold: int) -> NDArray[np.bool_]:
    size = record.voltage_v.size
    block = np.arange(size) * (_BLOCK_FOLDS * _BLOCKS_PER_FOLD) // size
    return np.asarray(block % _BLOCK_FOLDS == fold)
