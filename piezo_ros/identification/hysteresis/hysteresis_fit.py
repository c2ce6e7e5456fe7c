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

The sum ends at the first lag where rho is not positive. The standard errors of (kappa, u_S) follow
by the derivatives of `elements_of_plays`.

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
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.identification.hysteresis.mrc_fit import (
    MrcFit,
    PlayModel,
    elements_of_plays,
    fit_mrc,
    play_bounds,
)
from piezo_ros.identification.hysteresis.mrc_start import Preparation, prepare, thinned
from piezo_ros.identification.hysteresis.parameter_file import parameter_yaml
from piezo_ros.identification.hysteresis.records import (
    Record,
    concatenated_residual,
    cross_validate,
    make_records,
    predict,
)
from piezo_ros.model.hysteresis import HysteresisParameters
from piezo_ros.model.hysteresis_and_inverse import MaxwellResistiveCapacitor

__all__ = ['Coverage', 'HysteresisFit', 'fit_hysteresis']

_MOST_ELEMENTS: Final = 50
_MOST_AUTOMATIC_ELEMENTS: Final = 16
# The search ends after so many numbers of elements in a row without an improvement.
_PATIENCE: Final = 3
# Share of the least cross-validated error up to which fewer elements are preferred.
_SUFFICIENT: Final = 1.01
_FOLD_STEPS: Final = 20  # a fold starts from the fit to all data

_Floats = NDArray[np.float64]


class Coverage(NamedTuple):
    """
    The range of voltage that the excitation covers, and the one in which the model will be used.

    Attributes
    ----------
    minimum_v, maximum_v : float
        Excited voltages.
    minimum_um, maximum_um : float
        Measured displacements.
    wanted_v : tuple of float
        Lowest and highest voltage of use; the excited ones where none were given.

    """

    minimum_v: float
    maximum_v: float
    minimum_um: float
    maximum_um: float
    wanted_v: tuple[float, float]

    @property
    def warning(self) -> str:
        """The part that is not covered, in one sentence; empty if there is none."""
        low, high = self.wanted_v
        if self.minimum_v <= low and high <= self.maximum_v:
            return ''
        return (
            f'the excitation covers {self.minimum_v:g} … {self.maximum_v:g} V of the '
            f'{low:g} … {high:g} V asked for; beyond it the model is a straight line without '
            'hysteresis')


@dataclass(frozen=True, kw_only=True)
class HysteresisFit:
    """
    An identified MRC hysteresis.

    Attributes
    ----------
    parameters : HysteresisParameters
        The elements in the order in which they saturate; always monotone and invertible.
    kappa_standard_error_um_per_v : ndarray, shape (n + 1,)
        Standard errors of the compliances; NaN for an element that the data do not need.
    saturation_standard_error_v : ndarray, shape (n,)
        Standard errors of the saturation voltages, likewise.
    delay_samples : float
        Samples by which the displacement lags behind the voltage; not part of the parameters.
    offset_um : float
        Displacement at rest; not part of the parameters.
    voltage_v, displacement_um : ndarray, shape (N,)
        The data, all runs concatenated.
    residual_um : ndarray, shape (N,)
        Measured minus predicted displacement; NaN where a sample was left out.
    rms_um : float
        Root mean square of the residual.
    coverage : Coverage
        The range of the excitation; its `warning` names the part that is missing.
    cross_validated_rms_um : dict of int to float
        Number of elements to cross-validated rms error, where the number was chosen.

    """

    parameters: HysteresisParameters
    kappa_standard_error_um_per_v: _Floats
    saturation_standard_error_v: _Floats
    delay_samples: float
    offset_um: float
    voltage_v: _Floats
    displacement_um: _Floats
    residual_um: _Floats
    rms_um: float
    coverage: Coverage
    cross_validated_rms_um: dict[int, float]

    @property
    def elements(self) -> int:
        """Number n of voltage-limited elements."""
        return len(self.parameters.saturation_v)

    @property
    def model(self) -> MaxwellResistiveCapacitor:
        """The operator, forward and inverse."""
        return MaxwellResistiveCapacitor(
            self.parameters.kappa_um_per_v, self.parameters.saturation_v)

    def to_parameter_yaml(self, *, source: str) -> str:
        """
        Return a ROS parameter file for the compensator node.

        Parameters
        ----------
        source : str
            Where the data come from, usually the bag.

        Returns
        -------
        str
            YAML; the numbers are bit-equal to `parameters`.

        """
        used = int(np.isfinite(self.residual_um).sum())
        notes = [
            f'source: {source}',
            f'residual: {1e3 * self.rms_um:.4g} nm rms, {used} of {self.residual_um.size} samples',
            f'excitation: {self.coverage.minimum_v:.4g} to {self.coverage.maximum_v:.4g} V',
            f'removed delay: {self.delay_samples:.4g} samples',
            f'removed offset: {1e3 * self.offset_um:.4g} nm',
        ]
        if self.coverage.warning:
            notes.append(f'WARNING: {self.coverage.warning}')
        return parameter_yaml(
            self.parameters, self.kappa_standard_error_um_per_v,
            self.saturation_standard_error_v, notes)


def fit_hysteresis(
    voltage_v: ArrayLike | Sequence[ArrayLike], displacement_um: ArrayLike | Sequence[ArrayLike],
    *, elements: int | Literal['auto'] = 10, virgin: bool = True,
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
        Number n of voltage-limited elements, 1 to 50; 'auto' takes the smallest one (up to 16) with
        a cross-validated error within 1 % of the least.
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
    if elements != 'auto' and not (
            isinstance(elements, int) and 1 <= elements <= _MOST_ELEMENTS):
        raise ValueError(f"elements is {elements!r}, allowed is 1 … {_MOST_ELEMENTS} or 'auto'")
    if range_v is not None and not range_v[0] < range_v[1]:
        raise ValueError(f'range_v is {range_v}, the first value must be below the second')
    records = make_records(voltage_v, displacement_um, virgin=virgin)
    errors: dict[int, float] = {}
    if elements == 'auto':
        elements, errors = _choose_elements(
            prepare(records, range(1, _MOST_AUTOMATIC_ELEMENTS + 1), virgin=virgin))
    preparation = prepare(records, [elements], virgin=virgin)
    fit = fit_mrc(preparation.records, preparation.starts[elements], preparation.delay_bounds)
    return _result(preparation, fit, range_v, errors)


def _choose_elements(preparation: Preparation) -> tuple[int, dict[int, float]]:
    """Return the smallest sufficient number of elements, and the error of each number tried."""
    records = thinned(preparation.records)
    errors: dict[int, float] = {}
    for elements in sorted(preparation.starts):
        folds = cross_validate(records, partial(_fit_and_predict, preparation, elements))
        errors[elements] = math.sqrt(float(folds.mean()))
        chosen = _smallest_sufficient(errors)
        if elements - chosen >= _PATIENCE:
            break
    return chosen, errors


def _smallest_sufficient(errors: dict[int, float]) -> int:
    limit = _SUFFICIENT * min(errors.values())
    return min(elements for elements, error in errors.items() if error <= limit)


def _fit_and_predict(
    preparation: Preparation, elements: int, records: Sequence[Record],
) -> list[_Floats]:
    fit = fit_mrc(
        records, preparation.starts[elements], preparation.delay_bounds, _FOLD_STEPS)
    return predict(PlayModel(elements), records, fit.theta)


def _result(
    preparation: Preparation, fit: MrcFit, range_v: tuple[float, float] | None,
    errors: dict[int, float],
) -> HysteresisFit:
    records = preparation.records
    residual = concatenated_residual(
        records, predict(PlayModel(fit.theta.size // 2 - 1), records, fit.theta))
    voltage = np.concatenate([record.voltage_v for record in records])
    displacement = np.concatenate([record.displacement_um for record in records])
    measured = np.concatenate([record.measured for record in records])
    kappa, saturation, jacobian = elements_of_plays(fit.theta)
    deviation = _standard_errors(preparation, fit, residual[np.isfinite(residual)], jacobian)
    low, high = float(voltage.min()), float(voltage.max())
    return HysteresisFit(
        parameters=HysteresisParameters(
            kappa_um_per_v=tuple(kappa), saturation_v=tuple(saturation)),
        kappa_standard_error_um_per_v=deviation[:kappa.size],
        saturation_standard_error_v=deviation[kappa.size:],
        delay_samples=float(fit.theta[-2]),
        offset_um=float(fit.theta[-1]),
        voltage_v=voltage,
        displacement_um=np.where(measured, displacement, np.nan),
        residual_um=residual,
        rms_um=math.sqrt(fit.normal.cost / fit.normal.samples),
        coverage=Coverage(
            low, high, float(displacement[measured].min()), float(displacement[measured].max()),
            (low, high) if range_v is None else range_v),
        cross_validated_rms_um=errors)


def _standard_errors(
    preparation: Preparation, fit: MrcFit, residual: _Floats, jacobian: _Floats,
) -> _Floats:
    """Return the standard errors of (kappa, u_S), with the correlation of the residual."""
    theta, normal = fit
    plays = theta.size // 2 - 1
    reach_v = max(float(np.max(np.abs(record.voltage_v))) for record in preparation.records)
    lower, upper = play_bounds(theta, reach_v, preparation.delay_bounds)
    free = (theta > lower) & (theta < upper) & (np.diag(normal.curvature) > 0.0)
    # A play at its smallest share is undetermined, both its compliance and its threshold.
    known = (theta[1:plays + 1] > 1.01 * lower[1:plays + 1]) & free[plays + 1:2 * plays + 1]
    free[1:plays + 1] = known
    free[plays + 1:2 * plays + 1] = known
    # Each parameter scaled by its sensitivity: the matrix to invert is better conditioned.
    length = np.sqrt(np.diag(normal.curvature)[free])
    inverse = np.linalg.pinv(
        normal.curvature[np.ix_(free, free)] / np.outer(length, length), hermitian=True)
    covariance = (
        inverse / np.outer(length, length) * _correlation_samples(residual)
        * normal.cost / max(normal.samples - int(free.sum()), 1))
    of_free = jacobian[:, free]
    variance = np.einsum('ij,jk,ik->i', of_free, covariance, of_free)
    deviation = np.sqrt(np.maximum(variance, 0.0))
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
