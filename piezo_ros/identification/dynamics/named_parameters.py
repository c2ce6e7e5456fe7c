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
The parameters of a fitted model by name and unit, with their derivatives, and as sections.

The parameter vector of `rational_model` is in units of a reference frequency and in logarithms; a
standard error of a named parameter is that of the vector times the derivative.
"""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification.dynamics.rational_model import Sections, Shape

__all__ = ['named_liu', 'named_rational', 'parameter_names', 'section_lists']

_NOT_SEEN = 1e4  # over the highest measured frequency: such poles and zeros are rounding
_FASTEST_RAD_PER_S = 1e9  # that the nodes take
_REAL = 1e-9  # imaginary part over size: below it, a root is real


def named_rational(
    sections: Sections, shape: Shape, reference: float,
) -> tuple[dict[str, float], NDArray[np.float64]]:
    """
    Return poles, numerator and delay by name, and their derivatives by the parameter vector.

    Parameters
    ----------
    sections : Sections
        The model.
    shape : Shape
        Its orders.
    reference : float
        Reference frequency, rad/s.

    Returns
    -------
    values : dict of str to float
        Numerator coefficients are those over a denominator of unit dc gain.
    transform : ndarray, shape (V, P)
        Derivatives.

    """
    values: dict[str, float] = {}
    slopes: list[float] = []
    for name, logs, unit in (
        ('rate', sections.log_rate, reference),
        ('natural_frequency', sections.log_frequency, reference),
        ('damping_ratio', sections.log_damping, 1.0),
    ):
        for number, value in enumerate((np.exp(logs) * unit).tolist(), start=1):
            suffix = '_rad_per_s' if unit != 1.0 else ''
            values[f'{name}_{number}{suffix}'] = value
            slopes.append(value)
    for power, coefficient in enumerate(sections.numerator.tolist()):
        values[f'numerator_s{power}'] = coefficient / reference**power
        slopes.append(1.0 / reference**power)
    if shape.fits_delay:
        values['delay_s'] = sections.delay / reference
        slopes.append(1.0 / reference)
    return values, np.diag(slopes)


def named_liu(
    sections: Sections, reference: float,
) -> tuple[dict[str, float], NDArray[np.float64]]:
    """
    Return the parameters of (6) in Liu 2015, the slower pair first, and their derivatives.

    Parameters
    ----------
    sections : Sections
        One rate, two pairs and a numerator of order 2.
    reference : float
        Reference frequency, rad/s.

    Returns
    -------
    values : dict of str to float
        The eight parameters.
    transform : ndarray, shape (8, 8)
        Derivatives by the parameter vector.

    """
    first, second = np.argsort(sections.log_frequency).tolist()
    rate = math.exp(float(sections.log_rate[0])) * reference
    frequency = np.exp(sections.log_frequency) * reference
    damping = np.exp(sections.log_damping)
    n0, n1, n2 = sections.numerator.tolist()
    k = n2 / reference**2 * rate * float(np.prod(frequency**2))
    b1, b2 = n1 / n2 * reference, n0 / n2 * reference**2
    # Order of the vector: log rate, log frequencies (2), log dampings (2), n0, n1, n2.
    rows = {
        'gain_k_rad3_per_s3': (k, {0: k, 1: 2.0 * k, 2: 2.0 * k, 7: k / n2}),
        'zero_b1_rad_per_s': (b1, {6: reference / n2, 7: -b1 / n2}),
        'zero_b2_rad2_per_s2': (b2, {5: reference**2 / n2, 7: -b2 / n2}),
        'time_constant_s': (1.0 / rate, {0: -1.0 / rate}),
    }
    for number, place in ((1, first), (2, second)):
        zeta, omega = float(damping[place]), float(frequency[place])
        rows[f'damping_ratio_{number}'] = (zeta, {3 + place: zeta})
        rows[f'natural_frequency_{number}_rad_per_s'] = (omega, {1 + place: omega})
    transform = np.zeros((len(rows), 8))
    for row, (_, slopes) in enumerate(rows.values()):
        for column, slope in slopes.items():
            transform[row, column] = slope
    return {name: value for name, (value, _) in rows.items()}, transform


def parameter_names(shape: Shape) -> list[str]:
    """Return names for the logarithms in the parameter vector: rates, frequencies, dampings."""
    return [
        *(f'rate_{i}' for i in range(1, shape.first_order + 1)),
        *(f'natural_frequency_{i}' for i in range(1, shape.second_order + 1)),
        *(f'damping_ratio_{i}' for i in range(1, shape.second_order + 1))]


def section_lists(
    sections: Sections, reference: float,
) -> Mapping[str, float | list[float]]:
    """
    Return a model as the parameters of ``dynamics: sections``, without its delay.

    Parameters
    ----------
    sections : Sections
        The model.
    reference : float
        Reference frequency, rad/s.

    Returns
    -------
    mapping of str to float or list of float
        Dc gain and the lists of poles and zeros. Pairs with real poles are two rates.

    Raises
    ------
    ValueError
        If the dc gain is not positive.

    """
    gain = float(sections.numerator[0])
    if not gain > 0.0:
        raise ValueError(
            f'the dc gain of the model is {gain:.4g}, it must be positive: is the sign of the '
            'displacement that of the command?')
    rates = np.exp(sections.log_rate).tolist()
    pairs = []
    for frequency, damping in zip(
            np.exp(sections.log_frequency).tolist(), np.exp(sections.log_damping).tolist(),
            strict=True):
        if damping < 1.0:
            pairs.append((frequency, damping))
        else:
            apart = damping + math.sqrt(damping * damping - 1.0)
            rates += [frequency / apart, frequency * apart]
    # By a rounding below what the nodes take: it is multiplied by the reference again.
    fastest = min(_NOT_SEEN, (1.0 - 1e-12) * _FASTEST_RAD_PER_S / reference)
    rates = [min(rate, fastest) for rate in rates]
    zero_rates, zero_pairs = _factors(sections.numerator, fastest)
    lists = {
        'pole_rates_rad_per_s': sorted(rates),
        'pole_frequencies_rad_per_s': [frequency for frequency, _ in sorted(pairs)],
        'pole_damping_ratios': [damping for _, damping in sorted(pairs)],
        'zero_rates_rad_per_s': zero_rates,
        'zero_frequencies_rad_per_s': [frequency for frequency, _ in zero_pairs],
        'zero_damping_ratios': [damping for _, damping in zero_pairs],
    }
    return {'gain_um_per_um': gain, **{
        name: [value * reference for value in values] if name.endswith('_s') else values
        for name, values in lists.items()}}


def _factors(
    numerator: NDArray[np.float64], fastest: float,
) -> tuple[list[float], list[tuple[float, float]]]:
    """Return the rates of the real zeros, and frequency and damping of the pairs."""
    roots = np.roots(np.trim_zeros(numerator[::-1], 'f'))
    roots = roots[np.abs(roots) < fastest]
    real = np.abs(roots.imag) <= _REAL * np.abs(roots)
    pairs = roots[~real & (roots.imag > 0.0)]
    return (
        sorted((-roots[real].real).tolist(), key=abs),
        sorted(zip(np.abs(pairs).tolist(), (-pairs.real / np.abs(pairs)).tolist(), strict=True)))
