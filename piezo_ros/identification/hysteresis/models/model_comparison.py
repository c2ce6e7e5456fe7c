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
Hysteresis models compared on the same data, by residual and by cross-validation.

MRC; Prandtl-Ishlinskii; Bouc-Wen; and x = sum_{j <= 5} a_j u^j, a polynomial without memory.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.identification.hysteresis.hysteresis_validation import cross_validate
from piezo_ros.identification.hysteresis.models.bouc_wen import BoucWenModel, fit_bouc_wen
from piezo_ros.identification.hysteresis.mrc_fit import (
    PlayModel,
    fit_mrc,
    fit_prandtl_ishlinskii,
)
from piezo_ros.identification.hysteresis.mrc_start import prepare
from piezo_ros.identification.hysteresis.records import (
    Record,
    concatenated_residual,
    make_records,
    predict,
)

__all__ = ['ModelScore', 'compare_hysteresis_models', 'compare_records']

_POLYNOMIAL_DEGREE: Final = 5

_Floats = NDArray[np.float64]
_FitAndPredict = Callable[[Sequence[Record]], list[_Floats]]


@dataclass(frozen=True, kw_only=True)
class ModelScore:
    """
    The residual and the cross-validated error of one model.

    Attributes
    ----------
    name : str
        Name of the model.
    parameters_count : int
        Number of fitted parameters, without delay and offset, which all models have.
    rms_um : float
        Root mean square of the residual, the model fitted to all data.
    cross_validated_rms_um : float
        Root mean square of the error on the folds that were left out of the fit.
    residual_um : ndarray, shape (N,)
        Measured minus predicted displacement of the fit to all data; NaN where a sample was left
        out.

    """

    name: str
    parameters_count: int
    rms_um: float
    cross_validated_rms_um: float
    residual_um: _Floats


def compare_hysteresis_models(
    voltage_v: ArrayLike | Sequence[ArrayLike], displacement_um: ArrayLike | Sequence[ArrayLike],
    *, elements: int = 10, virgin: bool = True,
) -> list[ModelScore]:
    """
    Fit several hysteresis models to the same data.

    All of them get the voltage with the delay that the MRC fit found.

    Parameters
    ----------
    voltage_v : array_like, shape (N,), or sequence of such
        Voltage of one run, or of several.
    displacement_um : array_like, shape (N,), or sequence of such
        Measured displacement; values that are not finite are left out.
    elements : int, optional
        Number of MRC elements and of Prandtl-Ishlinskii plays.
    virgin : bool, optional
        Whether each run starts from a virgin stage.

    Returns
    -------
    list of ModelScore
        MRC, Prandtl-Ishlinskii with equally spaced thresholds, Bouc-Wen, and a polynomial of
        degree 5 without memory.

    Raises
    ------
    ValueError
        If the data are not sufficient for an identification.

    """
    return compare_records(
        make_records(voltage_v, displacement_um, virgin=virgin), elements=elements)


def compare_records(records: Sequence[Record], *, elements: int = 10) -> list[ModelScore]:
    """
    Fit several hysteresis models to records that are checked already.

    Parameters
    ----------
    records : sequence of Record
        The data, maybe reduced.
    elements : int, optional
        As for `compare_hysteresis_models`.

    """
    preparation = prepare(records, [elements], virgin=records[0].virgin)
    records = preparation.records
    whole = fit_mrc(records, preparation.starts[elements], preparation.delay_bounds)
    delay = float(whole.theta[-2])

    def mrc(part: Sequence[Record]) -> list[_Floats]:
        theta = fit_mrc(part, whole.theta, preparation.delay_bounds).theta
        return predict(PlayModel(elements), part, theta)

    def prandtl_ishlinskii(part: Sequence[Record]) -> list[_Floats]:
        return predict(
            PlayModel(elements), part, fit_prandtl_ishlinskii(part, elements, delay))

    def bouc_wen(part: Sequence[Record]) -> list[_Floats]:
        free = _without_delay(part, delay)
        return predict(BoucWenModel(), free, fit_bouc_wen(free))

    def polynomial(part: Sequence[Record]) -> list[_Floats]:
        return _polynomial(_without_delay(part, delay))

    return [
        _score(records, 'MRC', 2 * elements + 1, mrc),
        _score(records, 'Prandtl-Ishlinskii', elements + 1, prandtl_ishlinskii),
        _score(records, 'Bouc-Wen', 4, bouc_wen),
        _score(records, 'polynomial', _POLYNOMIAL_DEGREE, polynomial),
    ]


def _score(
    records: Sequence[Record], name: str, parameters_count: int, fit_and_predict: _FitAndPredict,
) -> ModelScore:
    residual = concatenated_residual(records, fit_and_predict(records))
    return ModelScore(
        name=name, parameters_count=parameters_count,
        rms_um=math.sqrt(float(np.nanmean(residual**2))),
        cross_validated_rms_um=math.sqrt(float(cross_validate(records, fit_and_predict)[0].mean())),
        residual_um=residual)


def _without_delay(records: Sequence[Record], delay_samples: float) -> list[Record]:
    return [
        replace(record, voltage_v=np.interp(
            record.index - delay_samples, record.index, record.voltage_v))
        for record in records]


def _polynomial(records: Sequence[Record]) -> list[_Floats]:
    voltage = np.concatenate([record.voltage_v for record in records])
    displacement = np.concatenate([record.displacement_um for record in records])
    used = np.concatenate([record.weight for record in records]) > 0.0
    fit = np.polynomial.Polynomial.fit(voltage[used], displacement[used], _POLYNOMIAL_DEGREE)
    return [np.asarray(fit(record.voltage_v)) for record in records]
