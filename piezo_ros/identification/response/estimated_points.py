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
Points of a broadband estimate, with a variance that is an estimate itself.

The variance is enlarged, so that its circle holds the truth in 95 % of cases (F: quantile of the F
distribution, m: degrees of freedom of the estimated variance)::

    variance -> variance F(0.95; 2, 2 m) / -log(0.05)
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import median_filter
from scipy.stats import f as f_distribution

from piezo_ros.identification.response.frequency_response import (
    ExcludedPoint,
    FrequencyResponse,
)

__all__ = ['HIGHEST_SHARE', 'Estimate', 'assembled_points', 'checked_record']

HIGHEST_SHARE: Final = 0.45  # of the sampling frequency, up to which a broadband input is evaluated
_LEAST_COHERENCE: Final = 0.3


class Estimate(NamedTuple):
    """An estimate of the response at a frequency."""

    frequency_hz: float
    response: complex
    variance: float  # E|error|^2, estimated with these degrees of freedom
    degrees: float
    coherence: float


def checked_record(
    input_: ArrayLike, output: ArrayLike,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Return input and output of a record as arrays.

    Raises
    ------
    ValueError
        If their shapes differ or they are not one-dimensional.

    """
    inputs = np.asarray(input_, dtype=np.float64)
    outputs = np.asarray(output, dtype=np.float64)
    if inputs.ndim != 1 or inputs.shape != outputs.shape:
        raise ValueError(
            f'input_ has shape {inputs.shape} and output {outputs.shape}, they must be '
            'one-dimensional and equal')
    return inputs, outputs


def assembled_points(
    estimates: Sequence[Estimate], amplitude: float, offset: float, sample_period_s: float,
) -> FrequencyResponse:
    """
    Return the points that are known well enough, and list the others.

    Parameters
    ----------
    estimates : sequence of Estimate
        In order of frequency.
    amplitude, offset : float
        Of the input, in its unit.
    sample_period_s : float
        Sample period, seconds.

    Raises
    ------
    ValueError
        If no point is left.

    """
    kept: list[Estimate] = []
    excluded: list[ExcludedPoint] = []
    # By that of the neighbours, too: points that noise makes look coherent would be chosen else.
    coherences = median_filter([each.coherence for each in estimates], size=5, mode='nearest')
    for each, level in zip(estimates, coherences.tolist(), strict=True):
        radius = math.sqrt(
            each.variance * float(f_distribution.ppf(0.95, 2, 2.0 * each.degrees)))
        reason = ''
        if level < _LEAST_COHERENCE:
            reason = f'the coherence is {level:.2g}, below {_LEAST_COHERENCE:g}'
        elif radius > abs(each.response):
            reason = f'the response is {abs(each.response):.2g} ± {radius:.2g}'
        if reason:
            excluded.append(ExcludedPoint(
                each.frequency_hz, amplitude, offset,
                f'{reason}: noise, or hardly any input at this frequency'))
        else:
            kept.append(each)
    if not kept:
        raise ValueError(
            'no point is left: ' + (excluded[0].reason if excluded else 'the record is too short'))
    frequency_hz, response, variance, degrees, coherence = (
        np.array(column) for column in zip(*kept, strict=True))
    size = frequency_hz.size
    inflated = variance * f_distribution.ppf(0.95, 2, 2.0 * degrees) / -math.log(0.05)
    return FrequencyResponse(
        frequency_hz, response, inflated, coherence, np.full(size, np.nan),
        np.full(size, amplitude), np.full(size, offset), sample_period_s, tuple(excluded))
