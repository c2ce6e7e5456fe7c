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
Harmonics of a periodic signal of which single samples are known.

With samples s_i at the indices k_i, the period P in samples and the phase p = 2 pi k / P::

    s(k) = c + sum over h of (a_h cos(h p) + b_h sin(h p)) + rest(k)

is solved for c, a_h and b_h by least squares. The amplitude of harmonic h is hypot(a_h, b_h); its
standard error follows from the rest, taken as uncorrelated between the samples.

The samples may be far apart: each phase of the period is met sooner or later. How well the
harmonics are told apart by these samples is in the standard errors.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ['HarmonicFit', 'HarmonicFitError', 'covered_share', 'fit_harmonics']

_MOST_HARMONICS: Final = 40
_SAMPLES_FOR_EACH: Final = 6  # samples wanted for each harmonic, which has two unknowns
_FEWEST_SAMPLES: Final = 40
_PHASE_BINS: Final = 20
_WORST_CONDITION: Final = 100.0


class HarmonicFitError(ValueError):
    """Samples that do not tell the harmonics of their signal; the text says why."""


@dataclass(frozen=True)
class HarmonicFit:
    """
    Harmonics of a signal.

    Attributes
    ----------
    mean : float
        Mean over a period, in the unit of the signal.
    amplitudes : ndarray, shape (n,)
        Amplitude of harmonics 1 … n, in the unit of the signal.
    standard_errors : ndarray, shape (n,)
        Of the amplitudes.
    rest_rms : float
        Root mean square of what is not periodic, or is of higher harmonics.

    """

    mean: float
    amplitudes: NDArray[np.float64]
    standard_errors: NDArray[np.float64]
    rest_rms: float


def covered_share(indices: ArrayLike, period_samples: float) -> float:
    """
    Return which share of a period has samples, in twentieths, or in samples of a shorter one.

    Parameters
    ----------
    indices : array_like of int, shape (n,)
        Indices of the samples.
    period_samples : float
        The period, in samples.

    """
    phases = np.mod(np.asarray(indices, dtype=np.float64) / period_samples, 1.0)
    number = max(1, min(_PHASE_BINS, int(period_samples)))
    bins = np.minimum((phases * number).astype(int), number - 1)
    return float(np.unique(bins).size / number)


def fit_harmonics(indices: ArrayLike, samples: ArrayLike, period_samples: float) -> HarmonicFit:
    """
    Return the harmonics of a periodic signal of which single samples are known.

    Parameters
    ----------
    indices : array_like of int, shape (n,)
        Indices of the samples, in any order.
    samples : array_like of float, shape (n,)
        The samples.
    period_samples : float
        The period, in samples.

    Raises
    ------
    HarmonicFitError
        If the samples are too few, or leave parts of the period out, or if the period has no
        harmonic below half of the sampling frequency.

    """
    k = np.asarray(indices, dtype=np.float64)
    s = np.asarray(samples, dtype=np.float64)
    if k.size < _FEWEST_SAMPLES:
        raise HarmonicFitError(f'{k.size} samples so far, {_FEWEST_SAMPLES} are needed')
    share = covered_share(k, period_samples)
    if share < 1.0:
        raise HarmonicFitError(f'the samples cover {share:.0%} of the period, all is needed')
    below_nyquist = math.ceil(period_samples / 2.0) - 1
    highest = min(_MOST_HARMONICS, k.size // _SAMPLES_FOR_EACH, below_nyquist)
    if highest < 1:
        raise HarmonicFitError(f'the period has {period_samples:g} samples, above 2 are needed')
    phases = np.outer(np.mod(k / period_samples, 1.0), 2.0 * np.pi * np.arange(1, highest + 1))
    design = np.hstack([np.ones((k.size, 1)), np.cos(phases), np.sin(phases)])
    q, r = np.linalg.qr(design)
    if np.linalg.cond(r) > _WORST_CONDITION:
        raise HarmonicFitError('the samples always meet the same phases of the period')
    inverse = np.linalg.inv(r)
    solution = inverse @ (q.T @ s)
    rest = s - design @ solution
    rest_variance = float(rest @ rest) / (k.size - solution.size)
    variances = rest_variance * np.sum(inverse**2, axis=1)
    a, b = solution[1:highest + 1], solution[highest + 1:]
    # Of both parts: which of them an amplitude near zero lies along is not known.
    errors = np.sqrt(0.5 * (variances[1:highest + 1] + variances[highest + 1:]))
    return HarmonicFit(
        float(solution[0]), np.hypot(a, b), errors, math.sqrt(float(rest @ rest) / k.size))
