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
Excitation of a stage for its frequency response: stepped sines and multisines.

An excitation is the command of every sample together with its windows: the stretches in which the
response has settled, each with its fundamental frequency and the excited multiples of it.

A stepped sine has P whole periods in M samples at each frequency, without a common factor::

    u[k] = offset + amplitude sin(2 pi P k / M),   f = P / (M Ts),   gcd(P, M) = 1

A multisine of the lines l with weights W_l has the phases of Schroeder to start from, improved by
clipping and restoring the amplitudes in turn::

    u[k] = offset + amplitude / peak  sum over l of W_l cos(2 pi l k / M + phi_l)
    phi_l = phi_{l'} - 2 pi (l - l') (share of the power up to l),   l' the line before l
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    'Excitation',
    'Window',
    'multisine',
    'odd_lines',
    'stepped_sine',
]

# Share of the peak at which it is clipped, round by round, in search of a low crest factor.
_CLIP_LEVELS = np.linspace(0.75, 0.97, 200).tolist()
_AMPLITUDE_SPREAD = 0.005
_GOLDEN = 0.6180339887498949  # multiples of it fill the unit interval evenly


class Window(NamedTuple):
    """A stretch of a record in which the response to a periodic input has settled."""

    start: int  # first sample
    stop: int  # one past the last sample
    fundamental_hz: float
    lines: tuple[int, ...] = (1,)  # excited multiples of the fundamental

    @property
    def frequency_hz(self) -> NDArray[np.float64]:
        """Frequencies of the excited lines, shape (L,)."""
        return self.fundamental_hz * np.array(self.lines, dtype=np.float64)


@dataclass(frozen=True)
class Excitation:
    """
    A command with the windows in which its response is evaluated.

    Attributes
    ----------
    command : ndarray, shape (N,)
        Command of every sample, micrometres (or volts, for the bare actuator).
    windows : tuple of Window
        The settled stretches.
    sample_period_s : float
        Sample period, seconds.

    """

    command: NDArray[np.float64]
    windows: tuple[Window, ...]
    sample_period_s: float

    @property
    def frequency_hz(self) -> NDArray[np.float64]:
        """Every excited frequency, in order of the windows."""
        return np.concatenate([window.frequency_hz for window in self.windows])


def stepped_sine(
    frequencies_hz: ArrayLike,
    amplitude: ArrayLike,
    sample_period_s: float,
    *,
    offset: float = 0.0,
    dwell_s: float = 0.1,
    minimum_periods: int = 8,
    settle_s: float = 0.01,
    settle_periods: float = 3.0,
    ramp_s: float = 0.1,
) -> Excitation:
    """
    Return a sine of stepped frequency, after a slow ramp to its offset.

    Each frequency is moved a little, so that a whole number of periods fills a whole number of
    samples and the two have no common factor: every sample then falls on another phase, and the
    steps of the converters average out instead of repeating in every period.

    Parameters
    ----------
    frequencies_hz : array_like, shape (F,)
        Wanted frequencies; the windows of the result have the exact ones.
    amplitude : array_like, shape () or (F,)
        Peak amplitude around the offset, micrometres (or volts).
    sample_period_s : float
        Sample period, seconds.
    offset : float, optional
        Mean value, same unit.
    dwell_s : float, optional
        Time that is evaluated at each frequency, at least `minimum_periods`.
    minimum_periods : int, optional
        Least number of periods that are evaluated.
    settle_s, settle_periods : float, optional
        Time and periods that are let pass before, whichever is longer.
    ramp_s : float, optional
        Duration of the ramp to the offset.

    Returns
    -------
    Excitation
        One window per frequency.

    Raises
    ------
    ValueError
        If a frequency is not between 0 and the Nyquist frequency, or the amplitude not positive.

    Examples
    --------
    10 and 20 periods in 1001 samples, 10 and 20 in 1000 having common factors:

    >>> excitation = stepped_sine([100.0, 200.0], 0.5, 1e-4)
    >>> [window.stop - window.start for window in excitation.windows]
    [1001, 1001]
    >>> [round(frequency, 1) for frequency in excitation.frequency_hz.tolist()]
    [99.9, 199.8]

    """
    frequencies = np.atleast_1d(np.asarray(frequencies_hz, dtype=np.float64))
    amplitudes = np.broadcast_to(np.asarray(amplitude, dtype=np.float64), frequencies.shape)
    for frequency in frequencies:
        _require_below_nyquist('frequencies_hz', float(frequency), sample_period_s)
    _require_positive('amplitude', amplitudes)
    # Whatever rounding does to the turning points, where hysteresis remembers it, differs from
    # frequency to frequency instead of shifting all of them alike.
    amplitudes = amplitudes * (1.0 - _AMPLITUDE_SPREAD * (_GOLDEN * np.arange(amplitudes.size) % 1))
    parts = [_ramp(offset, ramp_s, sample_period_s)]
    start = parts[0].size
    windows: list[Window] = []
    turns, turns_before = 0.0, math.inf  # per sample
    amplitude_before = 0.0
    for wanted_hz, peak in zip(frequencies.tolist(), amplitudes.tolist(), strict=True):
        periods = max(minimum_periods, round(dwell_s * wanted_hz))
        measured = math.ceil(periods / (wanted_hz * sample_period_s))
        while math.gcd(measured, periods) > 1:
            measured += 1
        exact_hz = periods / (measured * sample_period_s)
        settle = math.ceil(max(settle_s, settle_periods / wanted_hz) / sample_period_s)
        k = np.arange(settle + measured)
        # A new amplitude fades in over the first half of the settling, and at the lower of the
        # two frequencies: nothing is steeper than what is wanted.
        fading = settle // 2
        envelope = amplitude_before + (peak - amplitude_before) * _raised_cosine(
            k / max(1, fading))
        slower = min(turns_before, periods / measured)
        phase = turns + np.minimum(k, fading) * slower
        phase += np.maximum(k - fading, 0) * (periods / measured)
        parts.append(offset + envelope * np.sin(2.0 * np.pi * (phase % 1.0)))
        windows.append(Window(start + settle, start + k.size, exact_hz))
        turns_before = periods / measured
        turns = (turns + fading * slower + (k.size - fading) * turns_before) % 1.0
        start += k.size
        amplitude_before = peak
    return Excitation(np.concatenate(parts), tuple(windows), sample_period_s)


def odd_lines(highest_line: int, seed: int = 0, per_decade: float = math.inf) -> tuple[int, ...]:
    """
    Return odd lines of a multisine, one in four left out at random.

    What appears at the lines left out is distortion: of even order on the even lines, of odd order
    on the odd ones.

    Parameters
    ----------
    highest_line : int
        Highest line that may be excited.
    seed : int, optional
        Seed of the choice.
    per_decade : float, optional
        Most lines in a decade: thinned out, they are spread about evenly over the logarithm of
        frequency, as low and high frequencies should count alike in a fit.

    Returns
    -------
    tuple of int
        The excited lines, ascending.

    Examples
    --------
    >>> odd_lines(7)  # the lowest four are never left out
    (1, 3, 5, 7)

    """
    odd = np.arange(1, highest_line + 1, 2)
    generator = np.random.default_rng(seed)
    groups = [odd[i:i + 4] for i in range(0, odd.size, 4)]
    # The first group stays whole: the lowest frequencies are few enough.
    left_out = [int(generator.choice(group)) for group in groups[1:] if group.size == 4]
    kept: list[int] = []
    for line in odd.tolist():
        apart = not kept or math.log10(line / kept[-1]) >= 1.0 / per_decade
        if apart and line not in left_out:
            kept.append(line)
    return tuple(kept)


def multisine(
    fundamental_hz: float,
    lines: Sequence[int],
    amplitude: float,
    sample_period_s: float,
    *,
    offset: float = 0.0,
    weights: ArrayLike = 1.0,
    periods: int = 10,
    settle_periods: int = 1,
    ramp_s: float = 0.1,
    seed: int = 0,
) -> Excitation:
    """
    Return a multisine of low crest factor, after a slow ramp to its offset.

    The phases start from those of Schroeder plus a little at random and are improved by clipping
    the peaks and restoring the amplitudes, over and over.

    Parameters
    ----------
    fundamental_hz : float
        Spacing of the lines; moved a little so that a period is a whole number of samples.
    lines : sequence of int
        Excited multiples of the fundamental.
    amplitude : float
        Peak of the sum around the offset, micrometres (or volts).
    sample_period_s : float
        Sample period, seconds.
    offset : float, optional
        Mean value, same unit.
    weights : array_like, shape () or (L,), optional
        Relative amplitudes of the lines.
    periods, settle_periods : int, optional
        Periods that are evaluated, and those let pass before.
    ramp_s : float, optional
        Duration of the ramp to the offset.
    seed : int, optional
        Seed of the phases.

    Returns
    -------
    Excitation
        One window with all lines.

    Raises
    ------
    ValueError
        If a line is not between 0 and the Nyquist frequency, or the amplitude not positive.

    """
    period = round(1.0 / (fundamental_hz * sample_period_s))
    exact_hz = 1.0 / (period * sample_period_s)
    line = np.unique(np.asarray(lines, dtype=np.int64))
    for number in (line[0], line[-1]):
        _require_below_nyquist('lines', float(number * exact_hz), sample_period_s)
    _require_positive('amplitude', np.array([amplitude]))
    magnitude = np.broadcast_to(np.asarray(weights, dtype=np.float64), line.shape)
    wave = _low_crest(period, line, magnitude, np.random.default_rng(seed))
    wave *= amplitude / np.max(np.abs(wave))
    before = settle_periods * period
    # The first period fades in: a jump from the offset would ask for more than any amplifier has.
    whole = np.tile(wave, settle_periods + periods)
    whole[:before] *= _raised_cosine(np.arange(before) / max(1.0, 0.5 * before))
    ramp = _ramp(offset, ramp_s, sample_period_s)
    window = Window(
        ramp.size + before, ramp.size + whole.size, exact_hz, tuple(line.tolist()))
    return Excitation(np.concatenate([ramp, offset + whole]), (window,), sample_period_s)


def _low_crest(
    period: int, line: NDArray[np.int64], magnitude: NDArray[np.float64],
    generator: 'np.random.Generator',  # quoted: most nodes need not import it
) -> NDArray[np.float64]:
    """Return one period with the wanted magnitudes of its spectrum and a low peak."""
    power = np.cumsum(magnitude**2) / np.sum(magnitude**2)
    # Schroeder: the phase is the integral of a group delay that spreads the power evenly.
    phase: NDArray[np.floating] = -2.0 * np.pi * np.cumsum(np.diff(line, prepend=0) * power)
    phase += generator.uniform(-0.1, 0.1, line.size)
    spectrum = np.zeros(period // 2 + 1, dtype=np.complex128)
    best: NDArray[np.float64] = np.zeros(period)
    best_peak = math.inf
    for level in _CLIP_LEVELS:
        spectrum[line] = magnitude * np.exp(1j * phase)
        wave = np.fft.irfft(spectrum, period)
        peak = float(np.max(np.abs(wave)))
        if peak < best_peak:
            best, best_peak = wave, peak
        clipped = np.clip(wave, -level * peak, level * peak)
        phase = np.angle(np.fft.rfft(clipped)[line])
    return np.array(best)


def _raised_cosine(progress: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.clip(progress, 0.0, 1.0)))


def _ramp(offset: float, ramp_s: float, sample_period_s: float) -> NDArray[np.float64]:
    samples = math.ceil(ramp_s / sample_period_s)
    return offset * _raised_cosine(np.arange(samples) / max(1, samples))


def _require_below_nyquist(name: str, frequency_hz: float, sample_period_s: float) -> None:
    nyquist_hz = 0.5 / sample_period_s
    if not 0.0 < frequency_hz < nyquist_hz:
        raise ValueError(
            f'{name}: {frequency_hz:g} Hz, allowed is above 0 and below the Nyquist frequency '
            f'{nyquist_hz:g} Hz of sample_period_s {sample_period_s:g} s')


def _require_positive(name: str, values: NDArray[np.float64]) -> None:
    for value in values.tolist():
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f'{name} is {value}, it must be above 0')
