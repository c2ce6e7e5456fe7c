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
The Maxwell resistive capacitor (MRC) model fitted to recorded voltage and displacement.

Forward, from voltage to displacement, the MRC model of n limited elements (Section 2 in Liu 2015)
is a superposition of n plays with thresholds r_i in volts,

    x = p_0 u + sum_i p_i P[r_i](u),   p_0 > 0, p_i >= 0

With the compliances c_i = p_0 + ... + p_i the elements follow one to one:

    kappa_i = c_{i-1} c_i / p_i,   kappa_{n+1} = c_n
    u_S,i = x(r_i)/kappa_i,   x(r_i) = sum_{j <= i} c_{j-1} (r_j - r_{j-1}),   r_0 = 0

The fit, (5) in Liu 2015, works on (p, r). The noise of the sensor is then on the predicted
quantity and cannot bias the parameters; most parameters enter linearly; and the bounds p_i > 0 are
exactly the condition for a monotone and invertible model.

Examples
--------
>>> theta = np.array([1.0, 0.5, 2.0, 0.0, 0.0])  # p_0, p_1 (um/V), r_1 (V), delay, offset
>>> kappa_um_per_v, saturation_v, _ = elements_of_plays(theta)
>>> kappa_um_per_v
array([3. , 1.5])
>>> saturation_v.round(6)
array([0.666667])

"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification.estimation.least_squares import NormalEquations, minimise
from piezo_ros.identification.hysteresis.records import Record, accumulate, predict

__all__ = [
    'MrcFit',
    'PlayModel',
    'drift_rate',
    'elements_of_plays',
    'fit_mrc',
    'fit_plays',
    'fit_prandtl_ishlinskii',
    'number_of_plays',
    'play_bounds',
]

# Smallest compliance of a play, relative to the small-signal one; its element then has a kappa of
# a million times the small-signal compliance and a saturation voltage too small to measure.
SMALLEST_SHARE: Final = 1e-6

_Floats = NDArray[np.float64]


class PlayModel(NamedTuple):
    """A superposition of n plays; theta is (p_0 … p_n, r_1 … r_n, delay, offset)."""

    plays: int

    def add(
        self, record: Record, theta: _Floats, gradient: _Floats, curvature: _Floats,
    ) -> float:
        """Add the normal equations of a record, see `RecordModel.add`."""
        from piezo_ros.identification.hysteresis.fit_kernels import add_play_equations
        return add_play_equations(
            theta, record.index, record.voltage_v, record.displacement_um, record.weight,
            gradient, curvature, np.empty(10 * theta.size + 9))

    def predict(self, record: Record, theta: _Floats) -> _Floats:
        """Return the displacement at every sample, see `RecordModel.predict`."""
        from piezo_ros.identification.hysteresis.fit_kernels import play_predictions
        prediction_um = np.empty(record.voltage_v.size)
        play_predictions(
            theta, record.index, record.voltage_v, prediction_um, np.empty(3 * self.plays + 1))
        return prediction_um


class MrcFit(NamedTuple):
    """
    A fitted superposition of n plays.

    Attributes
    ----------
    theta : ndarray, shape (2n + 3,)
        (p_0 … p_n, um/V; r_1 … r_n, V, rising; delay, samples; offset, um).
    normal : NormalEquations
        The normal equations there.

    """

    theta: _Floats
    normal: NormalEquations


def fit_mrc(
    records: Sequence[Record], start: _Floats, delay_bounds: tuple[float, float],
    maximum_steps: int = 200,
) -> MrcFit:
    """
    Fit the MRC model by bounded least squares, (5) in Liu 2015.

    Parameters
    ----------
    records : sequence of Record
        The data.
    start : ndarray, shape (2n + 3,)
        Starting values.
    delay_bounds : tuple of float
        Bounds of the delay, samples.
    maximum_steps : int, optional
        Steps of the solver at most.

    Returns
    -------
    MrcFit
        The fit.

    """
    theta, normal = fit_plays(records, start, delay_bounds, maximum_steps)
    plays = number_of_plays(theta)
    rising = np.argsort(theta[plays + 1:2 * plays + 1], kind='stable')
    order = np.concatenate((
        [0], 1 + rising, plays + 1 + rising, [2 * plays + 1, 2 * plays + 2]))
    return MrcFit(
        theta[order],
        normal._replace(
            gradient=normal.gradient[order], curvature=normal.curvature[np.ix_(order, order)]))


def number_of_plays(theta: NDArray[Any]) -> int:
    """Return n for a parameter vector of shape (2n + 3,)."""
    return (theta.size - 3) // 2


def fit_plays(
    records: Sequence[Record], start: _Floats, delay_bounds: tuple[float, float],
    maximum_steps: int,
) -> tuple[_Floats, NormalEquations]:
    """
    Return theta and the normal equations of the best plays, in the order of the start.

    Parameters
    ----------
    records, start, delay_bounds, maximum_steps
        As for `fit_mrc`.

    """
    reach_v = max(record.reach_v for record in records)
    return minimise(
        partial(accumulate, PlayModel(number_of_plays(start)), records), start,
        *play_bounds(start, reach_v, delay_bounds), maximum_steps)


def drift_rate(records: Sequence[Record], theta: _Floats) -> tuple[float, float]:
    """
    Return how fast the displacement drifts beside the plays, and the standard error.

    One step of least squares with all parameters of the plays adapted: with t the time, e the
    residual, A = J'WJ and g = J'Wt it is t'We / (t'Wt - g'A^(-1)g).

    Parameters
    ----------
    records : sequence of Record
        The data.
    theta : ndarray, shape (2n + 3,)
        The best plays without drift.

    Returns
    -------
    rate_um, standard_error_um : float
        Micrometres per sample of the recording.

    """
    model = PlayModel(number_of_plays(theta))
    normal = accumulate(model, records, theta)
    late = accumulate(model, [
        replace(record, displacement_um=record.displacement_um + record.index)
        for record in records], theta)
    with_time = late.gradient - normal.gradient
    squares, product, weights, size = 0.0, 0.0, 0.0, 0.0
    for record, predicted in zip(records, predict(model, records, theta), strict=True):
        weight, time = record.weight, record.index
        squares += float(np.sum(weight * time**2))
        product += float(np.sum(weight * time * (record.displacement_um - predicted)))
        weights += float(np.sum(weight**2))
        size += float(np.sum(weight))
    length = np.sqrt(np.maximum(np.diag(normal.curvature), 1e-300))
    scaled = with_time / length
    inner = np.linalg.pinv(normal.curvature / np.outer(length, length), 1e-10, hermitian=True)
    free = squares - float(scaled @ inner @ scaled)
    if free <= 1e-9 * squares:
        return 0.0, np.inf
    variance = normal.cost / size * weights / size
    return product / free, float(np.sqrt(variance / free))


def fit_prandtl_ishlinskii(
    records: Sequence[Record], plays: int, delay_samples: float,
) -> NDArray[np.float64]:
    """
    Fit the Prandtl-Ishlinskii model as it is commonly used: the weights of equally spaced plays.

        x = p_0 u + sum_i p_i P[r_i](u),   r_i = i max|u| / (n + 1),   p_i >= 0

    Parameters
    ----------
    records : sequence of Record
        The data.
    plays : int
        Number n of plays beside the linear term.
    delay_samples : float
        Delay of the displacement.

    Returns
    -------
    ndarray, shape (2n + 3,)
        Parameters of a `PlayModel`.

    """
    reach_v = max(record.reach_v for record in records)
    reach_um = max(
        float(np.max(np.abs(record.displacement_um * record.weight))) for record in records)
    thresholds = np.arange(1, plays + 1) * (reach_v / (plays + 1))
    start = np.concatenate((
        np.full(plays + 1, reach_um / reach_v / (plays + 1)), thresholds, [delay_samples, 0.0]))
    lower, upper = play_bounds(start, reach_v, (delay_samples, delay_samples))
    lower[plays + 1:-2] = upper[plays + 1:-2] = thresholds
    theta, _ = minimise(partial(accumulate, PlayModel(plays), records), start, lower, upper)
    return theta


def play_bounds(
    theta: _Floats, reach_v: float, delay_bounds: tuple[float, float],
) -> tuple[_Floats, _Floats]:
    """
    Return the bounds of theta, within which every model is monotone and invertible.

    Parameters
    ----------
    theta : ndarray, shape (2n + 3,)
        Parameters, for the scale of the compliances.
    reach_v : float
        Largest voltage, and so the largest threshold of a play that moves.
    delay_bounds : tuple of float
        Bounds of the delay, samples.

    """
    plays = number_of_plays(theta)
    smallest = SMALLEST_SHARE * float(np.sum(theta[:plays + 1]))
    lower = np.concatenate((
        np.full(plays + 1, smallest), np.zeros(plays), [delay_bounds[0], -np.inf]))
    upper = np.concatenate((
        np.full(plays + 1, np.inf), np.full(plays, reach_v), [delay_bounds[1], np.inf]))
    return lower, upper


def elements_of_plays(theta: _Floats) -> tuple[_Floats, _Floats, _Floats]:
    """
    Return the MRC elements that are equivalent to a superposition of plays.

    On the virgin curve play i starts to move where element i saturates; the compliance grows from
    c_{i-1} to c_i there.

    Parameters
    ----------
    theta : ndarray, shape (2n + 3,)
        Parameters with rising thresholds.

    Returns
    -------
    kappa_um_per_v : ndarray, shape (n + 1,)
        Compliances.
    saturation_v : ndarray, shape (n,)
        Saturation voltages.
    jacobian : ndarray, shape (2n + 1, 2n + 3)
        Derivatives of (kappa, u_S) by theta.

    """
    plays = number_of_plays(theta)
    jacobian = np.empty((2 * plays + 1, theta.size))
    for i in range(theta.size):
        complex_theta = theta.astype(np.complex128)
        complex_theta[i] += 1e-30j  # the derivative without a difference, exact to rounding
        jacobian[:, i] = np.concatenate(_elements(complex_theta)).imag / 1e-30
    kappa, saturation = _elements(theta.astype(np.complex128))
    return kappa.real, saturation.real, jacobian


def _elements(theta: NDArray[np.complex128]) -> tuple[
        NDArray[np.complex128], NDArray[np.complex128]]:
    plays = number_of_plays(theta)
    weight, threshold = theta[1:plays + 1], theta[plays + 1:2 * plays + 1]
    compliance = np.cumsum(theta[:plays + 1])
    kappa = compliance[:-1] * compliance[1:] / weight
    steps = np.diff(threshold, prepend=0.0)
    width = np.cumsum(compliance[:-1] * steps)
    return np.append(kappa, compliance[-1]), width / kappa
