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
Starting values of the MRC fit, for any number of elements, and the delay of the displacement.

On the virgin curve a superposition of plays is piecewise linear and convex, step (a) in Liu 2015:

    x(u) = p_0 u + sum_i p_i max(u - r_i, 0)

Its bends give more plays than wanted. They are fitted to all branches and removed one by one. By
the second-order expansion of the cost J the removal of play i, with all other parameters adapted,
adds

    dJ_i = p_i^2 / (H^-1)_ii,   H = transposed Jacobian times Jacobian

and the play of the smallest dJ_i goes first.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from piezo_ros.identification.estimation.least_squares import NormalEquations
from piezo_ros.identification.hysteresis.mrc_fit import fit_plays, number_of_plays
from piezo_ros.identification.hysteresis.records import Record, reversals_of

__all__ = ['Preparation', 'plays_of_rising_curve', 'prepare', 'rising_curve', 'thinned']

_GRID: Final = 200
# A virgin curve that ends below this share of the largest voltage says nothing of the wide plays.
_LARGE_CURVE: Final = 0.8
# The search starts from more plays than wanted and removes the weakest one by one.
_RICH_PLAYS: Final = 20
_EXTRA_PLAYS: Final = 8
_THINNED_SAMPLES: Final = 10_000
_RICH_STEPS: Final = 40
_STEPS_PER_PLAY: Final = 15
_DELAY_MARGIN: Final = 5.0  # standard errors
_LEAST_MARGIN_SAMPLES: Final = 0.01
# The last plays to be removed are hardly weaker than those that stay: all samples decide there.
_CONTESTED_PLAYS: Final = 2
_FEW_PLAYS: Final = 6
_REGULARISATION: Final = 1e-12  # relative, for the inverse where a play never moves
_LARGEST_DELAY_SAMPLES: Final = 1000.0
# A smaller delay is rounding, or too small to show at the turns.
_NEGLIGIBLE_DELAY_SAMPLES: Final = 0.05
# Delays (of which the slowest time constant is a part) until a turn has settled.
_SETTLING_DELAYS: Final = 8.0

_Floats = NDArray[np.float64]


class Preparation(NamedTuple):
    """
    Starting values and bounds of every fit to the same data.

    Attributes
    ----------
    records : list of Record
        The data without the samples after each turn of the voltage in which a lag has not settled.
    starts : dict of int to ndarray, shape (2n + 3,)
        Number n of elements to starting values of theta.
    delay_bounds : tuple of float
        Bounds of the delay, samples. Without them a fit of too few elements would describe the
        width of the loop by an absurd delay.

    """

    records: list[Record]
    starts: dict[int, _Floats]
    delay_bounds: tuple[float, float]


def prepare(
    records: Sequence[Record], wanted: Collection[int], *, virgin: bool = True,
) -> Preparation:
    """
    Find starting values for several numbers of elements, and the delay.

    The rising curve gives more plays than wanted. They are fitted to all branches and removed one
    by one, the weakest first, so that the remaining ones end near the optimum.

    Parameters
    ----------
    records : sequence of Record
        The data.
    wanted : collection of int
        Numbers n of elements.
    virgin : bool, optional
        Whether the first record starts with the virgin curve.

    Returns
    -------
    Preparation
        For `fit_mrc`.

    """
    curve = rising_curve(records[0], virgin=virgin)
    theta = plays_of_rising_curve(*curve, max(_RICH_PLAYS, max(wanted) + _EXTRA_PLAYS))
    anywhere = (-_LARGEST_DELAY_SAMPLES, _LARGEST_DELAY_SAMPLES)
    theta, normal = fit_plays(thinned(records), theta, anywhere, _RICH_STEPS)
    delay_bounds = _delay_bounds(theta, normal)
    settled = _without_turns(records, float(theta[-2]))
    few = thinned(settled)
    starts = {}
    while True:
        plays = number_of_plays(theta)
        if plays in wanted:
            starts[plays] = theta if plays > _FEW_PLAYS else _better_start(
                few, theta, plays_of_rising_curve(*curve, plays), delay_bounds)
        if plays <= min(wanted):
            return Preparation(settled, starts, delay_bounds)
        deciding = settled if plays <= min(wanted) + _CONTESTED_PLAYS + 1 else few
        theta, normal = fit_plays(
            deciding, _without_weakest(theta, normal), delay_bounds, _STEPS_PER_PLAY)


def _delay_bounds(theta: _Floats, normal: NormalEquations) -> tuple[float, float]:
    error = float(np.sqrt(_inverse(normal.curvature)[-2, -2] * normal.cost / normal.samples))
    margin = max(_DELAY_MARGIN * error, _LEAST_MARGIN_SAMPLES)
    return float(theta[-2]) - margin, float(theta[-2]) + margin


def _better_start(
    records: Sequence[Record], left_over: _Floats, of_curve: _Floats,
    delay_bounds: tuple[float, float],
) -> _Floats:
    """Return the better of two fits: the few plays left over need not be the best few."""
    fits = [fit_plays(records, start, delay_bounds, _RICH_STEPS) for start in (left_over, of_curve)]
    return min(fits, key=lambda fit: fit[1].cost)[0]


def _inverse(curvature: _Floats) -> _Floats:
    """Return the inverse, regularised where a play never moves and its row is zero."""
    length = np.sqrt(np.diag(curvature))
    length = np.where(length > 0.0, length, 1.0)
    scaled = curvature / np.outer(length, length)
    return np.asarray(
        np.linalg.inv(scaled + _REGULARISATION * np.eye(length.size)) / np.outer(length, length))


def thinned(records: Sequence[Record]) -> list[Record]:
    """Return records with weight on some thousands of samples; every voltage is kept."""
    total = sum(record.voltage_v.size for record in records)
    stride = -(-total // _THINNED_SAMPLES)
    few = []
    for record in records:
        weight = np.zeros_like(record.weight)
        weight[::stride] = record.weight[::stride]
        few.append(replace(record, weight=weight))
    return few


def _without_weakest(theta: _Floats, normal: NormalEquations) -> _Floats:
    """Return theta without the play of least effect on the cost, see the module."""
    plays = number_of_plays(theta)
    weights = slice(1, plays + 1)
    loss = theta[weights] ** 2 / np.diag(_inverse(normal.curvature))[weights]
    weakest = 1 + int(np.argmin(loss))
    return np.delete(theta, [weakest, weakest + plays])


def rising_curve(record: Record, *, virgin: bool = True) -> tuple[_Floats, _Floats]:
    """
    Return the virgin curve of a record, rising from (0, 0).

    Parameters
    ----------
    record : Record
        The data.
    virgin : bool, optional
        Whether it starts with that curve. If not, or if it ends far below the largest voltage, the
        branch that starts there is used: it is the virgin curve at twice the scale.

    Returns
    -------
    voltage_v, displacement_um : ndarray, shape (K,)
        The curve.

    Raises
    ------
    ValueError
        If the displacement does not rise on it with the voltage.

    """
    voltage, reversals = record.voltage_v, reversals_of(record.voltage_v)
    first = voltage[:reversals[0] + 1] if reversals.size else voltage
    largest = int(np.argmax(np.abs(voltage)))
    if virgin and np.any(reversals > largest) and (
            np.max(np.abs(first)) < _LARGE_CURVE * abs(voltage[largest])):
        virgin = False  # the curve of a loop that is much smaller than others
    begin = 0 if virgin else int(np.argmax(np.abs(voltage)))
    later = reversals[reversals > begin]
    end = int(later[0]) if later.size else voltage.size - 1
    part = slice(begin, end + 1)
    used = record.weight[part] > 0.0
    u = voltage[part][used]
    x = record.displacement_um[part][used]
    if u.size < 2 or np.ptp(u) == 0.0:
        raise ValueError(
            f'voltage_v[{begin}:{end + 1}] holds no curve that starts the identification')
    scale = (1.0 if virgin else 0.5) * np.sign(voltage[end] - voltage[begin])
    # A virgin stage starts from zero volts, whatever the first sample is.
    u = scale * (u - (0.0 if virgin else voltage[begin]))
    x = scale * (x - x[0])
    if np.polyfit(u, x, 1)[0] <= 0.0:
        raise ValueError(
            'displacement_um does not rise with voltage_v: check the sign, and that both streams '
            'belong to the same run')
    return u, x


def plays_of_rising_curve(
    voltage_v: _Floats, displacement_um: _Floats, elements: int,
) -> _Floats:
    """
    Fit n + 1 linear pieces to the rising curve: starting values, step (a) in Liu 2015.

    Non-negative least squares on a fine grid of thresholds finds the bends. Neighbours are then
    merged, those with the least effect on the curve first, until n are left.

    Parameters
    ----------
    voltage_v, displacement_um : ndarray, shape (K,)
        The rising curve.
    elements : int
        Number n of bends.

    Returns
    -------
    ndarray, shape (2n + 3,)
        Starting values of theta.

    """
    reach_v = float(voltage_v.max())
    grid = np.arange(_GRID) * (reach_v / _GRID)
    pieces = np.maximum(voltage_v[:, np.newaxis] - grid, 0.0)
    ones = np.ones((voltage_v.size, 1))
    columns = np.hstack((pieces, ones, -ones, displacement_um[:, np.newaxis]))
    # The triangle alone, with the displacement as its last column: half the time.
    triangular = np.asarray(np.linalg.qr(columns, mode='r'), dtype=np.float64)
    weights = nnls(triangular[:, :-1], triangular[:, -1])[0]
    mean_compliance = float(np.sum(weights[:_GRID] * (reach_v - grid)) / reach_v)
    bends = [
        (float(threshold), float(weight))
        for threshold, weight in zip(grid[1:], weights[1:_GRID], strict=True) if weight > 0.0]
    while len(bends) > elements:
        bends = _merged(bends)
    while len(bends) < elements:
        bends = _split(bends, reach_v, 0.01 * mean_compliance)
    small_signal = max(float(weights[0]), 0.1 * mean_compliance)
    return np.array([
        small_signal, *(weight for _, weight in bends), *(threshold for threshold, _ in bends),
        0.0, weights[_GRID] - weights[_GRID + 1]])


def _merged(bends: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Replace two neighbouring bends by one at their centre, where it changes the curve least."""
    table = np.array(bends)
    threshold, weight = table[:, 0], table[:, 1]
    gap = np.diff(threshold)
    both = weight[1:] + weight[:-1]
    height = weight[1:] * weight[:-1] / both * gap
    i = int(np.argmin(height**2 * gap))
    centre = float(threshold[i] + gap[i] * weight[i + 1] / both[i])
    return [*bends[:i], (centre, float(both[i])), *bends[i + 2:]]


def _split(
    bends: list[tuple[float, float]], reach_v: float, weight: float,
) -> list[tuple[float, float]]:
    """Add a small bend in the middle of the widest gap."""
    edges = [0.0, *(threshold for threshold, _ in bends), reach_v]
    i = int(np.argmax(np.diff(edges)))
    return [*bends[:i], (0.5 * (edges[i] + edges[i + 1]), weight), *bends[i:]]


def _without_turns(records: Sequence[Record], delay_samples: float) -> list[Record]:
    """
    Return the records without the samples after each turn in which a lag has not settled.

    Along a branch a first-order lag acts as a delay, which is fitted; at a turn the two differ.
    """
    if abs(delay_samples) < _NEGLIGIBLE_DELAY_SAMPLES:
        return list(records)
    settling = int(np.ceil(_SETTLING_DELAYS * (abs(delay_samples) + 1.0)))
    kept = []
    for record in records:
        weight = record.weight.copy()
        for turn in (0, *reversals_of(record.voltage_v)):
            begin, end = np.searchsorted(
                record.index, record.index[turn] + np.array([-1.0, settling]))
            weight[begin:end] = 0.0
        if weight.sum() < 0.5 * record.weight.sum():
            return list(records)  # too many turns: too few samples would be left to fit
        kept.append(replace(record, weight=weight))
    return kept
