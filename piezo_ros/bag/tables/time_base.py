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
The time base of a measured table: evenly spaced samples, or the means to make them so.

A column of times is evenly spaced with the period T if no time t_k is further than a tenth of T
from the line t_0 + k T; more, up to half of T, is taken where every time is a multiple of a decimal
step that explains it: the file has rounded.
"""

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag.tables.table import TableError

__all__ = ['TimeBase', 'time_base']

_EVEN_SHARE: Final = 0.1  # of the period, by which a time may be off
_ROUNDED_SHARE: Final = 0.5
_MISSING: Final = 1.75  # periods between two rows, from which one in between is missing
_LONGEST_GAP: Final = 3.0  # periods, over which is interpolated
_MOST_OF_A_ROW: Final = 1000  # samples that are interpolated
_SHORTEST_S: Final = 1e-9  # sample period that the nodes have
_LONGEST_S: Final = 1e3
_CLOSE: Final = 1e-6  # relative difference of two periods that are the same
_MOST_DIGITS: Final = 12
# Frequency, as a share of the sampling rate, from which linear interpolation takes over 5 %.
_INTERPOLATED_SHARE: Final = 0.1

_Floats = NDArray[np.float64]


class TimeBase(NamedTuple):
    """
    How rows become evenly spaced samples.

    Attributes
    ----------
    sample_period_s : float
        Sample period, seconds.
    samples : int
        Number of samples.
    first_s : float
        Time of the first row in the file, seconds.
    at_s : ndarray or None
        Times of the rows, from the first, where samples are interpolated between them; None where
        the rows are the samples.
    note : str
        What a reader should know of it, '' for nothing.

    """

    sample_period_s: float
    samples: int
    first_s: float = 0.0
    at_s: _Floats | None = None
    note: str = ''

    def values(self, rows: _Floats) -> _Floats:
        """Return the samples of a column, from its rows."""
        if self.at_s is None:
            return rows
        return np.asarray(
            np.interp(np.arange(self.samples) * self.sample_period_s, self.at_s, rows))


def time_base(
    name: str, time_s: _Floats, place: Callable[[int], str], *,
    sample_period_s: float | None = None, resample: bool = False,
) -> TimeBase:
    """
    Return the time base of a column of times.

    Parameters
    ----------
    name : str
        What errors begin with: the file.
    time_s : ndarray, shape (N,)
        The times, seconds.
    place : callable
        Names a row, counted from 0.
    sample_period_s : float, optional
        The sample period where it is known; it must agree with the times, unless they are
        resampled.
    resample : bool, optional
        Whether to interpolate at even times.

    Raises
    ------
    TableError
        If a time is not finite or not later than the one before, if the rows are not evenly
        spaced and must be, if a gap is too long to interpolate in it, or if the sample period is
        none that the nodes have, or makes more samples than the rows can tell.

    """
    if time_s.size < 2:
        raise TableError(f'{name} has {time_s.size} rows, at least 2 are needed')
    bad = np.flatnonzero(~np.isfinite(time_s))
    if bad.size:
        raise TableError(
            f'{name}: the time in {place(int(bad[0]))} is {time_s[bad[0]]}, it must be a number')
    if not time_s[-1] > time_s[0]:
        raise TableError(
            f'{name}: the time does not rise: it is {time_s[0]:.12g} s in {place(0)} and '
            f'{time_s[-1]:.12g} s in {place(time_s.size - 1)}')
    steps = np.diff(time_s)
    back = np.flatnonzero(steps <= 0.0)
    rounded_s = _coarse_step(time_s)
    if back.size and not (rounded_s and np.all(steps >= 0.0)):
        row = int(back[0]) + 1
        raise TableError(
            f'{name}: the time in {place(row)} is {time_s[row]:.12g} s, behind '
            f'{time_s[row - 1]:.12g} s; it must rise from row to row')
    first_s = float(time_s[0])
    at_s = time_s - first_s
    mean_s = float(at_s[-1]) / (time_s.size - 1)
    if not _SHORTEST_S <= mean_s <= _LONGEST_S:
        raise TableError(
            f'{name}: the time goes on by {mean_s:g} s from row to row, allowed is '
            f'{_SHORTEST_S:g} … {_LONGEST_S:g} s; is its unit right?')
    if resample:
        return _resampled(name, at_s, first_s, steps, place, sample_period_s)
    period_s = _even_period(name, at_s, steps, place, rounded_s)
    if sample_period_s is not None:
        drift_s = abs(sample_period_s - period_s) * (time_s.size - 1)
        if drift_s > max(period_s, _CLOSE * at_s[-1]):
            raise TableError(
                f'{name}: the sample period is {period_s:.9g} s by the times, and '
                f'--sample-period-s {sample_period_s:.9g}; leave one out, or --resample')
        period_s = sample_period_s
    return TimeBase(period_s, time_s.size, first_s)


def _even_period(
    name: str, at_s: _Floats, steps: _Floats, place: Callable[[int], str],
    rounded_s: float | None,
) -> float:
    """Return the period of evenly spaced times, or refuse them."""
    rows = at_s.size
    mean_s = float(at_s[-1]) / (rows - 1)
    off_s = np.abs(at_s - mean_s * np.arange(rows))
    worst = int(np.argmax(off_s))
    explained = rounded_s is not None and float(off_s[worst]) <= 1.01 * rounded_s
    allowed = _ROUNDED_SHARE if explained else _EVEN_SHARE
    if float(off_s[worst]) > allowed * mean_s:
        widest = int(np.argmax(steps))
        median_s = float(np.median(steps))
        if median_s > 0.0 and steps[widest] > _MISSING * median_s:
            raise TableError(
                f'{name}: rows are missing: from {place(widest)} to {place(widest + 1)} the time '
                f'goes on by {steps[widest]:.6g} s, elsewhere by {median_s:.6g} s; import the '
                'parts by themselves (--from-s, --to-s), or --resample')
        raise TableError(
            f'{name}: the rows are not evenly spaced in time: {place(worst)} is '
            f'{100.0 * off_s[worst] / mean_s:.0f} % of a sample period beside the mean, allowed '
            f'are {100.0 * _EVEN_SHARE:.0f} %; --resample interpolates at even times')
    return _roundest(mean_s, 2.0 * float(off_s[worst]) / (rows - 1) + 1e-12 * mean_s)


def _coarse_step(time_s: _Floats) -> float | None:
    """Return the decimal step that all times are multiples of, None for none above 1e-12 s."""
    for digits in range(_MOST_DIGITS + 1):
        step_s = 10.0**-digits
        multiples = time_s / step_s
        if np.all(np.abs(multiples - np.round(multiples)) < 1e-4):
            return step_s
    return None


def _roundest(period_s: float, tolerance_s: float) -> float:
    """Return the period with the fewest digits, of it or of the rate, within a tolerance."""
    for digits in range(1, _MOST_DIGITS):
        for candidate_s in (
                1.0 / float(f'{1.0 / period_s:.{digits - 1}e}'),
                float(f'{period_s:.{digits - 1}e}')):
            if abs(candidate_s - period_s) <= tolerance_s:
                return candidate_s
    return period_s


def _resampled(
    name: str, at_s: _Floats, first_s: float, steps: _Floats, place: Callable[[int], str],
    sample_period_s: float | None,
) -> TimeBase:
    """Return a time base that interpolates between the rows."""
    kept = np.concatenate([[True], steps > 0.0])
    if not kept.all():
        raise TableError(
            f'{name}: the time in {place(int(np.argmin(kept)))} is that of the row before; times '
            'must rise to be resampled')
    median_s = float(np.median(steps))
    widest = int(np.argmax(steps))
    if steps[widest] > _LONGEST_GAP * median_s:
        raise TableError(
            f'{name}: from {place(widest)} to {place(widest + 1)} the time goes on by '
            f'{steps[widest]:.6g} s, elsewhere by {median_s:.6g} s: over more than '
            f'{_LONGEST_GAP:g} rows nothing is interpolated; import the parts by themselves '
            '(--from-s, --to-s)')
    period_s = sample_period_s or _roundest(median_s, 1e-3 * median_s)
    samples = math.floor(float(at_s[-1]) / period_s + 1e-9) + 1
    if samples > _MOST_OF_A_ROW * at_s.size:
        raise TableError(
            f'{name}: the sample period of {period_s:g} s makes {samples} samples of {at_s.size} '
            f'rows, allowed are {_MOST_OF_A_ROW} samples of a row')
    if samples < 2:
        raise TableError(
            f'{name} lasts {at_s[-1]:.6g} s, which is less than a sample period of {period_s:g} s')
    note = (
        f'interpolated at every {period_s:g} s between rows of {median_s:g} s in the median; '
        f'amplitudes above {_INTERPOLATED_SHARE / median_s:.3g} Hz may be up to 5 % too small')
    if period_s > 1.5 * median_s:
        note += f', and what is above {0.5 / period_s:.3g} Hz is folded below'
    return TimeBase(period_s, samples, first_s, at_s, note)
