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

"""Samples that a caller hands over, checked before anything is computed from them."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ['bridged_series', 'finite_series']


def finite_series(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """
    Return samples as a contiguous array, shape (N,).

    Parameters
    ----------
    name : str
        What the caller calls them, for the message.
    values : array_like, shape (N,)
        The samples.

    Raises
    ------
    ValueError
        If they are not one-dimensional, or one of them is not finite.

    Examples
    --------
    >>> finite_series('voltage_v', [1, 2]).tolist()
    [1.0, 2.0]

    """
    series = np.ascontiguousarray(values, dtype=np.float64)
    if series.ndim != 1:
        raise ValueError(f'{name} has shape {series.shape}, it must be one-dimensional')
    finite = np.isfinite(series)
    if not finite.all():
        first = int(np.argmin(finite))
        raise ValueError(f'{name}[{first}] is {series[first]}, it must be finite')
    return series


def bridged_series(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return samples with straight lines over those that are not finite, shape (N,).

    Parameters
    ----------
    values : ndarray, shape (N,)
        The samples.

    Raises
    ------
    ValueError
        If no sample is finite.

    Examples
    --------
    >>> bridged_series(np.array([np.nan, 1.0, np.nan, 3.0])).tolist()
    [1.0, 1.0, 2.0, 3.0]

    """
    finite = np.isfinite(values)
    if finite.all():
        return values
    if not finite.any():
        raise ValueError('the input has no finite sample')
    index = np.arange(values.size)
    return np.interp(index, index[finite], values[finite])
