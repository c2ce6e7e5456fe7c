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
Starts for the fit of a rational model: linear problems that need no start of their own.

Levy's problem, G(s_k) D(s_k) = N(s_k), reweighted by 1/|D| of the round before (Sanathanan and
Koerner 1963), relaxed vector fitting, and poles spread over the measured frequencies.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lstsq

from piezo_ros.identification.dynamics.rational_model import Sections, Shape, response
from piezo_ros.identification.estimation.vector_fitting import initial_poles, vector_fitting

__all__ = ['linear_starts', 'with_a_pole_more', 'with_best_numerator', 'with_poles']

_SANATHANAN_KOERNER_ROUNDS = 10
_EXTRA_RATE = 0.7  # of a pole that is added, over the highest measured frequency
_ASIDE = 1.05  # of its zero over it


def linear_starts(
    shape: Shape, angular_frequency: NDArray[np.float64], continuous: NDArray[np.complex128],
    weight: NDArray[np.float64],
) -> list[Sections]:
    """
    Return stable starts.

    Parameters
    ----------
    shape : Shape
        The orders.
    angular_frequency : ndarray, shape (N,)
        In units of the reference frequency, best of order 1.
    continuous : ndarray of complex, shape (N,)
        Response divided by hold and delay.
    weight : ndarray, shape (N,)
        Inverse standard errors.

    Returns
    -------
    list of Sections
        Models with delay 0.

    """
    s = np.asarray(1j * angular_frequency)
    terms = np.asarray(s[:, None]**np.arange(shape.numerator_order + 1), dtype=np.complex128)
    starts = []
    # Weighted by the noise, and evenly: points of little noise may be few.
    for weights in (weight, 1.0 / np.maximum(np.abs(continuous), 1e-9 * np.abs(continuous).max())):
        for poles in (
            _levy_poles(shape, s, terms, continuous, weights),
            vector_fitting(s, continuous, weights, initial_poles(shape.denominator_order, s)),
        ):
            starts.append(with_poles(shape, poles, angular_frequency, continuous, weights))
    for top in (1.0, 3.0):
        corner = top * np.geomspace(0.2, 1.0, shape.first_order + shape.second_order)
        spread = Sections(
            np.log(corner[:shape.first_order]), np.log(corner[shape.first_order:]),
            np.full(shape.second_order, math.log(0.3)), np.ones(1), 0.0)
        starts.append(with_best_numerator(spread, terms, angular_frequency, continuous, weight))
    return starts


def with_poles(
    shape: Shape, poles: NDArray[np.complex128], angular_frequency: NDArray[np.float64],
    continuous: NDArray[np.complex128], weight: NDArray[np.float64],
) -> Sections:
    """
    Return a model with given poles and the numerator that fits best.

    Parameters
    ----------
    shape : Shape
        The orders.
    poles : ndarray of complex
        Poles, closed under conjugation. Unstable ones are reflected into the left half plane,
        missing ones are added above the measured frequencies.
    angular_frequency, continuous, weight
        As for `linear_starts`.

    """
    top = float(angular_frequency.max())
    poles = -np.abs(poles.real) + 1j * poles.imag
    # Coefficients that vanish lose poles, which are replaced by fast ones.
    missing = shape.denominator_order - poles.size
    poles = np.concatenate([poles, -3.0 * top * np.arange(1, missing + 1)])
    pairs = sorted(poles[poles.imag > 0.0].tolist(), key=abs)
    real = sorted(np.abs(poles[poles.imag == 0.0].real).tolist())
    sections = [(abs(pole), max(-pole.real / abs(pole), 1e-3)) for pole in pairs]
    while len(sections) > shape.second_order:  # too few real poles: split a pair
        frequency, damping = max(sections, key=lambda section: section[1])
        sections.remove((frequency, damping))
        real = sorted([*real, frequency, frequency])
    while len(sections) < shape.second_order:  # too many: the fastest two become a pair
        fast, faster = real[-2:]
        del real[-2:]
        frequency = np.sqrt(fast * faster)
        sections.append((frequency, 0.5 * (fast + faster) / frequency))
    sections.sort()
    low = 1e-2 * float(angular_frequency.min())
    start = Sections(
        np.log(np.clip(real, low, 1e2 * top)),
        np.log(np.clip([frequency for frequency, _ in sections], low, 1e2 * top)),
        np.log(np.clip([damping for _, damping in sections], 1e-3, 1e1)),
        np.ones(1), 0.0)
    terms = np.asarray(
        (1j * angular_frequency)[:, None]**np.arange(shape.numerator_order + 1),
        dtype=np.complex128)
    return with_best_numerator(start, terms, angular_frequency, continuous, weight)


def with_best_numerator(
    poles: Sections, numerator_terms: NDArray[np.complex128],
    angular_frequency: NDArray[np.float64], continuous: NDArray[np.complex128],
    weight: NDArray[np.float64],
) -> Sections:
    """
    Return the same poles with the numerator that fits best, a linear problem.

    Parameters
    ----------
    poles : Sections
        The poles; numerator and delay are not used.
    numerator_terms : ndarray of complex, shape (N, n + 1)
        Powers of s from 0 to n at every frequency.
    angular_frequency, continuous, weight
        As for `linear_starts`.

    """
    value, _ = response(
        poles._replace(numerator=np.ones(1), delay=0.0),
        np.asarray(1j * angular_frequency, dtype=np.complex128))
    design = (weight * value)[:, None] * numerator_terms
    right = weight * continuous
    numerator = lstsq(
        np.vstack([design.real, design.imag]), np.concatenate([right.real, right.imag]))[0]
    return poles._replace(numerator=np.asarray(numerator))


def with_a_pole_more(sections: Sections) -> Sections:
    """Return nearly the same model with one more pole, and a zero a little beside it."""
    numerator = np.convolve(sections.numerator, [1.0, 1.0 / (_EXTRA_RATE * _ASIDE)])
    if sections.log_rate.size == 0:
        return sections._replace(
            log_rate=np.array([math.log(_EXTRA_RATE)]), numerator=numerator)
    # Two real poles are a pair of high damping.
    rate = math.exp(float(sections.log_rate[-1]))
    frequency = math.sqrt(rate * _EXTRA_RATE)
    return sections._replace(
        log_rate=sections.log_rate[:-1],
        log_frequency=np.append(sections.log_frequency, math.log(frequency)),
        log_damping=np.append(
            sections.log_damping, math.log(0.5 * (rate + _EXTRA_RATE) / frequency)),
        numerator=numerator)


def _levy_poles(
    shape: Shape, s: NDArray[np.complex128], numerator_terms: NDArray[np.complex128],
    continuous: NDArray[np.complex128], weight: NDArray[np.float64],
) -> NDArray[np.complex128]:
    zeros, poles = shape.numerator_order, shape.denominator_order
    # The constant of the denominator is 1.
    denominator_terms = s[:, None]**np.arange(1, poles + 1)
    linear = np.hstack([numerator_terms, -continuous[:, None] * denominator_terms])
    present = np.ones_like(continuous)
    coefficients = np.zeros(zeros + poles + 1)
    for _ in range(_SANATHANAN_KOERNER_ROUNDS):
        row = (weight / np.abs(present))[:, None]
        a = np.vstack([(row * linear).real, (row * linear).imag])
        right = row[:, 0] * continuous
        scale = np.linalg.norm(a, axis=0)
        scale[scale == 0.0] = 1.0
        coefficients = lstsq(a / scale, np.concatenate([right.real, right.imag]))[0] / scale
        present = 1.0 + denominator_terms @ coefficients[zeros + 1:]
        if not np.all(np.abs(present) > 0.0):
            break
    return np.asarray(np.roots(np.concatenate([coefficients[:zeros:-1], [1.0]])))
