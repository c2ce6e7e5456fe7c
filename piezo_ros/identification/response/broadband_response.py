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
The frequency response of a record of any broadband input: random noise, a chirp, a PRBS.

In the spectra U and Y of a whole record, response and transient are smooth functions of frequency.
Around each frequency f they are fitted as polynomials over 2 n + 1 lines, by least squares::

    Y(f + d) = (h0 + h1 d + h2 d^2) U(f + d) + (t0 + t1 d + t2 d^2) + noise
    H(f) = h0,   variance = s^2 [(K^H K)^-1]_00,   s^2 = sum |residual|^2 / (2 n + 1 - 6)
    coherence = 1 - s^2/s0^2,   s0^2: that of the transient alone

This is H1 for an input that is known, without the bias of windowed segments: the transient takes
what the stage remembers from before the record, which a window only attenuates, so that the lines
of the whole record are resolved. n trades noise against resolution: the one of the least variance
plus squared bias is taken, by what polynomials of order 4 find otherwise; the bias is part of the
variance.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from piezo_ros.identification.response.amplifier_limits import Amplifier, limit_reached
from piezo_ros.identification.response.estimated_points import (
    HIGHEST_SHARE,
    Estimate,
    assembled_points,
    checked_record,
)
from piezo_ros.identification.response.frequency_response import FrequencyResponse

__all__ = ['broadband_response']

_ORDER: Final = 2  # of the polynomials
_HALF_WIDTHS: Final = (6, 8, 12, 18, 27, 42, 64, 100, 160)
_POINTS: Final = 200
_NOISE_SHARE: Final = 0.5  # of what noise makes of the bias on average, that is subtracted
_BRIDGED: Final = 2  # lost samples of the output in a row that are interpolated
_SHORTEST_PIECE: Final = 256


def broadband_response(
    input_: ArrayLike,
    output: ArrayLike,
    sample_period_s: float,
    *,
    voltage_v: ArrayLike | None = None,
    amplifier: Amplifier | None = None,
    points: int = _POINTS,
) -> FrequencyResponse:
    """
    Return the frequency response of a record of a broadband input.

    Parameters
    ----------
    input_ : array_like, shape (N,)
        Command, micrometres, or voltage, volts, as it was played; sample k is held until k + 1.
    output : array_like, shape (N,)
        Measured displacement, micrometres. Where samples of it or of the input are lost (NaN), the
        record is divided, and the responses of its pieces are averaged.
    sample_period_s : float
        Sample period, seconds.
    voltage_v : array_like, shape (N,), optional
        Amplifier input, for the check against its limits; the input itself by default.
    amplifier : Amplifier, optional
        Limits; a sample that reaches one counts as lost.
    points : int, optional
        Most points, spread over the logarithm of frequency.

    Returns
    -------
    FrequencyResponse
        The points in order of frequency; those of a coherence below 0.3 are left out.

    Raises
    ------
    ValueError
        If lengths differ, the record is too short, or no point is left.

    """
    inputs, outputs = checked_record(input_, output)
    bad = ~(np.isfinite(inputs) & np.isfinite(outputs))
    reached, reason = np.zeros(inputs.size, dtype=np.bool_), ''
    if amplifier is not None:
        volts = inputs if voltage_v is None else np.asarray(voltage_v, dtype=np.float64)
        reason, reached = limit_reached(volts, amplifier, sample_period_s)
    pieces = _pieces(inputs, _bridged(inputs, outputs), reached)
    if not pieces:
        raise ValueError(
            f'{int((bad | reached).sum())} of {inputs.size} samples are lost, and no piece of '
            f'{_SHORTEST_PIECE} samples is whole{"; " * bool(reason)}{reason}')
    spectra = [_Spectrum.of(*piece, sample_period_s) for piece in pieces]
    longest_s = max(piece[0].size for piece in pieces) * sample_period_s
    low, high = 2.0 * _HALF_WIDTHS[0] / longest_s, HIGHEST_SHARE / sample_period_s
    if not 2.0 * low < high:
        raise ValueError(
            f'a record of {inputs.size} samples is too short for a broadband input')
    edges = _edges(low, high, points, (2 * _HALF_WIDTHS[0] + 1) / longest_s)
    found = [
        _combined(0.5 * (lower + upper), [spectrum.at(lower, upper) for spectrum in spectra])
        for lower, upper in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)]
    used = sum(piece[0].size for piece in pieces)
    finite = inputs[np.isfinite(inputs)]
    response = assembled_points(
        found, float(np.ptp(finite)) / 2.0,
        float(finite.mean()), sample_period_s)
    losses = []
    if bad.any():
        losses.append(
            f'{int(bad.sum())} samples are lost, the first is sample {int(np.argmax(bad))}; '
            f'{len(pieces)} pieces with {used} of {inputs.size} samples are used')
    if reason:
        losses.append(f'{int(reached.sum())} samples are left out: {reason}')
    return dataclasses.replace(
        response, samples_used=used, samples_lost=int(bad.sum()), losses=tuple(losses))


def _bridged(
    inputs: NDArray[np.float64], outputs: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the output with single lost samples interpolated, where the input is known."""
    bad = ~np.isfinite(outputs)
    if not bad.any():
        return outputs
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bad, [False]]).astype(np.int8)))
    result = outputs.copy()
    result[bad] = np.nan
    for start, stop in edges.reshape(-1, 2).tolist():
        near = np.concatenate([np.arange(start - 4, start), np.arange(stop, stop + 4)])
        if (stop - start <= _BRIDGED and near[0] >= 0 and near[-1] < outputs.size
                and np.isfinite(outputs[near]).all()):
            result[start:stop] = CubicSpline(near, outputs[near])(np.arange(start, stop))
    return result


def _pieces(
    inputs: NDArray[np.float64], outputs: NDArray[np.float64], reached: NDArray[np.bool_],
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return the stretches without a lost sample that are long enough."""
    good = np.isfinite(inputs) & np.isfinite(outputs) & ~reached
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(np.int8)))
    runs = edges.reshape(-1, 2)
    if not runs.size:
        return []
    longest = int((runs[:, 1] - runs[:, 0]).max())
    least = max(_SHORTEST_PIECE, longest // 20)
    return [
        (inputs[start:stop], outputs[start:stop]) for start, stop in runs.tolist()
        if stop - start >= least and np.ptp(inputs[start:stop]) > 0.0]


def _edges(low: float, high: float, points: int, least: float) -> NDArray[np.float64]:
    """Return bounds of bands that are at least so wide, about even over the logarithm."""
    ratio = (high / low)**(1.0 / points)
    edges = [low]
    while edges[-1] < high:
        edges.append(max(edges[-1] * ratio, edges[-1] + least))
    return np.array(edges)


class _Spectrum(NamedTuple):
    """Spectra of one piece."""

    inputs: NDArray[np.complex128]
    outputs: NDArray[np.complex128]
    spacing_hz: float

    @classmethod
    def of(
        cls, inputs: NDArray[np.float64], outputs: NDArray[np.float64], sample_period_s: float,
    ) -> '_Spectrum':
        return cls(
            np.fft.rfft(inputs - inputs.mean()), np.fft.rfft(outputs - outputs.mean()),
            1.0 / (inputs.size * sample_period_s))

    def at(self, lower_hz: float, upper_hz: float) -> Estimate | None:
        """Return the estimate in the middle of a band, from the lines in it."""
        frequency_hz = 0.5 * (lower_hz + upper_hz)
        middle = round(frequency_hz / self.spacing_hz)
        room = math.floor(0.5 * (upper_hz - lower_hz) / self.spacing_hz)
        room = max(min(room, middle - 1, self.inputs.size - 2 - middle), 0)
        if room < _HALF_WIDTHS[0] and middle > _HALF_WIDTHS[0]:
            room = _HALF_WIDTHS[0] if (
                middle + _HALF_WIDTHS[0] < self.inputs.size
                and upper_hz - lower_hz > 1.9 * _HALF_WIDTHS[0] * self.spacing_hz) else 0
        fits = []
        for half in _HALF_WIDTHS:
            if half > room:
                break
            lines = slice(middle - half, middle + half + 1)
            fit = _local(
                self.inputs[lines], self.outputs[lines], frequency_hz / self.spacing_hz - middle)
            if fit is None:
                return None
            fits.append(fit)
        if not fits:
            return None
        # One estimate of the noise for all widths: else a narrow one is chosen where it happens to
        # look small.
        noise, degrees = fits[-1].noise, fits[-1].degrees
        best = min(fits, key=lambda fit: fit.squared_error(noise))
        return Estimate(
            frequency_hz, best.response,
            max(best.squared_error(noise), 1e-18 * abs(best.response)**2), degrees,
            fits[-1].coherence)


class _LocalFit(NamedTuple):
    """Polynomials of order 2 over some lines, compared with those of order 4."""

    response: complex
    unit_variance: float  # for noise of unit variance in each line
    shift_squared: float  # by which order 4 differs
    shift_unit_variance: float
    noise: float  # variance of a line, by order 4
    residual: float  # the same by order 2
    degrees: int
    coherence: float

    def squared_error(self, noise: float) -> float:
        """Return variance plus squared bias."""
        bias_squared = max(
            0.0, self.shift_squared - _NOISE_SHARE * noise * self.shift_unit_variance)
        # Behind an irregular input, what order 2 misses of the response acts as noise, too.
        return max(noise, self.residual) * self.unit_variance + bias_squared


def _local(
    inputs: NDArray[np.complex128], outputs: NDArray[np.complex128], centre: float,
) -> _LocalFit | None:
    half = inputs.size // 2
    distance = (np.arange(-half, half + 1) - centre) / half
    scale = math.sqrt(float(np.mean(np.abs(inputs)**2)))
    if not scale > 0.0:
        return None
    low = _solved(distance, inputs / scale, outputs, _ORDER)
    high = _solved(distance, inputs / scale, outputs, _ORDER + 2) if half > 6 else low
    if low is None or high is None:
        return None
    # What the transient leaves alone: an input without power of its own explains nothing more.
    powers = np.linalg.qr(distance[:, None]**np.arange(_ORDER + 1))[0]
    alone = float(np.sum(np.abs(outputs - powers @ (powers.T @ outputs))**2))
    alone /= inputs.size - powers.shape[1]
    noise = high.squares / high.degrees
    return _LocalFit(
        low.response / scale, low.unit_variance / scale**2,
        abs(high.response - low.response)**2 / scale**2,
        (high.unit_variance - low.unit_variance) / scale**2, noise,
        low.squares / low.degrees, high.degrees,
        max(0.0, 1.0 - noise / max(alone, 1e-300)))


class _Solution(NamedTuple):
    response: complex
    unit_variance: float
    squares: float
    degrees: int


def _solved(
    distance: NDArray[np.float64], inputs: NDArray[np.complex128],
    outputs: NDArray[np.complex128], order: int,
) -> _Solution | None:
    powers = distance[:, None]**np.arange(order + 1)
    design = np.hstack([powers * inputs[:, None], powers])
    basis, triangle = np.linalg.qr(design)
    diagonal = np.abs(np.diag(triangle))
    if diagonal.min() < 1e-9 * diagonal.max():
        return None
    inverse = np.linalg.inv(triangle)
    projected = basis.conj().T @ outputs
    squares = float(np.sum(np.abs(outputs - basis @ projected)**2))
    return _Solution(
        complex((inverse @ projected)[0]), float(np.sum(np.abs(inverse[0])**2)), squares,
        inputs.size - design.shape[1])


def _combined(frequency_hz: float, estimates: Sequence[Estimate | None]) -> Estimate:
    """Return the mean of the pieces, weighted by their variance."""
    found = [each for each in estimates if each is not None]
    if not found:
        return Estimate(frequency_hz, 0j, math.inf, 1.0, 0.0)
    weight = np.array([1.0 / each.variance for each in found])
    weight /= weight.sum()
    degrees = float(1.0 / np.sum(weight**2 / np.array([each.degrees for each in found])))
    return Estimate(
        frequency_hz,
        complex(np.sum(weight * np.array([each.response for each in found]))),
        float(np.sum(weight**2 * np.array([each.variance for each in found]))), degrees,
        float(np.sum(weight * np.array([each.coherence for each in found]))))
