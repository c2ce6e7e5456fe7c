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
The multiplicative uncertainty of a model and a rational bound of it, (7) and (19) in Liu 2015.

    Delta(i w) = (G_m(i w) - G(i w))/G(i w)
    W(s) = g prod_i z_i(s) / prod_i p_i(s),   sections of unit dc gain, stable and minimum phase

    minimise mean over w of log |W|   subject to log |W| >= log max |Delta| at every measured w

The logarithms of corner frequencies and dampings are the parameters, so that every W is stable and
of minimum phase.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize

from piezo_ros.identification.response.frequency_response import FrequencyResponse

if TYPE_CHECKING:
    import control

__all__ = ['UncertaintyBound', 'uncertainty_bound']

_DECIBEL = 20.0 / math.log(10.0)  # of the natural logarithm of an amplitude
_MARGIN = 1e-9  # by which the bound is raised above the points it touches
_SAME_FREQUENCY = 2e-3  # relative; frequencies closer than this are one point of the grid
_DAMPING = (0.05, 20.0)


@dataclass(frozen=True)
class UncertaintyBound:
    """
    W(s), stable and of minimum phase, above every measured |Delta|.

    Outside the measured frequencies it is an extrapolation.

    Attributes
    ----------
    order : int
        Order of numerator and denominator.
    numerator, denominator : ndarray, shape (order + 1,)
        Polynomials in s, rad/s, highest power first; the denominator is monic.
    frequency_hz : ndarray, shape (N,)
        Frequencies of all measured points, ascending.
    uncertainty : ndarray of complex, shape (N,)
        Delta at these points, (7) in Liu 2015; dimensionless.
    amplitude, offset : ndarray, shape (N,)
        Amplitude and offset of the excitation at each point, in the unit of the input.
    maximum_frequency_hz, maximum : ndarray, shape (F,)
        Largest |Delta| over all conditions, frequency by frequency.

    """

    order: int
    numerator: NDArray[np.float64]
    denominator: NDArray[np.float64]
    frequency_hz: NDArray[np.float64]
    uncertainty: NDArray[np.complex128]
    amplitude: NDArray[np.float64]
    offset: NDArray[np.float64]
    maximum_frequency_hz: NDArray[np.float64]
    maximum: NDArray[np.float64]

    @property
    def transfer_function(self) -> 'control.TransferFunction':
        """W(s) as a continuous-time ``control.TransferFunction``."""
        import control
        return control.tf(self.numerator, self.denominator)

    def magnitude(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        """
        Return |W(i 2 pi f)|.

        Parameters
        ----------
        frequency_hz : array_like, shape (N,)
            Frequencies, hertz.

        """
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
        return np.abs(np.polyval(self.numerator, s) / np.polyval(self.denominator, s))

    @property
    def smallest_margin(self) -> float:
        """Smallest ``|W|/|Delta|`` over all measured points; at least 1 for a bound."""
        return float(np.min(
            self.magnitude(self.frequency_hz)
            / np.maximum(np.abs(self.uncertainty), np.finfo(float).tiny)))

    @property
    def mean_excess_db(self) -> float:
        """Mean of ``20 log10 |W|/max |Delta|`` over the measured frequencies."""
        ratio = self.magnitude(self.maximum_frequency_hz) / self.maximum
        return float(np.mean(_DECIBEL * np.log(ratio)))


def uncertainty_bound(
    responses: Sequence[FrequencyResponse],
    nominal: Callable[[NDArray[np.float64]], NDArray[np.complex128]],
    *,
    order: int = 2,
) -> UncertaintyBound:
    """
    Return a tight bound of the multiplicative uncertainty.

    Parameters
    ----------
    responses : sequence of FrequencyResponse
        Measured responses G_m, usually one per offset and amplitude.
    nominal : callable
        The sampled response G of the model at frequencies in hertz, for instance
        ``DynamicsFit.sampled_response``: measured responses contain the hold, so G must too.
    order : int, optional
        Order of W(s), 0 … 8.

    Returns
    -------
    UncertaintyBound
        The bound, which is valid at every point.

    Raises
    ------
    ValueError
        If there is no response, the order is not possible, or no point differs from the nominal.

    """
    if not responses:
        raise ValueError('responses is empty, at least one frequency response is needed')
    if not 0 <= order <= 8:
        raise ValueError(f'order is {order}, allowed is 0 … 8')
    columns = [
        np.concatenate([getattr(response, name) for response in responses])
        for name in ('frequency_hz', 'response', 'amplitude', 'offset')]
    ascending = np.argsort(columns[0], kind='stable')
    frequency, measured, amplitude, offset = (column[ascending] for column in columns)
    model = np.asarray(nominal(frequency))
    delta = (measured - model) / model
    where, largest = _envelope(frequency, np.abs(delta))
    if not largest.max() > 0.0:
        raise ValueError('the responses do not differ from the nominal one, there is no bound')
    # Points that equal the model but for rounding would pull the bound to zero there.
    largest = np.maximum(largest, 1e-6 * largest.max())
    fitted = _fit(where, largest, order)
    numerator, denominator = fitted.polynomials()
    bound = UncertaintyBound(
        order, numerator, denominator, frequency, delta, amplitude, offset, where, largest)
    # The fit merges frequencies that are nearly equal; the bound must be valid at every point.
    return replace(bound, numerator=numerator * max(1.0, (1.0 + _MARGIN) / bound.smallest_margin))


def _envelope(
    frequency_hz: NDArray[np.float64], size: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the largest size at each frequency; the frequencies ascend."""
    breaks = np.flatnonzero(
        np.diff(frequency_hz) > _SAME_FREQUENCY * frequency_hz[1:]) + 1
    starts = np.concatenate([[0], breaks])
    return frequency_hz[starts], np.maximum.reduceat(size, starts)


class _Corners(NamedTuple):
    """Zeros and poles as sections of unit dc gain, and the dc gain of W."""

    zeros: NDArray[np.float64]  # (order,) log corner frequencies, then log dampings
    poles: NDArray[np.float64]
    log_gain: float
    order: int

    def polynomials(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        numerator, denominator = (
            _polynomial(parameters, self.order) for parameters in (self.zeros, self.poles))
        gain = math.exp(self.log_gain) / numerator[-1] * denominator[-1]
        return gain * numerator, denominator


def _polynomial(parameters: NDArray[np.float64], order: int) -> NDArray[np.float64]:
    """Return the monic polynomial of sections, s in rad/s."""
    count = order - order // 2
    corner = np.exp(parameters[:count])
    damping = np.exp(parameters[count:])
    polynomial = np.ones(1)
    for i, w in enumerate(corner.tolist()):
        section = [1.0, 2.0 * damping[i] * w, w * w] if i < damping.size else [1.0, w]
        polynomial = np.polymul(polynomial, section)
    return np.asarray(polynomial)


def _log_magnitude(
    parameters: NDArray[np.float64], order: int, log_omega: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return log |sections| of unit dc gain, shape (F,), and its derivatives, (F, order)."""
    count = order - order // 2
    value = np.zeros_like(log_omega)
    slopes = np.zeros((log_omega.size, order))
    for i in range(count):
        square = np.exp(2.0 * (log_omega - parameters[i]))  # (w/w_i)^2
        if i < order // 2:
            middle = 4.0 * math.exp(2.0 * parameters[count + i]) * square
            power = (1.0 - square)**2 + middle
            slopes[:, i] = (2.0 * square * (1.0 - square) - middle) / power
            slopes[:, count + i] = middle / power
        else:
            power = 1.0 + square
            slopes[:, i] = -square / power
        value += 0.5 * np.log(power)
    return value, slopes


def _fit(
    frequency_hz: NDArray[np.float64], largest: NDArray[np.float64], order: int,
) -> _Corners:
    """Minimise the mean of log |W| under log |W| >= log max |Delta|."""
    log_omega = np.log(2.0 * np.pi * frequency_hz)
    target = np.log(largest)
    if order == 0:
        return _Corners(np.empty(0), np.empty(0), float(target.max()), 0)

    def above(vector: NDArray[np.float64]) -> NDArray[np.float64]:
        zeros, _ = _log_magnitude(vector[:order], order, log_omega)
        poles, _ = _log_magnitude(vector[order:2 * order], order, log_omega)
        return np.asarray(vector[-1] + zeros - poles - target)

    def above_slopes(vector: NDArray[np.float64]) -> NDArray[np.float64]:
        _, zeros = _log_magnitude(vector[:order], order, log_omega)
        _, poles = _log_magnitude(vector[order:2 * order], order, log_omega)
        return np.hstack([zeros, -poles, np.ones((log_omega.size, 1))])

    def mean_above(vector: NDArray[np.float64]) -> float:
        return float(above(vector).mean())

    def mean_above_slopes(vector: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(above_slopes(vector).mean(axis=0))

    low, high = float(log_omega[0]) - 1.0, float(log_omega[-1]) + 1.0
    count = order - order // 2
    limits = [(low, high)] * count + [
        (math.log(_DAMPING[0]), math.log(_DAMPING[1]))] * (order - count)
    bounds: Any = [*limits, *limits, (None, None)]
    constraint: Any = {'type': 'ineq', 'fun': above, 'jac': above_slopes}
    best: NDArray[np.float64] | None = None
    best_mean = math.inf
    for start in _starts(order, low, high):
        start[-1] = -float(above(start).min())
        found = minimize(
            mean_above, start, jac=mean_above_slopes, bounds=bounds, method='SLSQP',
            constraints=constraint, options={'maxiter': 300, 'ftol': 1e-10})
        for vector in (start, np.asarray(found.x)):
            if not np.all(np.isfinite(vector)):
                continue
            # Raised until it touches: an incomplete search costs tightness, never validity.
            lifted = vector.copy()
            lifted[-1] -= float(above(vector).min()) - _MARGIN
            mean = float(above(lifted).mean())
            if mean < best_mean:
                best, best_mean = lifted, mean
    assert best is not None
    return _Corners(best[:order], best[order:2 * order], float(best[-1]), order)


def _starts(order: int, low: float, high: float) -> list[NDArray[np.float64]]:
    """Return starts: zeros and poles spread over the frequencies, in all relative positions."""
    count = order - order // 2
    places = np.linspace(low, high, 5)[1:-1]
    starts = []
    for zero in places:
        for pole in places:
            for damping in (0.5, 1.5):
                corners = [
                    np.concatenate([
                        place + 0.3 * np.arange(count), np.full(order // 2, math.log(damping))])
                    for place in (zero, pole)]
                starts.append(np.concatenate([*corners, [0.0]]))
    return starts
