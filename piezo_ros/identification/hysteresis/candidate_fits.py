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
Fits of a number of MRC elements to records, the best of which is taken.

A symmetric fit comes first. Where it leaves more than 0.1 % of a loop, what real stages have
beside the elements is looked for: loops that are not symmetric, a drift, a first rise that is not
that of the loops. It is taken where it leaves at most 0.7 of what was left without it.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification.hysteresis.asymmetry_fit import (
    AsymmetricFit,
    fit_asymmetric,
    refit_asymmetric,
)
from piezo_ros.identification.hysteresis.hysteresis_validation import Validation, validate
from piezo_ros.identification.hysteresis.levels import level_errors
from piezo_ros.identification.hysteresis.mrc_fit import drift_rate, fit_mrc, number_of_plays
from piezo_ros.identification.hysteresis.mrc_start import Preparation, prepare
from piezo_ros.identification.hysteresis.records import (
    Record,
    concatenated_residual,
    without_first_rise,
)

__all__ = [
    'FURTHER_PERCENT', 'CandidateFit', 'best_candidate', 'better_candidate', 'error_of_elements',
]

_FOLD_STEPS: Final = 20  # a fold starts from the fit to all data
_FOLD_ROUNDS: Final = 2
# More than elements is looked for where these leave more than that of a loop, and taken where it
# leaves at most this share of it.
FURTHER_PERCENT: Final = 0.1
_FURTHER_GAIN: Final = 0.7
_AS_WELL: Final = 1.02  # factor of what is missed of all held-out loops, which is as good
_DRIFT_STEPS: Final = 3
_REFITS: Final = 2  # with an asymmetry, from the starts that it gives
_SIGNIFICANT: Final = 5.0  # standard errors

_Floats = NDArray[np.float64]


class CandidateFit(NamedTuple):
    """A fit, the records that it is for (less a drift, um per sample) and its validation."""

    few: list[Record]
    weighted: list[Record]  # with more weight on small loops
    preparation: Preparation
    fit: AsymmetricFit
    validation: Validation
    drift_um: float = 0.0

    def judged(self, preparation: Preparation, fit: AsymmetricFit) -> 'CandidateFit':
        """Return another fit to these records with its validation."""
        return self._replace(
            preparation=preparation, fit=fit, validation=_validation(self.few, preparation, fit))

    @property
    def settled(self) -> list[Record]:
        """The records without what is left out after turns, each sample counting as one."""
        return _settled(self.few, self.preparation)

    def as_fitted(self, records: Sequence[Record]) -> list[Record]:
        """Return whole records as they are fitted: without drift, or without the first rise."""
        if all(record.voltage_v is other.voltage_v for record, other in zip(
                records, self.few, strict=True)):
            return self.settled
        found = _without_drift(records, self.drift_um)
        if records[0].virgin and not self.few[0].virgin:
            found = [without_first_rise(record) for record in found]
        return found

    def with_finding(self, finding: str) -> 'CandidateFit':
        """Return it with one more finding."""
        return self._replace(validation=replace(
            self.validation, findings=(finding, *self.validation.findings)))


def _candidate(
    few: list[Record], weighted: list[Record], elements: int, drift_um: float = 0.0,
) -> CandidateFit:
    """Return the symmetric fit of records with a drift that is known."""
    few, weighted = _without_drift(few, drift_um), _without_drift(weighted, drift_um)
    preparation, fit = _best_symmetric(few, weighted, elements)
    return CandidateFit(
        few, weighted, preparation, fit, _validation(few, preparation, fit), drift_um)


def best_candidate(few: list[Record], weighted: list[Record], elements: int) -> CandidateFit:
    """
    Return the best fit of so many elements: symmetric or not, with a drift or without.

    Parameters
    ----------
    few : list of Record
        The data, each sample counting as one.
    weighted : list of Record
        The same with more weight on small loops.
    elements : int
        Number of elements.

    """
    best = _candidate(few, weighted, elements)
    if best.validation.worst_percent <= FURTHER_PERCENT:
        return best
    best = _with_asymmetry_or_drift(best)
    if best.validation.worst_percent <= FURTHER_PERCENT or not few[0].virgin:
        return best
    return _of_loops_alone(best, few, weighted)


def _with_asymmetry_or_drift(plain: CandidateFit) -> CandidateFit:
    """Return the fit with an asymmetry or without a drift, where the data ask for it."""
    best = better_candidate(plain, _asymmetric(plain))
    steady, drift_um = plain, 0.0
    for _ in range(_DRIFT_STEPS):
        change_um, error_um = drift_rate(steady.preparation.records, steady.fit.theta)
        if abs(change_um) < _SIGNIFICANT * error_um:
            break
        drift_um += change_um
        steady = _candidate(plain.few, plain.weighted, number_of_plays(plain.fit.theta), drift_um)
    if not drift_um:
        return best
    samples = max(float(np.ptp(record.index)) for record in plain.few)
    return better_candidate(best, steady.with_finding(
        f'a drift of {1e3 * drift_um * samples:.3g} nm over the record is taken out'))


def _asymmetric(plain: CandidateFit) -> CandidateFit:
    """Return the best fit with a map behind the plays; the symmetric one where there is none."""
    preparation = plain.preparation
    best = fit_asymmetric(preparation.records, plain.fit, preparation.delay_bounds)
    if best is None:
        return plain
    for _ in range(_REFITS):
        again = refit_asymmetric(plain.weighted, best)
        if again is None or (
                _left_um(again[1], again[0].records) >= _left_um(best, preparation.records)):
            break
        preparation, best = again
    return plain.judged(preparation, best)


def _of_loops_alone(
    best: CandidateFit, few: Sequence[Record], weighted: Sequence[Record],
) -> CandidateFit:
    """
    Return the fit without the first rise, where that contradicts the loops.

    It does where the stage lags by other voltages upwards and downwards, and where it was not
    virgin. Most of the data must be loops behind it.
    """
    loops_of_few = [without_first_rise(record) for record in few]
    if _samples(loops_of_few) <= 0.5 * _samples(few):
        return best
    plain = _candidate(
        loops_of_few, [without_first_rise(record) for record in weighted],
        number_of_plays(best.fit.theta))
    other = _with_asymmetry_or_drift(plain)
    loops = other.settled
    noise_um = other.validation.noise_rms_um
    if _left_um(other.fit, loops, noise_um) > _FURTHER_GAIN * _left_um(best.fit, loops, noise_um):
        return best
    return other.with_finding('the first rise contradicts the loops and is left out')


def _samples(records: Sequence[Record]) -> float:
    return sum(float(record.weight.sum()) for record in records)


def _left_um(
    fit: AsymmetricFit, records: Sequence[Record], noise_rms_um: float = 0.0,
) -> float:
    """Return what a fit leaves of records about its mean, rms beyond the noise of a sample, um."""
    residual = concatenated_residual(records, fit.predict(records))
    known = np.isfinite(residual)
    weight = np.concatenate([record.weight for record in records])[known]
    mean = float(np.average(residual[known], weights=weight))
    squares = float(np.sum(weight * (residual[known] - mean)**2))
    return math.sqrt(max(squares - weight.size * noise_rms_um**2, 0.0) / float(weight.sum()))


def better_candidate(simple: CandidateFit, other: CandidateFit) -> CandidateFit:
    """Return the other fit where it leaves clearly less of a loop, and no more of all of them."""
    one, two = simple.validation, other.validation
    is_better = two.worst_percent < _FURTHER_GAIN * one.worst_percent and (
        100.0 - two.fit_percent < _AS_WELL * (100.0 - one.fit_percent))
    return other if is_better else simple


def _without_drift(records: Sequence[Record], drift_um: float) -> list[Record]:
    return [
        replace(record, displacement_um=record.displacement_um - drift_um * record.index)
        for record in records] if drift_um else list(records)


def _best_symmetric(
    few: Sequence[Record], weighted: Sequence[Record], elements: int,
) -> tuple[Preparation, AsymmetricFit]:
    """
    Return the best MRC fit with more weight on small loops, and the records that it is for.

    The sum of squares has several minima: the search starts where the large loops have their
    plays, and where the small ones have them.
    """
    virgin = few[0].virgin
    plain = prepare(few, [elements], virgin=virgin)
    of_small = prepare(weighted, [elements], virgin=virgin)
    preparation = of_small._replace(delay_bounds=plain.delay_bounds)
    return preparation, min(
        (_symmetric(preparation, start.starts[elements]) for start in (plain, of_small)),
        key=lambda fit: fit.normal.cost)


def _symmetric(
    preparation: Preparation, start: _Floats, steps: int = 200,
    records: Sequence[Record] | None = None,
) -> AsymmetricFit:
    """Return the MRC fit, as one without a map."""
    fit = fit_mrc(
        preparation.records if records is None else records, start, preparation.delay_bounds, steps)
    return AsymmetricFit.symmetric(fit)


def _validation(
    few: Sequence[Record], preparation: Preparation, fit: AsymmetricFit,
) -> Validation:
    """Validate a fit on the samples that count for it, without the weight on small loops."""
    level = {
        id(record.voltage_v): settled.weight / np.maximum(record.weight, 1e-300)
        for record, settled in zip(few, preparation.records, strict=True)}

    def fit_and_predict(training: Sequence[Record]) -> list[_Floats]:
        weighted = [
            replace(record, weight=record.weight * level[id(record.voltage_v)])
            for record in training]
        found: AsymmetricFit | None
        if fit.weight.size:
            found = fit_asymmetric(
                weighted, fit, preparation.delay_bounds, _FOLD_ROUNDS)
        else:
            found = _symmetric(preparation, fit.theta, _FOLD_STEPS, weighted)
        return (found or fit).predict(training)
    return validate(_settled(few, preparation), fit_and_predict)


def _settled(few: Sequence[Record], preparation: Preparation) -> list[Record]:
    """Return the records without what is left out after turns, each sample counting as one."""
    return [
        replace(record, weight=np.where(settled.weight > 0.0, record.weight, 0.0))
        for record, settled in zip(few, preparation.records, strict=True)]


def error_of_elements(best: CandidateFit, elements: int) -> float:
    """Return what is left of a loop with another number of elements, percent of its span."""
    few = best.few
    preparation = prepare(best.weighted, [elements], virgin=few[0].virgin)
    fit = _symmetric(preparation, preparation.starts[elements], _FOLD_STEPS)
    if best.fit.weight.size:
        fit = fit_asymmetric(preparation.records, fit, preparation.delay_bounds) or fit
    records = _settled(few, preparation)
    levels = level_errors(
        records, concatenated_residual(records, fit.predict(records)),
        best.validation.noise_rms_um)
    return replace(best.validation, levels=tuple(levels)).worst_percent
