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
The excitation of a record, found in its input: stepped sine, multisine or any other.

The phase of a stepped sine is that of its analytic signal x + i Hilbert(x). Where whole turns take
equal times, there is a dwell; its frequency is that of the sine that fits best. A multisine repeats
itself: its period is where the autocorrelation of the input returns to 1. Everything else is
evaluated as a broadband input.

Examples
--------
>>> k = np.arange(4000)
>>> found = detect_excitation(np.sin(2.0 * np.pi * 0.0137 * k), 1e-3)
>>> found.kind, [round(window.fundamental_hz, 6) for window in found.windows]
('stepped', [13.7])

"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.signal import hilbert

from piezo_ros.control.tables.excitation import Window
from piezo_ros.series import bridged_series

__all__ = ['EXCITATION_KINDS', 'DetectedExcitation', 'detect_excitation']

EXCITATION_KINDS: Final = ('stepped', 'multisine', 'broadband')
_EQUAL: Final = 0.01  # relative difference of the periods of a dwell
_LEAST_EQUAL: Final = 0.05  # the same in the worst noise
_RECENT: Final = 32  # periods that the next one is compared with
_BENT: Final = 0.02  # of a period, by which the turns of a dwell may deviate from a straight line
_LEAST_PERIODS: Final = 4
_SETTLE_PERIODS: Final = 3
_SETTLE_SHARE: Final = 0.2  # of a dwell
_PURE: Final = 0.1  # rms of what is no sine, over that of the sine
_COVERED: Final = 0.4  # of the samples, by the dwells of a stepped sine
_REPEATED: Final = 0.98  # autocorrelation after a period
_DIFFERENT: Final = 0.5  # autocorrelation that it must have fallen below before
_LINE: Final = 1e-2  # least size of a line of a multisine, of the largest
_MOST_LINES: Final = 300


class DetectedExcitation(NamedTuple):
    """
    What the input of a record was.

    Attributes
    ----------
    kind : str
        One of `EXCITATION_KINDS`.
    windows : tuple of Window
        The settled stretches of a stepped sine or multisine.

    """

    kind: str
    windows: tuple[Window, ...]


def detect_excitation(
    input_: ArrayLike, sample_period_s: float, kind: str = 'auto',
) -> DetectedExcitation:
    """
    Return the excitation of a record.

    Parameters
    ----------
    input_ : array_like, shape (N,)
        Command or voltage; samples that are not finite are bridged.
    sample_period_s : float
        Sample period, seconds.
    kind : str, optional
        ``'stepped'``, ``'multisine'`` or ``'broadband'`` where it is known, else ``'auto'``.

    Raises
    ------
    ValueError
        If the input does not move, or is not of the kind that is told.

    """
    if kind not in ('auto', *EXCITATION_KINDS):
        raise ValueError(
            f'excitation is {kind!r}, allowed are auto, {", ".join(EXCITATION_KINDS)}')
    values = bridged_series(np.asarray(input_, dtype=np.float64))
    if not np.ptp(values) > 0.0:
        raise ValueError('the input does not move, no frequency is excited')
    if kind in ('auto', 'stepped'):
        windows = _dwells(values, sample_period_s)
        covered = sum(window.stop - window.start for window in windows)
        if windows and (kind == 'stepped' or covered > _COVERED * _moving(values)):
            return DetectedExcitation('stepped', windows)
        if kind == 'stepped':
            raise ValueError(
                f'the input has no dwell of {_LEAST_PERIODS} equal periods of a sine after '
                f'{_SETTLE_PERIODS} to settle')
    if kind in ('auto', 'multisine'):
        window = _periodic(values, sample_period_s)
        if window is not None:
            return DetectedExcitation('multisine', (window,))
        if kind == 'multisine':
            raise ValueError(
                'the input does not repeat itself over two periods after one to settle, with at '
                f'most {_MOST_LINES} lines')
    return DetectedExcitation('broadband', ())


def _moving(values: NDArray[np.float64]) -> int:
    """Return the number of samples between the first and the last change."""
    changes = np.flatnonzero(np.diff(values))
    return int(changes[-1] - changes[0] + 1)


def _dwells(values: NDArray[np.float64], sample_period_s: float) -> tuple[Window, ...]:
    """Return the settled part of every dwell of a stepped sine."""
    low, high = np.percentile(values, (0.5, 99.5))
    centred = values - 0.5 * (low + high)
    analytic = hilbert(centred, next_fast_len(values.size))[:values.size]
    cycles = np.maximum.accumulate(np.unwrap(np.angle(analytic)) / (2.0 * np.pi))
    first, last = math.ceil(cycles[0]), math.floor(cycles[-1])
    if last - first < _LEAST_PERIODS + _SETTLE_PERIODS:
        return ()
    turns = np.interp(np.arange(first, last + 1), cycles, np.arange(values.size, dtype=np.float64))
    periods = np.diff(turns)
    # Noise shifts each turn a little.
    jitter = float(np.median(np.abs(np.diff(periods)) / periods[1:]))
    equal = min(max(_EQUAL, 5.0 * jitter), _LEAST_EQUAL)
    windows = []
    begin = 0
    for end in range(1, periods.size + 1):
        recent = max(begin, end - _RECENT)
        mean = (turns[end] - turns[recent]) / (end - recent)
        if end < periods.size and abs(periods[end] - mean) <= equal * mean:
            continue
        settle = max(_SETTLE_PERIODS, math.ceil(_SETTLE_SHARE * (end - begin)))
        # Around the change of frequency the analytic signal is that of neither.
        start, stop = begin + settle, end - 1
        if stop - start >= _LEAST_PERIODS and _is_even(turns[start:stop + 1]):
            window = _sine(
                centred, math.ceil(turns[start]), math.floor(turns[stop]),
                float(stop - start) / float(turns[stop] - turns[start]), sample_period_s)
            if window is not None:
                windows.append(window)
        begin = end
    return tuple(windows)


def _is_even(turns: NDArray[np.float64]) -> bool:
    """Whether the turns are a straight line of the number of periods, as they are no chirp's."""
    number = np.arange(turns.size) - 0.5 * (turns.size - 1)
    slope = float(number @ turns) / float(number @ number)
    left = turns - turns.mean() - slope * number
    bend = number**2 - np.mean(number**2)
    curvature = float(bend @ left) / float(bend @ bend)
    return abs(curvature) * float(np.max(number**2)) < _BENT * slope


def _sine(
    values: NDArray[np.float64], start: int, stop: int, turns_per_sample: float,
    sample_period_s: float,
) -> Window | None:
    """Return the window of a sine of the best frequency; None if it is no sine."""
    part = values[start:stop]
    index = np.arange(part.size) - 0.5 * part.size
    frequency = turns_per_sample
    for _ in range(4):
        angle = 2.0 * np.pi * frequency * index
        design = np.stack([np.cos(angle), np.sin(angle), np.ones(part.size)], axis=1)
        (a, b, _), *_ = np.linalg.lstsq(design, part, rcond=None)
        slope = 2.0 * np.pi * index * (b * design[:, 0] - a * design[:, 1])
        solution, *_ = np.linalg.lstsq(
            np.column_stack([design, slope]), part, rcond=None)
        frequency += float(solution[3])
    if not abs(frequency / turns_per_sample - 1.0) < _EQUAL or frequency >= 0.5:
        return None
    residual = part - np.column_stack([design, slope]) @ solution
    if float(residual.std()) > _PURE * math.hypot(a, b) / math.sqrt(2.0):
        return None
    return Window(start, stop, frequency / sample_period_s)


def _periodic(values: NDArray[np.float64], sample_period_s: float) -> Window | None:
    """Return the window of a multisine, with its lines; None if the input is no multisine."""
    size = values.size
    tail = values[size // 4:] - values[size // 4:].mean()  # without ramp and fading in
    period = _period(tail)
    if period is None:
        return None
    lag = round(period)
    difference = np.abs(values[lag:] - values[:-lag])
    far = np.flatnonzero(difference > 0.1 * np.std(tail) + 1e3 * np.finfo(float).eps)
    inner = far[far < size // 2]
    start = (int(inner[-1]) + 1 if inner.size else 0) + lag  # one period for the stage to settle
    after = far[far >= size // 2]
    stop = int(after[0]) + lag if after.size else size
    whole = math.floor((stop - start) / period + 1e-6)
    if whole < 2:
        return None
    stop = start + min(round(whole * period), size - start)
    lines = _lines(values[start:stop], period, whole)
    if not 0 < len(lines) <= _MOST_LINES:
        return None
    return Window(start, stop, 1.0 / (period * sample_period_s), lines)


def _period(values: NDArray[np.float64]) -> float | None:
    """Return the period in samples by the autocorrelation, None if nothing repeats."""
    size = values.size
    length = next_fast_len(2 * size, real=True)
    correlation = irfft(np.abs(rfft(values, length))**2, length)[:size]
    squares = np.concatenate([[0.0], np.cumsum(values**2)])
    lags = np.arange(size)
    norm = np.sqrt(squares[size - lags] * (squares[size] - squares[lags]))
    usable = size // 2
    likeness = correlation[:usable] / np.maximum(norm[:usable], 1e-300)
    fallen = np.flatnonzero(likeness < _DIFFERENT)
    if not fallen.size:
        return None
    again = np.flatnonzero(likeness[fallen[0]:] > _REPEATED) + fallen[0]
    if not again.size:
        return None
    top = int(again[0])
    while top + 1 < usable and likeness[top + 1] > likeness[top]:
        top += 1
    period = float(top)
    for _ in range(60):  # a longer lag tells the period more exactly
        count = max(1, math.floor((usable - 2) / period))
        about = round(count * period)
        near = np.arange(max(about - 2, 1), min(about + 3, usable - 1))
        best = int(near[np.argmax(likeness[near])])
        left, middle, right = likeness[best - 1:best + 2].tolist()
        bend = left - 2.0 * middle + right
        refined = (best + (0.5 * (left - right) / bend if bend < 0.0 else 0.0)) / count
        if abs(refined - period) < 1e-9 * period:
            break
        period = refined
    # A period of whole samples is meant where it is one within the error of this search.
    return float(round(period)) if abs(period - round(period)) < 2e-3 else period


def _lines(values: NDArray[np.float64], period: float, whole: int) -> tuple[int, ...]:
    """Return the excited multiples of the fundamental."""
    spectrum = np.abs(rfft(values - values.mean())) / values.size
    highest = math.ceil(0.5 * period) - 1
    places = np.round(
        np.arange(1, highest + 1) * values.size / period).astype(int)
    places = places[places < spectrum.size]
    size = spectrum[places]
    between = np.median(np.delete(spectrum, places)) if spectrum.size > places.size + 8 else 0.0
    return tuple(
        (np.flatnonzero(size > max(_LINE * size.max(), 10.0 * between)) + 1).tolist())
