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
Whiteness of residuals: their autocorrelation with the limits of white noise.

    r(l) = sum_k e[k] e*[k+l] / sum_k |e[k]|^2,   white: |r(l)| < 1.96/sqrt(N) in 95 % of the lags

of residuals e without their mean; for complex residuals, real and imaginary part of which are
alike, the real part of r has the limit 1.96/sqrt(2 N).
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ['Autocorrelation', 'autocorrelation']

_CONFIDENT: Final = 1.96
_MOST_LAGS: Final = 50


class Autocorrelation(NamedTuple):
    """
    Autocorrelation of a residual.

    Attributes
    ----------
    lag : ndarray, shape (L,)
        Lags, from 1 on.
    value : ndarray, shape (L,)
        Its value there, -1 … 1.
    limit : float
        Within plus and minus this 95 % of the values are for white noise.

    """

    lag: NDArray[np.float64]
    value: NDArray[np.float64]
    limit: float

    @property
    def outside_percent(self) -> float:
        """Share of the lags outside the limits, percent; about 5 for white noise."""
        return 100.0 * float(np.mean(np.abs(self.value) > self.limit))


def autocorrelation(residual: ArrayLike) -> Autocorrelation | None:
    """
    Return the autocorrelation of a residual.

    Parameters
    ----------
    residual : array_like of float or complex, shape (N,)
        In order of time or of frequency, finite.

    Returns
    -------
    Autocorrelation or None
        None for fewer than ten values, or where the residual is 0 throughout.

    Examples
    --------
    >>> white = autocorrelation(np.random.default_rng(1).standard_normal(5000))
    >>> white.outside_percent < 15.0
    True
    >>> bool(autocorrelation(np.sin(np.arange(5000.0) / 100.0)).value[0] > 0.9)
    True

    """
    values = np.asarray(residual)
    if values.size < 10:
        return None
    values = values - values.mean()
    whole = float(np.sum(np.abs(values) ** 2))
    if whole == 0.0:
        return None
    lags = np.arange(1, min(_MOST_LAGS, values.size // 2) + 1)
    found = [float(np.real(np.vdot(values[lag:], values[:-lag]))) / whole for lag in lags]
    halves = 2.0 if np.iscomplexobj(values) else 1.0
    return Autocorrelation(
        lags.astype(np.float64), np.array(found), _CONFIDENT / math.sqrt(halves * values.size))
