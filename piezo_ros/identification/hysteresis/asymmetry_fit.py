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
Loops that are not symmetric: the map S behind the MRC model, from the same records.

With y = offset + S(H(u)), H a superposition of plays and z the inverse of S on a grid of m knots,

    z(y) = y + sum_j b_j hat_j(y) = p_0 u + sum_i p_i P[r_i](u) + offset,   p_i >= 0

is linear in b and p where the thresholds r_i are a fixed grid: one least-squares problem starts
the search. Then H is fitted to z(y), and S to y over H(u), in turns. Last, H is scaled so that S
has the slope 1 about zero, as `piezo_ros.model.hysteresis` writes it.

The starts of H are those of bent loops, from which the turns may not find back. Once S is known
about, z(y) gives starts as good as those of a symmetric stage: with them it is done again.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from piezo_ros.identification.estimation.least_squares import NormalEquations
from piezo_ros.identification.hysteresis.mrc_fit import (
    MrcFit,
    PlayModel,
    fit_mrc,
    number_of_plays,
)
from piezo_ros.identification.hysteresis.mrc_start import Preparation, prepare
from piezo_ros.identification.hysteresis.records import Record, predict

__all__ = ['AsymmetricFit', 'fit_asymmetric', 'refit_asymmetric']

_KNOTS: Final = 17
_GRID: Final = 24  # plays of the start
_START_SAMPLES: Final = 4000
_ROUNDS: Final = 6
_FLATTEST: Final = 0.15  # slope of z or S, relative to the mean one: beyond it nothing is known

_Floats = NDArray[np.float64]


class AsymmetricFit(NamedTuple):
    """
    A superposition of n plays with a map behind it, y = offset + S(H(u)).

    Attributes
    ----------
    theta : ndarray, shape (2n + 3,)
        (p_0 … p_n, r_1 … r_n, delay, offset), see `MrcFit`.
    normal : NormalEquations
        Those of H, in units of H, at a known S.
    threshold_um, weight : ndarray, shape (m,)
        The map S, see `piezo_ros.model.hysteresis`; empty for none.
    inverse : tuple of ndarray, shape (k,)
        Displacements, and the inverse of S there less the offset; empty for none.

    """

    theta: _Floats
    normal: NormalEquations
    threshold_um: _Floats
    weight: _Floats
    inverse: tuple[_Floats, _Floats]

    @classmethod
    def symmetric(cls, fit: MrcFit) -> 'AsymmetricFit':
        """Return a fit without a map."""
        nothing = np.empty(0)
        return cls(fit.theta, fit.normal, nothing, nothing, (nothing, nothing))

    def predict(self, records: Sequence[Record]) -> list[_Floats]:
        """Return the displacement of every record, with delay and offset."""
        offset_um = self.theta[-1]
        return [
            offset_um + _mapped(self.threshold_um, self.weight, predicted - offset_um)
            for predicted in predict(
                PlayModel(number_of_plays(self.theta)), records, self.theta)]


def fit_asymmetric(
    records: Sequence[Record], start: AsymmetricFit, delay_bounds: tuple[float, float],
    rounds: int = _ROUNDS,
) -> AsymmetricFit | None:
    """
    Fit plays and the map behind them.

    Parameters
    ----------
    records : sequence of Record
        The data.
    start : AsymmetricFit
        A symmetric fit, or one with a map.
    delay_bounds : tuple of float
        Bounds of the delay, samples.
    rounds : int, optional
        How often plays and map are fitted in turns.

    Returns
    -------
    AsymmetricFit or None
        None where the data want no map that rises strictly.

    """
    inverse = start.inverse if start.weight.size else _start_of_map(records, start.theta)
    if inverse is None:
        return None
    knots_um, images_um = inverse
    theta = start.theta
    for _ in range(rounds):
        linear = _linear(records, knots_um, images_um)
        theta, normal = fit_mrc(linear, theta, delay_bounds)
        bare = theta.copy()
        bare[-1] = 0.0
        symmetric = np.concatenate(predict(PlayModel(number_of_plays(theta)), records, bare))
        found = _map_over(records, symmetric, images_um - theta[-1])
        if found is None:
            return None
        ends, values = found
        knots_um, images_um = values, ends
    return _normalised(theta, normal, ends, values)


def refit_asymmetric(
    records: Sequence[Record], fit: AsymmetricFit,
) -> tuple[Preparation, AsymmetricFit] | None:
    """
    Fit plays and map again, from the starts that the map of a fit gives for the plays.

    Parameters
    ----------
    records : sequence of Record
        The data, with all samples after the turns.
    fit : AsymmetricFit
        A fit with a map.

    Returns
    -------
    tuple of (Preparation, AsymmetricFit) or None
        The records without what has not settled after turns and the bounds of the delay, both by
        the loops without the map, and the fit; None where the data want no map that rises strictly.

    """
    elements = number_of_plays(fit.theta)
    found = prepare(_linear(records, *fit.inverse), [elements], virgin=records[0].virgin)
    preparation = found._replace(records=[
        replace(record, displacement_um=measured.displacement_um)
        for record, measured in zip(found.records, records, strict=True)])
    again = fit_asymmetric(
        preparation.records, fit._replace(theta=found.starts[elements]), found.delay_bounds)
    return None if again is None else (preparation, again)


def _linear(
    records: Sequence[Record], knots_um: _Floats, images_um: _Floats,
) -> list[Record]:
    """Return the records with the displacement that no map has bent."""
    return [
        replace(record, displacement_um=_interpolated(record.displacement_um, knots_um, images_um))
        for record in records]


def _start_of_map(
    records: Sequence[Record], theta: _Floats,
) -> tuple[_Floats, _Floats] | None:
    """Return knots of the displacement and z there, from plays with thresholds on a grid."""
    reach_v = max(record.reach_v for record in records)
    grid_v = reach_v * np.linspace(0.0, 0.95, _GRID + 1)[1:] ** 1.5
    columns, wanted, weights = [], [], []
    stride = -(-sum(record.voltage_v.size for record in records) // _START_SAMPLES)
    for record in records:
        chosen = np.flatnonzero(record.weight > 0.0)[::stride]
        each = []
        for threshold in (0.0, *grid_v):
            of_one = np.array([0.0, 1.0, threshold, theta[-2], 0.0])
            each.append(PlayModel(1).predict(record, of_one)[chosen])
        columns.append(np.stack(each, axis=1))
        wanted.append(record.displacement_um[chosen])
        weights.append(record.weight[chosen])
    y, w = np.concatenate(wanted), np.sqrt(np.concatenate(weights))
    knots_um = np.linspace(y.min(), y.max(), _KNOTS)
    hats = np.stack([
        np.interp(y, knots_um, unit) for unit in np.eye(_KNOTS)[1:-1]], axis=1)
    matrix = np.hstack([np.concatenate(columns), np.ones((y.size, 1)), -hats])
    plays = _GRID + 1
    lower = np.r_[np.zeros(plays), np.full(matrix.shape[1] - plays, -np.inf)]
    orthogonal, triangular = np.linalg.qr(matrix * w[:, np.newaxis])
    solution = lsq_linear(triangular, orthogonal.T @ (w * y), (lower, np.inf)).x
    images_um = knots_um + np.r_[0.0, solution[plays + 1:], 0.0]
    return (knots_um, images_um) if _rises(knots_um, images_um) else None


def _map_over(
    records: Sequence[Record], symmetric_um: _Floats, knots_um: _Floats,
) -> tuple[_Floats, _Floats] | None:
    """Return knots of H(u) and the displacement there, by least squares."""
    y = np.concatenate([record.displacement_um for record in records])
    w = np.concatenate([record.weight for record in records])
    used = w > 0.0
    x, y, w = symmetric_um[used], y[used], np.sqrt(w[used])
    ends = knots_um.copy()
    ends[0], ends[-1] = min(ends[0], float(x.min())), max(ends[-1], float(x.max()))
    segment = np.clip(np.searchsorted(ends, x, side='right') - 1, 0, ends.size - 2)
    share = (x - ends[segment]) / (ends[segment + 1] - ends[segment])
    # The hats overlap with their neighbours only: the normal equations have three diagonals.
    normal, right = np.zeros((ends.size, ends.size)), np.zeros(ends.size)
    for one, of_one in ((0, 1.0 - share), (1, share)):
        np.add.at(right, segment + one, w * w * of_one * y)
        for two, of_two in ((0, 1.0 - share), (1, share)):
            np.add.at(normal, (segment + one, segment + two), w * w * of_one * of_two)
    values: _Floats = np.asarray(
        np.linalg.lstsq(normal, right, rcond=1e-12)[0], dtype=np.float64)
    return (ends, values) if _rises(ends, values) else None


def _rises(knots: _Floats, values: _Floats) -> bool:
    slope = np.diff(values) / np.diff(knots)
    mean = (values[-1] - values[0]) / (knots[-1] - knots[0])
    return bool(np.all(slope > _FLATTEST * mean))


def _interpolated(x: _Floats, knots: _Floats, values: _Floats) -> _Floats:
    """Interpolate, and go on in the slope of the outermost pieces."""
    slope = np.diff(values) / np.diff(knots)
    segment = np.clip(np.searchsorted(knots, x, side='right') - 1, 0, slope.size - 1)
    return np.asarray(values[segment] + slope[segment] * (x - knots[segment]))


def _normalised(
    theta: _Floats, normal: NormalEquations, ends: _Floats, values: _Floats,
) -> AsymmetricFit:
    """Scale H so that S has the slope 1 about zero, and the offset so that S(0) = 0."""
    slope = np.diff(values) / np.diff(ends)
    centre = int(np.clip(np.searchsorted(ends, 0.0, side='left') - 1, 0, slope.size - 1))
    scale = float(slope[centre])
    plays = number_of_plays(theta)
    scaled = theta.copy()
    scaled[:plays + 1] *= scale
    scaled[-1] = _interpolated(np.zeros(1), ends, values)[0]
    inner, change = ends[1:-1] * scale, np.diff(slope) / scale
    factor = np.ones(theta.size)
    factor[:plays + 1] = scale
    factor[-1] = scale
    # The derivative by a parameter of H in micrometres of its own, behind the scale of both.
    ratio = scale / factor
    return AsymmetricFit(
        scaled,
        NormalEquations(
            normal.cost * scale**2, normal.gradient * scale * ratio,
            normal.curvature * np.outer(ratio, ratio), normal.samples),
        inner, np.where(inner < 0.0, -change, change), (values, ends * scale))


def _mapped(threshold_um: _Floats, weight: _Floats, displacement_um: _Floats) -> _Floats:
    """Return S over an array, see `piezo_ros.model.hysteresis`."""
    mapped = displacement_um.copy()
    for threshold, change in zip(threshold_um, weight, strict=True):
        beyond = displacement_um - threshold
        mapped += change * (np.minimum(beyond, 0.0) if threshold < 0.0 else np.maximum(beyond, 0.0))
    return mapped
