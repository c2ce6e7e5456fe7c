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
A stable rational model with delay, and its response when sampled behind a zero-order hold.

    G(s) = sum_m n_m s^m / (prod_i (s/w_i + 1) prod_j ((s/w_j)^2 + 2 z_j s/w_j + 1)) exp(-s L)

with s in units of a reference frequency. The parameters are the logarithms of all w and z, so that
every model is stable, the n_m, and L. The sampled response is the sum over all aliases,

    H(exp(i w T)) = (1 - exp(-i w T))/T sum_k G(s_k)/s_k,   s_k = i (w + 2 pi k/T),

which is smooth in every parameter (poles may coincide) and is valid for any delay.

Examples
--------
G(s) = 2/(s + 1) at s = i:

>>> lag = Sections(np.zeros(1), np.empty(0), np.empty(0), np.array([2.0]), 0.0)
>>> value, _ = response(lag, np.array([1j]))
>>> value
array([1.-1.j])
>>> polynomials(lag, 1.0)
(array([2.]), array([1., 1.]))

"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ['Sections', 'Shape', 'polynomials', 'response', 'sampled_response']

# Aliases on either side, by the relative degree; the remainder is below 1e-6 of the response.
_ALIASES_DEGREE_1_2 = 12
_ALIASES_ELSE = 8


class Shape(NamedTuple):
    """Orders of a model."""

    numerator_order: int
    first_order: int  # number of first-order sections of the denominator
    second_order: int  # number of second-order sections
    fits_delay: bool = False

    @property
    def denominator_order(self) -> int:
        """Order of the denominator."""
        return self.first_order + 2 * self.second_order

    @property
    def size(self) -> int:
        """Number of parameters."""
        return self.denominator_order + self.numerator_order + 1 + self.fits_delay


class Sections(NamedTuple):
    """The parameters by their kind; frequencies in units of the reference frequency."""

    log_rate: NDArray[np.float64]  # (first_order,)
    log_frequency: NDArray[np.float64]  # (second_order,)
    log_damping: NDArray[np.float64]  # (second_order,)
    numerator: NDArray[np.float64]  # (numerator_order + 1,), lowest power first
    delay: float  # in units of the inverse reference frequency

    @classmethod
    def split(cls, shape: Shape, parameters: NDArray[np.float64], delay: float) -> 'Sections':
        """Return the sections of a parameter vector; `delay` is added to the fitted delay."""
        ends = np.cumsum([
            shape.first_order, shape.second_order, shape.second_order, shape.numerator_order + 1])
        rate, frequency, damping, numerator, rest = np.split(parameters, ends)
        return cls(rate, frequency, damping, numerator, delay + float(rest.sum()))

    def join(self, shape: Shape) -> NDArray[np.float64]:
        """Return the parameter vector (a fitted delay starts at zero)."""
        return np.concatenate([
            self.log_rate, self.log_frequency, self.log_damping, self.numerator,
            np.zeros(int(shape.fits_delay))])


def response(
    sections: Sections, s: NDArray[np.complex128],
) -> tuple[NDArray[np.complex128], list[NDArray[np.complex128]]]:
    """
    Return G and its derivatives by each parameter, in the order of the parameter vector.

    Parameters
    ----------
    sections : Sections
        The model.
    s : ndarray of complex
        Complex frequencies in units of the reference frequency; any shape.

    Returns
    -------
    value : ndarray of complex
        G, of the shape of s.
    derivatives : list of ndarray of complex
        By every parameter, the last by the delay; each of the shape of s.

    """
    denominator = np.asarray(np.exp(s * sections.delay), dtype=np.complex128)
    by_rate, by_frequency, by_damping = [], [], []
    for rate in np.exp(sections.log_rate).tolist():
        x = s / rate
        denominator = denominator * (x + 1.0)
        by_rate.append(x / (x + 1.0))
    for frequency, damping in zip(
            np.exp(sections.log_frequency).tolist(), np.exp(sections.log_damping).tolist(),
            strict=True):
        x = s / frequency
        middle = 2.0 * damping * x
        section = x * x + middle + 1.0
        denominator = denominator * section
        by_frequency.append((2.0 * x * x + middle) / section)
        by_damping.append(-middle / section)
    powers: list[NDArray[np.complex128]] = [1.0 / denominator]
    for _ in sections.numerator[1:]:
        powers.append(powers[-1] * s)
    value = sum(
        coefficient * power
        for coefficient, power in zip(sections.numerator.tolist(), powers, strict=True))
    value = np.asarray(value, dtype=np.complex128)
    derivatives = [value * factor for factor in (*by_rate, *by_frequency, *by_damping)]
    return value, [*derivatives, *powers, -s * value]


def sampled_response(
    sections: Sections, angular_frequency: NDArray[np.float64], sample_period: float,
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """
    Return the response of the model behind a zero-order hold, and its Jacobian.

    Parameters
    ----------
    sections : Sections
        The model; strictly proper.
    angular_frequency : ndarray, shape (N,)
        Below the Nyquist frequency, in units of the reference frequency.
    sample_period : float
        In units of its inverse.

    Returns
    -------
    value : ndarray of complex, shape (N,)
        H, output over input at the samples.
    jacobian : ndarray of complex, shape (N, P + 1)
        Derivatives by each parameter, the last by the delay.

    """
    count = _ALIASES_DEGREE_1_2 if _relative_degree(sections) <= 2 else _ALIASES_ELSE
    alias = np.arange(-count, count + 1) * (2.0 * np.pi / sample_period)
    s = 1j * (angular_frequency[:, None] + alias)
    turned: NDArray[np.complex128] = -np.expm1(-1j * angular_frequency * sample_period)
    hold = turned / sample_period
    value, derivatives = response(sections, s)
    sums = [(part / s).sum(axis=1) for part in (value, *derivatives)]
    if _relative_degree(sections) == 1:
        # G/s falls only with the square of s: the sum beyond the aliases is added in closed form.
        rates, pairs = sections.log_rate.size, sections.log_frequency.size
        slope = float(np.exp(sections.log_rate.sum() + 2.0 * sections.log_frequency.sum()))
        high = slope * float(sections.numerator[-1])  # G(s) -> high/s
        tail, by_delay = _ramp_tail(s, sections.delay, sample_period)
        shares = [high, *[high] * rates, *[2.0 * high] * pairs, *[0.0] * pairs,
                  *[0.0] * (sections.numerator.size - 1), slope]
        sums = [
            *(part + share * tail for part, share in zip(sums, shares, strict=False)),
            sums[-1] + high * by_delay]
    return hold * sums[0], hold[:, None] * np.stack(sums[1:], axis=1)


def _relative_degree(sections: Sections) -> int:
    order = len(sections.log_rate) + 2 * len(sections.log_frequency)
    return order + 1 - len(sections.numerator)


def _ramp_tail(
    s: NDArray[np.complex128], delay: float, sample_period: float,
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return sum exp(-s_k L)/s_k^2 over all k that are not in s, and its derivative by L."""
    whole, part = divmod(delay / sample_period, 1.0)
    z = np.exp(s[:, s.shape[1] // 2] * sample_period)
    # z transform of a ramp that starts between two samples.
    ramp = sample_period**2 * z**-whole * (z / (z - 1.0)**2 - part / (z - 1.0))
    slope = -sample_period * z**-whole / (z - 1.0)
    decay = np.exp(-s * delay)
    return ramp - (decay / s**2).sum(axis=1), slope + (decay / s).sum(axis=1)


def polynomials(
    sections: Sections, reference: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Return numerator and monic denominator in s, rad/s, highest power first.

    Parameters
    ----------
    sections : Sections
        The model.
    reference : float
        Reference frequency, rad/s.

    """
    numerator = sections.numerator / reference**np.arange(sections.numerator.size)
    denominator = np.ones(1)
    for rate in np.exp(sections.log_rate) * reference:
        numerator = numerator * rate
        denominator = np.polymul(denominator, [1.0, rate])
    for frequency, damping in zip(
            np.exp(sections.log_frequency) * reference, np.exp(sections.log_damping),
            strict=True):
        numerator = numerator * frequency**2
        denominator = np.polymul(denominator, [1.0, 2.0 * damping * frequency, frequency**2])
    return numerator[::-1], denominator
