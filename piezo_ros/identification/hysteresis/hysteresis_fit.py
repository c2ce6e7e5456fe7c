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
Identification of the MRC hysteresis from recorded voltage and displacement, with standard errors.

With Jacobian J of the prediction, residual e of N samples, m free parameters theta = (p, r, delay,
offset) and autocorrelation rho of the residual:

    covariance(theta) = (J'J)^(-1) (e'e / (N - m)) (1 + 2 sum_j rho_j)

The sum ends at the first lag where rho is not positive. Samples of small loops weigh more, by
W = diag(w): (J'J)^(-1) is then (J'WJ)^(-1) J'W^2 J (J'WJ)^(-1). The standard errors of (kappa, u_S)
follow by the derivatives of `elements_of_plays`.

Examples
--------
>>> from piezo_ros.model import MaxwellResistiveCapacitor
>>> time = np.arange(4000) / 500.0
>>> voltage_v = 4.0 * (1.0 - time / 8.0) * np.sin(2.0 * np.pi * time)
>>> stage = MaxwellResistiveCapacitor((4.0, 15.0, 1.3), (0.05, 0.2))
>>> displacement_um = stage.forward(voltage_v)[0]
>>> fit = fit_hysteresis(voltage_v, displacement_um, elements=2)
>>> np.round(fit.parameters.kappa_um_per_v, 3)
array([ 4. , 15. ,  1.3])
>>> np.round(fit.parameters.saturation_v, 3)
array([0.05, 0.2 ])

"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.identification.hysteresis.asymmetry_fit import AsymmetricFit, fit_asymmetric
from piezo_ros.identification.hysteresis.element_choice import choose_elements
from piezo_ros.identification.hysteresis.hysteresis_result import Coverage, HysteresisFit
from piezo_ros.identification.hysteresis.levels import level_errors, weighted_by_amplitude
from piezo_ros.identification.hysteresis.mrc_fit import (
    PlayModel,
    drift_rate,
    elements_of_plays,
    fit_mrc,
    number_of_plays,
    play_bounds,
)
from piezo_ros.identification.hysteresis.mrc_start import Preparation, prepare
from piezo_ros.identification.hysteresis.records import (
    Record,
    accumulate,
    concatenated_residual,
    make_records,
    reduced,
    refuse_single_branches,
)
from piezo_ros.identification.hysteresis.validation import (
    GOOD_PERCENT,
    Validation,
    validate,
    verdict_of,
)
from piezo_ros.model.hysteresis import HysteresisParameters

__all__ = ['Coverage', 'HysteresisFit', 'fit_hysteresis', 'fit_hysteresis_records']

_MOST_ELEMENTS: Final = 160
_FIRST_ELEMENTS: Final = 10
_MORE_ELEMENTS: Final = (24, 40)  # that are tried where no number is asked for
_RICH_ELEMENTS: Final = 24  # whether more elements would help is tried with so many
_FOLD_STEPS: Final = 20  # a fold starts from the fit to all data
_FOLD_ROUNDS: Final = 2
# An asymmetry or a drift is looked for where the elements leave more than that of a loop, and taken
# where it leaves at most this share of it.
_FURTHER_PERCENT: Final = 0.1
_FURTHER_GAIN: Final = 0.7
_DRIFT_STEPS: Final = 3
_SIGNIFICANT: Final = 5.0  # standard errors

_Floats = NDArray[np.float64]


def fit_hysteresis(
    voltage_v: ArrayLike | Sequence[ArrayLike], displacement_um: ArrayLike | Sequence[ArrayLike],
    *, elements: int | Literal['auto'] | None = None, virgin: bool = True,
    range_v: tuple[float, float] | None = None,
) -> HysteresisFit:
    """
    Identify the MRC hysteresis by bounded least squares, (5) in Liu 2015.

    The best excitation is a slow triangle of stepwise decreasing amplitude. A delay and an offset
    of the displacement are fitted too; they are not part of the hysteresis.

    Parameters
    ----------
    voltage_v : array_like, shape (N,), or sequence of such
        Voltage of one run, or of several.
    displacement_um : array_like, shape (N,), or sequence of such
        Measured displacement; values that are not finite are left out.
    elements : int or 'auto', optional
        Number n of voltage-limited elements, 1 to 160; 'auto' takes the smallest one (up to 24)
        that is as good as any at every amplitude, by cross-validation. By default 10, and 24 or 40
        where these leave clearly less of loops that are held out.
    virgin : bool, optional
        Whether each run starts from a virgin stage. If not, samples before the largest voltage,
        which erases the earlier history, are left out.
    range_v : tuple of float, optional
        Lowest and highest voltage for which the model will be used, for `HysteresisFit.coverage`.

    Returns
    -------
    HysteresisFit
        The hysteresis with standard errors and residual.

    Raises
    ------
    ValueError
        If the data are not sufficient for an identification, or an argument is out of range.

    """
    records = make_records(voltage_v, displacement_um, virgin=virgin)
    return fit_hysteresis_records(records, elements=elements, range_v=range_v)


def fit_hysteresis_records(
    records: Sequence[Record], *, elements: int | Literal['auto'] | None = None,
    range_v: tuple[float, float] | None = None,
) -> HysteresisFit:
    """
    Identify the hysteresis from records that are checked already, see `fit_hysteresis`.

    Parameters
    ----------
    records : sequence of Record
        The data, maybe reduced.
    elements, range_v
        As for `fit_hysteresis`.

    """
    if elements not in ('auto', None) and not (
            isinstance(elements, int) and 1 <= elements <= _MOST_ELEMENTS):
        raise ValueError(f"elements is {elements!r}, allowed is 1 … {_MOST_ELEMENTS} or 'auto'")
    if range_v is not None and not range_v[0] < range_v[1]:
        raise ValueError(f'range_v is {range_v}, the first value must be below the second')
    refuse_single_branches(records)
    few = [reduced(record) for record in records]
    weighted = weighted_by_amplitude(few)
    errors: dict[int, float] = {}
    if elements == 'auto':
        number, errors = choose_elements(weighted)
    else:
        number = _FIRST_ELEMENTS if elements is None else elements
    best = _best_candidate(few, weighted, number)
    richer = None
    if elements is None:
        for more in _MORE_ELEMENTS:
            if best.validation.worst_percent <= _FURTHER_PERCENT:
                break
            better = _better(best, _best_candidate(few, weighted, more))
            if better is best:
                break
            best = better
    elif best.validation.worst_percent > GOOD_PERCENT and number < _RICH_ELEMENTS:
        richer = _RICH_ELEMENTS, _rich_error(best)
    return _result(records, best, range_v, errors, richer)


class _Candidate(NamedTuple):
    """A fit, the records that it is for (less a drift, um per sample) and its validation."""

    few: list[Record]
    preparation: Preparation
    fit: AsymmetricFit
    validation: Validation
    drift_um: float = 0.0


def _candidate(
    few: list[Record], weighted: list[Record], elements: int, drift_um: float = 0.0,
) -> _Candidate:
    """Return the symmetric fit of records with a drift that is known."""
    few, weighted = _without_drift(few, drift_um), _without_drift(weighted, drift_um)
    preparation, fit = _best_symmetric(few, weighted, elements)
    return _Candidate(few, preparation, fit, _validation(few, preparation, fit), drift_um)


def _best_candidate(few: list[Record], weighted: list[Record], elements: int) -> _Candidate:
    """Return the best fit of so many elements: symmetric or not, with a drift or without."""
    best = _candidate(few, weighted, elements)
    if best.validation.worst_percent > _FURTHER_PERCENT:
        best = _better_candidate(best, weighted)
    return best


def _better_candidate(plain: _Candidate, weighted: list[Record]) -> _Candidate:
    """Return the fit with an asymmetry or without a drift, where the data ask for it."""
    best = plain
    asymmetric = fit_asymmetric(
        plain.preparation.records, plain.fit, plain.preparation.delay_bounds)
    if asymmetric is not None:
        validation = _validation(plain.few, plain.preparation, asymmetric)
        best = _better(best, plain._replace(fit=asymmetric, validation=validation))
    elements = number_of_plays(plain.fit.theta)
    steady, drift_um = plain, 0.0
    for _ in range(_DRIFT_STEPS):
        change_um, error_um = drift_rate(steady.preparation.records, steady.fit.theta)
        if abs(change_um) < _SIGNIFICANT * error_um:
            break
        drift_um += change_um
        steady = _candidate(
            _without_drift(steady.few, -steady.drift_um), weighted, elements, drift_um)
    if not drift_um:
        return best
    samples = max(float(np.ptp(record.index)) for record in plain.few)
    found = (f'a drift of {1e3 * drift_um * samples:.3g} nm over the record is taken out',)
    return _better(best, steady._replace(validation=replace(
        steady.validation, findings=found + steady.validation.findings)))


def _better(simple: _Candidate, other: _Candidate) -> _Candidate:
    one, two = simple.validation, other.validation
    is_better = two.worst_percent < _FURTHER_GAIN * one.worst_percent and (
        two.fit_percent > one.fit_percent)
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


def _rich_error(best: _Candidate) -> float:
    """Return what is left of a loop with more elements, percent."""
    few = best.few
    preparation = prepare(
        weighted_by_amplitude(few), [_RICH_ELEMENTS], virgin=few[0].virgin)
    fit = _symmetric(preparation, preparation.starts[_RICH_ELEMENTS], _FOLD_STEPS)
    if best.fit.weight.size:
        fit = fit_asymmetric(preparation.records, fit, preparation.delay_bounds) or fit
    records = _settled(few, preparation)
    levels = level_errors(
        records, concatenated_residual(records, fit.predict(records)),
        best.validation.noise_rms_um)
    return replace(best.validation, levels=tuple(levels)).worst_percent


def _result(
    records: Sequence[Record], best: _Candidate, range_v: tuple[float, float] | None,
    errors: dict[int, float], richer: tuple[int, float] | None,
) -> HysteresisFit:
    few, preparation, fit, validation, drift_um = best
    settled = _settled(few, preparation)
    residual_of_few = concatenated_residual(settled, fit.predict(settled))
    whole = _without_drift(records, drift_um)
    if all(record.voltage_v is other.voltage_v for record, other in zip(
            records, few, strict=True)):
        whole = settled
    residual = concatenated_residual(whole, fit.predict(whole))
    weight = np.concatenate([record.weight for record in settled])
    known = np.isfinite(residual_of_few)
    cost = float(np.sum(weight[known] * residual_of_few[known] ** 2))
    voltage = np.concatenate([record.voltage_v for record in records])
    displacement = np.concatenate([record.displacement_um for record in records])
    measured = np.concatenate([record.measured for record in records])
    kappa, saturation, jacobian = elements_of_plays(fit.theta)
    variance = cost / max(int(known.sum()) - fit.theta.size, 1) * _correlation_samples(
        residual_of_few[known] * np.sqrt(weight[known]))
    deviation = _standard_errors(preparation, settled, fit, variance, jacobian)
    low, high = float(voltage.min()), float(voltage.max())
    coverage = Coverage(
        low, high, float(displacement[measured].min()), float(displacement[measured].max()),
        (low, high) if range_v is None else range_v)
    return HysteresisFit(
        parameters=HysteresisParameters(
            kappa_um_per_v=tuple(kappa), saturation_v=tuple(saturation),
            asymmetry_threshold_um=tuple(fit.threshold_um), asymmetry_weight=tuple(fit.weight)),
        kappa_standard_error_um_per_v=deviation[:kappa.size],
        saturation_standard_error_v=deviation[kappa.size:],
        delay_samples=float(fit.theta[-2]),
        offset_um=float(fit.theta[-1]),
        voltage_v=voltage,
        displacement_um=np.where(measured, displacement, np.nan),
        residual_um=residual,
        rms_um=math.sqrt(cost / max(int(known.sum()), 1)),
        coverage=coverage,
        cross_validated_rms_um=errors,
        drift_um_per_sample=drift_um,
        validation=validation,
        verdict=verdict_of(
            validation, kappa.size - 1, richer, delay_samples=float(fit.theta[-2]),
            coverage_warning=coverage.warning),
        samples_used=round(float(weight[known].sum())),
        samples_lost=sum(record.lost for record in records))


def _standard_errors(
    preparation: Preparation, settled: Sequence[Record], fit: AsymmetricFit, variance: float,
    jacobian: _Floats,
) -> _Floats:
    """Return the standard errors of (kappa, u_S), for a variance of the residual's samples."""
    theta, normal = fit.theta, fit.normal
    plays = number_of_plays(theta)
    reach_v = max(record.reach_v for record in preparation.records)
    lower, upper = play_bounds(theta, reach_v, preparation.delay_bounds)
    free = (theta > lower) & (theta < upper) & (np.diag(normal.curvature) > 0.0)
    # A play at its smallest share is undetermined, both its compliance and its threshold.
    known = (theta[1:plays + 1] > 1.01 * lower[1:plays + 1]) & free[plays + 1:2 * plays + 1]
    free[1:plays + 1] = known
    free[plays + 1:2 * plays + 1] = known
    # Each parameter scaled by its sensitivity: the matrix to invert is better conditioned.
    length = np.sqrt(np.diag(normal.curvature)[free])
    scale = np.outer(length, length)
    inverse = np.linalg.pinv(normal.curvature[np.ix_(free, free)] / scale, hermitian=True)
    # A mean of w samples has a w-th of the variance: w stands once in J'W^2 J, the rest squared.
    squared = accumulate(PlayModel(plays), [
        replace(record, weight=record.weight**2 / np.maximum(sample.weight, 1e-300))
        for record, sample in zip(preparation.records, settled, strict=True)], theta)
    covariance = inverse @ (
        squared.curvature[np.ix_(free, free)] / scale) @ inverse / scale * variance
    of_free = jacobian[:, free]
    spread = np.einsum('ij,jk,ik->i', of_free, covariance, of_free)
    deviation = np.sqrt(np.maximum(spread, 0.0))
    deviation[:plays][~known] = np.nan
    deviation[plays + 1:][~known] = np.nan
    return np.asarray(deviation)


def _correlation_samples(residual: _Floats) -> float:
    """Return the number of correlated samples that are worth one independent sample."""
    spectrum = np.fft.rfft(residual - residual.mean(), 2 * residual.size)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2)[:residual.size]
    if correlation[0] <= 0.0:
        return 1.0
    ends = np.flatnonzero(correlation <= 0.0)
    positive = correlation[1:ends[0]] if ends.size else correlation[1:]
    return float(1.0 + 2.0 * np.sum(positive) / correlation[0])
