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
The tracking error of a run by harmonic of its reference.

With the fundamental frequency f and the sample period Ts, by least squares over the scored window::

    e[n] = e_0 + sum_k (a_k cos 2 pi k f n Ts + b_k sin 2 pi k f n Ts) + rest[n],  k = 1 ... K
    E_k  = sqrt(a_k^2 + b_k^2)
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ['ErrorHarmonics', 'error_harmonics']

_MOST_HARMONICS: Final = 40
_HIGHEST_SHARE: Final = 0.45  # of the sample rate: at the Nyquist frequency b_k is not determined


class ErrorHarmonics(NamedTuple):
    """
    Amplitudes of a tracking error at the harmonics of the reference.

    Attributes
    ----------
    harmonics : ndarray of int, shape (K,)
        1 to K.
    amplitude_um : ndarray, shape (K,)
        E_k, micrometres.
    mean_um : float
        e_0, micrometres.
    rest_rms_um : float
        RMS of what is at none of these frequencies (noise, drift, higher harmonics), micrometres.

    """

    harmonics: NDArray[np.int_]
    amplitude_um: NDArray[np.float64]
    mean_um: float
    rest_rms_um: float


def error_harmonics(
    error_um: ArrayLike, frequency_hz: float, sample_period_s: float,
) -> ErrorHarmonics:
    """
    Return the amplitudes of an error at the harmonics of its reference.

    Parameters
    ----------
    error_um : array_like, shape (N,)
        Tracking error over at least one period, micrometres.
    frequency_hz : float
        Fundamental frequency, hertz.
    sample_period_s : float
        Sample period, seconds.

    Returns
    -------
    ErrorHarmonics
        Up to the fortieth harmonic, or the last one below 0.45 of the sample rate; none where the
        window is shorter than a period.

    """
    error = np.asarray(error_um, dtype=np.float64)
    cycles = frequency_hz * sample_period_s
    count = min(_MOST_HARMONICS, math.floor(_HIGHEST_SHARE / cycles), (error.size - 1) // 2)
    if error.size * cycles < 1.0 - cycles or count < 1:
        count = 0
    harmonics = np.arange(1, count + 1)
    angles = 2.0 * np.pi * cycles * np.outer(np.arange(error.size), harmonics)
    basis = np.hstack((np.ones((error.size, 1)), np.cos(angles), np.sin(angles)))
    # The columns are nearly orthogonal over whole periods: the normal equations are good enough.
    weights = np.linalg.solve(basis.T @ basis, basis.T @ error)
    rest = error - basis @ weights
    return ErrorHarmonics(
        harmonics, np.hypot(weights[1:count + 1], weights[count + 1:]), float(weights[0]),
        float(np.sqrt(np.mean(rest**2))))
