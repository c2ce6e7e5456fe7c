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
The frequency response of a broadband input by Welch's method: segments that overlap by half.

By H1, or where the input is the noisy one, by H2, from M independent segments::

    H1 = Suy/Suu,   H2 = Syy/Syu,   variance = |H|^2 (1 - coherence)/(coherence (M - 1))

Segments of L samples resolve 1.5/(L Ts). A resonance that is narrower than that, or memory longer
than L, biases the result; `broadband_response` is free of that.
"""

import dataclasses
import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import get_window

from piezo_ros.identification.response.estimated_points import (
    HIGHEST_SHARE,
    Estimate,
    assembled_points,
    checked_record,
)
from piezo_ros.identification.response.frequency_response import FrequencyResponse

__all__ = ['WELCH_ESTIMATORS', 'welch_response']

WELCH_ESTIMATORS: Final = ('h1', 'h2')
_SEGMENTS: Final = 16  # independent ones that fit into the record by default


def welch_response(
    input_: ArrayLike, output: ArrayLike, sample_period_s: float, *, estimator: str = 'h1',
    segment_samples: int | None = None,
) -> FrequencyResponse:
    """
    Return the frequency response by Welch's method: Hann windows that overlap by half.

    Parameters
    ----------
    input_, output : array_like, shape (N,)
        The record; segments with a sample that is not finite are left out.
    sample_period_s : float
        Sample period, seconds.
    estimator : str, optional
        ``'h1'``, for noise in the output, or ``'h2'``, for noise in the input.
    segment_samples : int, optional
        Length of the segments; by default as long as 16 independent ones fit into the record.

    Returns
    -------
    FrequencyResponse
        The points; `notes` says what the segments resolve.

    Raises
    ------
    ValueError
        If the estimator is not known, or the record is too short or has no whole segments.

    """
    if estimator not in WELCH_ESTIMATORS:
        raise ValueError(f'estimator is {estimator!r}, allowed are {", ".join(WELCH_ESTIMATORS)}')
    inputs, outputs = checked_record(input_, output)
    length = segment_samples or 2 * inputs.size // (_SEGMENTS + 2)
    if not 16 <= length <= inputs.size // 2:
        raise ValueError(
            f'segment_samples is {length}, allowed is 16 … {inputs.size // 2} for a record of '
            f'{inputs.size} samples')
    hop = length // 2
    window = get_window('hann', length)
    starts = np.arange(0, inputs.size - length + 1, hop)
    segments = [
        tuple(window * (part - part.mean()) for part in (
            inputs[start:start + length], outputs[start:start + length]))
        for start in starts.tolist()
        if np.isfinite(inputs[start:start + length] + outputs[start:start + length]).all()]
    # Of half-overlapping Hann windows, two neighbours are correlated by 1/6.
    independent = len(segments) / (1.0 + 2.0 / 36.0)
    if independent < 3.0:
        raise ValueError(f'{len(segments)} whole segments of {length} samples are too few')
    u, y = (np.fft.rfft(np.array(parts), axis=1) for parts in zip(*segments, strict=True))
    suu, syy = np.sum(np.abs(u)**2, axis=0), np.sum(np.abs(y)**2, axis=0)
    suy = np.sum(u.conj() * y, axis=0)
    chosen = np.arange(2, math.floor(HIGHEST_SHARE * length))
    suu, syy, suy = suu[chosen], syy[chosen], suy[chosen]
    coherence = np.clip(np.abs(suy)**2 / np.maximum(suu * syy, 1e-300), 0.0, 1.0)
    response = suy / suu if estimator == 'h1' else syy / np.where(suy == 0.0, 1.0, suy.conj())
    variance = np.abs(response)**2 * (1.0 - coherence) / (
        np.maximum(coherence, 1e-12) * (independent - 1.0))
    frequency_hz = chosen / (length * sample_period_s)
    # Neighbouring lines of a Hann window are not independent, every other one nearly.
    estimates = [
        Estimate(*values) for values in zip(
            frequency_hz[::2].tolist(), response[::2].tolist(),
            np.maximum(variance, 1e-18 * np.abs(response)**2)[::2].tolist(),
            [independent - 1.0] * frequency_hz[::2].size, coherence[::2].tolist(), strict=True)]
    finite = inputs[np.isfinite(inputs)]
    result = assembled_points(
        estimates, float(np.ptp(finite)) / 2.0, float(finite.mean()), sample_period_s)
    note = (
        f'{len(segments)} segments of {length * sample_period_s:.3g} s resolve '
        f'{1.5 / (length * sample_period_s):.3g} Hz: a narrower resonance is flattened')
    return dataclasses.replace(
        result, samples_used=int(np.isfinite(inputs + outputs).sum()),
        samples_lost=int((~np.isfinite(inputs + outputs)).sum()),
        notes=(note,))
