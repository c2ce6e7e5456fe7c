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
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.identification.hysteresis.asymmetry_fit import AsymmetricFit
from piezo_ros.identification.hysteresis.candidate_fits import (
    FURTHER_PERCENT,
    CandidateFit,
    best_candidate,
    better_candidate,
    error_of_elements,
)
from piezo_ros.identification.hysteresis.element_choice import choose_elements
from piezo_ros.identification.hysteresis.hysteresis_result import Coverage, HysteresisFit
from piezo_ros.identification.hysteresis.hysteresis_validation import (
    GOOD_PERCENT,
    verdict_of,
)
from piezo_ros.identification.hysteresis.levels import weighted_by_amplitude
from piezo_ros.identification.hysteresis.mrc_fit import (
    PlayModel,
    elements_of_plays,
    number_of_plays,
    play_bounds,
)
from piezo_ros.identification.hysteresis.mrc_start import Preparation
from piezo_ros.identification.hysteresis.records import (
    Record,
    accumulate,
    concatenated_residual,
    make_records,
    reduced,
    refuse_single_branches,
)
from piezo_ros.model.hysteresis import HysteresisParameters

__all__ = ['Coverage', 'HysteresisFit', 'fit_hysteresis', 'fit_hysteresis_records']

_MOST_ELEMENTS: Final = 160
_FIRST_ELEMENTS: Final = 10
_MORE_ELEMENTS: Final = (24, 40)  # that are tried where no number is asked for
_RICH_ELEMENTS: Final = 24  # whether more elements would help is tried with so many

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
    best = best_candidate(few, weighted, number)
    richer = None
    if elements is None:
        for more in _MORE_ELEMENTS:
            if best.validation.worst_percent <= FURTHER_PERCENT:
                break
            better = better_candidate(best, best_candidate(few, weighted, more))
            if better is best:
                break
            best = better
    elif best.validation.worst_percent > GOOD_PERCENT and number < _RICH_ELEMENTS:
        richer = _RICH_ELEMENTS, error_of_elements(best, _RICH_ELEMENTS)
    return _result(records, best, range_v, errors, richer)


def _result(
    records: Sequence[Record], best: CandidateFit, range_v: tuple[float, float] | None,
    errors: dict[int, float], richer: tuple[int, float] | None,
) -> HysteresisFit:
    preparation, fit, validation = best.preparation, best.fit, best.validation
    settled = best.settled
    residual_of_few = concatenated_residual(settled, fit.predict(settled))
    whole = best.as_fitted(records)
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
        drift_um_per_sample=best.drift_um,
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
