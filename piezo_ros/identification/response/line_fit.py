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
Sines and cosines at known frequencies, fitted to a stretch of a record by least squares.

    y[k] = sum_l (a_l cos(w_l k) + b_l sin(w_l k)) + c + d (k - k_mean)/N + e[k]
    phasor Y_l = a_l - i b_l

Unlike a DFT this needs no whole number of samples per period, and samples may be missing. Constant
and drift are fitted too.

Examples
--------
>>> k = np.arange(1000)
>>> signal = 2.0 + 0.5 * np.cos(2.0 * np.pi * 0.0101 * k)
>>> fit = fit_lines(signal[np.newaxis], 0, np.array([0.0101]), 1.0 / 0.0101)
>>> round(abs(complex(fit.phasor[0, 0])), 6), round(float(fit.mean[0]), 6)
(0.5, 2.0)

"""

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

__all__ = ['LineFit', 'fit_lines']

_MOST_GROUPS = 24  # enough to estimate the scatter; more would only shorten each group
_LEAST_LEFT = 0.7  # share of the samples of a group; with less the whole group is left out
_LEAST_GROUPS = 0.25  # share of the groups


class LineFit(NamedTuple):
    """
    Phasors Y of S signals at L lines: y = Re(Y exp(i w t)), t from the first sample of all.

    The samples are split into M consecutive groups of whole periods; the scatter between them is
    an estimate of the noise.
    """

    phasor: NDArray[np.complex128]  # (S, L)
    deviation: NDArray[np.complex128]  # (M, S, L) of each group from the phasor
    mean: NDArray[np.float64]  # (S,) the constant
    residual_variance: NDArray[np.float64]  # (S,) of the residual, per sample
    unit_variance: NDArray[np.float64]  # (L,) E|Y|^2 for white noise of unit variance
    share: NDArray[np.float64]  # (M,) of the used samples that each group has
    samples_used: int


def fit_lines(
    signals: NDArray[np.float64], first_index: int, turns_per_sample: NDArray[np.float64],
    samples_per_period: float,
) -> LineFit:
    """
    Fit lines to signals.

    Parameters
    ----------
    signals : ndarray, shape (S, N)
        The stretch, the same samples of every signal. Samples at which one of them is not finite
        are left out, and so is a group of periods that lacks more than 30 % of its samples.
    first_index : int
        Index of its first sample in the record; phases refer to index 0.
    turns_per_sample : ndarray, shape (L,)
        Frequencies over the sampling frequency.
    samples_per_period : float
        Length of the common period of all lines, not necessarily whole.

    Returns
    -------
    LineFit
        The phasors and their scatter.

    Raises
    ------
    ValueError
        If the stretch is shorter than one period or has too few samples for the lines, also after
        those that are not finite are left out.

    """
    lines = turns_per_sample.size
    columns = 2 * lines + 2
    # A stretch that misses a whole period by rounding alone counts as whole.
    periods = int(signals.shape[1] / samples_per_period + 1e-6)
    count = min(signals.shape[1], round(periods * samples_per_period))
    if periods < 1 or count <= columns:
        raise ValueError(
            f'{signals.shape[1]} samples are {signals.shape[1] / samples_per_period:.3g} periods '
            f'of {samples_per_period:.4g} samples; {lines} lines need at least one whole period '
            f'and {columns + 1} samples')
    groups = _group_count(periods, count, columns)
    bounds = [round(periods * m / groups * samples_per_period) for m in range(groups)] + [count]
    parts = _finite_parts(signals, bounds, columns)
    whole = np.concatenate(parts)
    mean = signals[:, whole].mean(axis=1, keepdims=True)
    centred = signals - mean  # a large offset would cancel the digits of the sums of squares
    groups = len(parts)
    grams = np.empty((groups, columns, columns))
    sides = np.empty((groups, columns, signals.shape[0]))
    for m, part in enumerate(parts):
        drift = (part - 0.5 * (count - 1)) / count
        design = _design(first_index + part.astype(np.float64), turns_per_sample, drift)
        grams[m] = design.T @ design
        sides[m] = design.T @ centred[:, part].T
    gram, side = grams.sum(axis=0), sides.sum(axis=0)
    factor = cho_factor(gram)
    solution = cho_solve(factor, side)
    squares = np.einsum('sn,sn->s', centred[:, whole], centred[:, whole])
    # For an exact fit the difference is rounding and may be negative.
    left = np.maximum(squares - np.einsum('cs,cs->s', solution, side), 0.0)
    inverse_diagonal = np.diag(cho_solve(factor, np.eye(columns)))
    # The drift is fitted to all samples only: within a group it would inflate the scatter.
    kept = slice(0, columns - 1)
    deviation = np.stack([
        _phasors(np.linalg.solve(
            grams[m][kept, kept], (sides[m] - grams[m] @ solution)[kept]), lines)
        for m in range(groups)])
    return LineFit(
        phasor=_phasors(solution, lines),
        deviation=deviation,
        mean=mean[:, 0] + solution[2 * lines],
        residual_variance=left / (whole.size - columns),
        unit_variance=inverse_diagonal[:lines] + inverse_diagonal[lines:2 * lines],
        share=np.array([part.size / whole.size for part in parts]),
        samples_used=whole.size)


def _finite_parts(
    signals: NDArray[np.float64], bounds: list[int], columns: int,
) -> list[NDArray[np.intp]]:
    """Return the indices of the finite samples of each group that has enough of them."""
    finite: NDArray[np.bool_] = np.asarray(np.isfinite(signals).all(axis=0))
    parts = [
        start + np.flatnonzero(finite[start:stop])
        for start, stop in itertools.pairwise(bounds)]
    usable = [
        part for part, (start, stop) in zip(parts, itertools.pairwise(bounds), strict=True)
        if part.size >= _LEAST_LEFT * (stop - start) and part.size > columns]
    if len(usable) < min(2, len(parts)) or len(usable) < _LEAST_GROUPS * len(parts):
        left = sum(part.size for part in parts)
        raise ValueError(
            f'{bounds[-1] - left} of {bounds[-1]} samples are lost, and what is left does not '
            'contain enough of each period')
    return usable


def _group_count(periods: int, count: int, columns: int) -> int:
    """Return the number of groups: whole periods each, three samples per unknown if possible."""
    most = min(periods, _MOST_GROUPS, count // (3 * columns))
    return max(1, most) if most > 1 else min(periods, 2, count // (columns + 1))


def _design(
    index: NDArray[np.float64], turns_per_sample: NDArray[np.float64],
    drift: NDArray[np.float64],
) -> NDArray[np.float64]:
    turns = np.multiply.outer(index, turns_per_sample)
    angle = 2.0 * np.pi * (turns - np.floor(turns))
    return np.hstack([
        np.cos(angle), np.sin(angle), np.ones((index.size, 1)), drift[:, None]])


def _phasors(solution: NDArray[np.float64], lines: int) -> NDArray[np.complex128]:
    """Return (S, L): a cos + b sin is the real part of (a - ib) exp(i w t)."""
    return np.asarray((solution[:lines] - 1j * solution[lines:2 * lines]).T)
