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
Harmonics of a periodic scan at its samples.

    u(t) = sum over k of a_k cos(2 pi k f t) + b_k sin(2 pi k f t)

A scan repeats itself sample by sample only after one or several periods of whole samples.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ['harmonic_basis', 'orders_of_band', 'repeating_samples', 'sample_turns']

_MOST_SAMPLES: Final = 20_000


def repeating_samples(frequency_hz: float, sample_period_s: float) -> int:
    """
    Return after how many samples a periodic scan repeats itself sample by sample.

    Parameters
    ----------
    frequency_hz : float
        Frequency of the scan.
    sample_period_s : float
        Sample period, seconds.

    Raises
    ------
    ValueError
        If it takes more than 20 000 samples.

    Examples
    --------
    >>> repeating_samples(300.0, 1e-5)  # three periods
    1000

    """
    samples = 1.0 / (frequency_hz * sample_period_s)
    if samples > _MOST_SAMPLES:
        raise ValueError(
            f'frequency_hz is {frequency_hz:g}: at a sample period of {sample_period_s:g} s a '
            f'period has {samples:.6g} samples, allowed are {_MOST_SAMPLES}; take a longer sample '
            f'period, or at least {1.0 / (_MOST_SAMPLES * sample_period_s):g} Hz')
    for periods in range(1, math.floor(_MOST_SAMPLES / samples) + 1):
        whole = round(periods * samples)
        if abs(periods * samples - whole) < 1e-7 * whole:
            return whole
    raise ValueError(
        f'frequency_hz is {frequency_hz}: at a sample period of {sample_period_s:g} s it does not '
        f'repeat within {_MOST_SAMPLES} samples; {1.0 / (round(samples) * sample_period_s):.9g} Hz '
        'does')


def harmonic_basis(turns: NDArray[np.float64], orders: NDArray[np.int64]) -> NDArray[np.float64]:
    """
    Return cosines, then sines, of the harmonics at given turns, shape (N, M).

    Parameters
    ----------
    turns : ndarray, shape (N,)
        Time over the period.
    orders : ndarray of int, shape (K,)
        Orders of the harmonics, rising; 0 has no sine, M = 2 K or 2 K - 1.

    """
    angle = 2.0 * np.pi * np.outer(turns, orders)
    return np.hstack([np.cos(angle), np.sin(angle[:, orders > 0])])


def orders_of_band(
    band_hz: float, frequency_hz: float, sample_period_s: float, *, is_symmetric: bool,
) -> NDArray[np.int64]:
    """
    Return the orders of the harmonics of a band, shape (K,).

    Parameters
    ----------
    band_hz, frequency_hz : float
        Highest frequency of the voltage and frequency of the scan.
    sample_period_s : float
        Sample period, seconds.
    is_symmetric : bool
        Whether odd harmonics are enough; else all are taken, and a mean.

    Raises
    ------
    ValueError
        If the band has no harmonic.

    """
    highest = math.floor(min(band_hz, 0.5 / sample_period_s * (1.0 - 1e-9)) / frequency_hz)
    if not highest:
        raise ValueError(
            f'band_hz is {band_hz:g}: it must be at least frequency_hz, {frequency_hz:g} Hz, and '
            'both below the Nyquist frequency')
    return np.arange(1, highest + 1, 2) if is_symmetric else np.arange(highest + 1)


def sample_turns(
    samples: int, frequency_hz: float, sample_period_s: float,
) -> NDArray[np.float64]:
    """Return the time of the first samples of a run over the period, shape (samples,)."""
    return np.arange(samples, dtype=np.float64) * (frequency_hz * sample_period_s)
