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
One constrained least-squares step of a periodic voltage.

The step d of the coefficients c over the harmonics B::

    minimise over d   mean of w (e - J d)^2 + lambda |d|^2
    subject to        |u[k+1] - u[k]| <= slew Ts,   low <= u[k] <= high,
                      mean of |u[k+1] - u[k]|/Ts <= average slew,   u = B (c + d)

Of the many limits few are active. They are added as they are violated (cutting planes), until none
is. The average is kept by bounds of the single steps, r[k] >= |u[k+1] - u[k]|, as further unknowns.
"""

import math
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ['AmplifierLimits', 'InfeasibleError', 'constrained_step']

_Floats = NDArray[np.float64]
_ROUNDS: Final = 40
_TOLERANCE: Final = 1e-6  # of a limit, by which a solution may be beyond it before it is scaled
_NEAR: Final = 0.9  # of a limit: what is closer is a cut from the start


class InfeasibleError(ValueError):
    """No voltage keeps the limits."""


@dataclass(frozen=True)
class AmplifierLimits:
    """
    What the voltage must keep, deviations from the operating point.

    Attributes
    ----------
    slew_v_per_s, average_slew_v_per_s : float
        Largest slope and largest mean absolute slope; infinite for none. They are peak and average
        current of the amplifier over the capacitance of the stage.
    minimum_v, maximum_v : float
        Rails, on either side of zero.

    Raises
    ------
    ValueError
        If a limit leaves no room.

    """

    slew_v_per_s: float = math.inf
    average_slew_v_per_s: float = math.inf
    minimum_v: float = -math.inf
    maximum_v: float = math.inf

    def __post_init__(self) -> None:
        for name in ('slew_v_per_s', 'average_slew_v_per_s', 'maximum_v'):
            value = getattr(self, name)
            if not value > 0.0:
                raise ValueError(f'{name} is {value}, it must be above 0')
        if not self.minimum_v < 0.0:
            raise ValueError(f'minimum_v is {self.minimum_v}, it must be below 0')

    def worst(self, voltage_v: _Floats, sample_period_s: float) -> float:
        """Return the largest use of any limit by a periodic voltage; above 1 it is not kept."""
        slope = np.abs(np.roll(voltage_v, -1) - voltage_v) / sample_period_s
        return max(
            float(slope.max()) / self.slew_v_per_s,
            float(slope.mean()) / self.average_slew_v_per_s,
            float(voltage_v.max()) / self.maximum_v,
            float(voltage_v.min()) / self.minimum_v)


class _Average(NamedTuple):
    """The limit of the mean absolute step."""

    rise: _Floats  # (P, M) step of the voltage by coefficient
    bound_v: float


class _Cuts:
    """Linear limits a @ (c + d) <= b that are taken into account."""

    def __init__(self, basis: _Floats, limits: AmplifierLimits, sample_period_s: float) -> None:
        self._basis = basis
        self._rise = np.roll(basis, -1, axis=0) - basis
        self._limits = limits
        self._period_s = sample_period_s
        self._taken: set[tuple[int, int, bool]] = set()
        self.rows: list[_Floats] = []
        self.bounds: list[float] = []
        self.average: _Average | None = None  # once it is violated

    def add(self, coefficients: _Floats, share: float) -> int:
        """Add what uses more than a share of its limit; return how many cuts are new."""
        before = len(self.rows)
        rise_v = self._rise @ coefficients
        voltage_v = self._basis @ coefficients
        limits, period_s = self._limits, self._period_s
        for kind, (values, matrix, low, high) in enumerate((
            (rise_v, self._rise, -limits.slew_v_per_s * period_s,
             limits.slew_v_per_s * period_s),
            (voltage_v, self._basis, limits.minimum_v, limits.maximum_v),
        )):
            for upper, sign, bound in ((True, 1.0, high), (False, -1.0, -low)):
                if math.isinf(bound):
                    continue
                for k in np.flatnonzero(sign * values > share * bound).tolist():
                    if (kind, k, upper) not in self._taken:
                        self._taken.add((kind, k, upper))
                        self.rows.append(sign * matrix[k])
                        self.bounds.append(bound)
        if not self.average and float(np.abs(rise_v).mean()) > (
                max(share, 1.0) * limits.average_slew_v_per_s * period_s):
            self.average = _Average(self._rise, limits.average_slew_v_per_s * period_s)
            return len(self.rows) - before + 1
        return len(self.rows) - before


def constrained_step(
    slope: _Floats, error_um: _Floats, weight: _Floats, regularisation: float,
    basis: _Floats, coefficients: _Floats, limits: AmplifierLimits, sample_period_s: float,
) -> _Floats:
    """
    Return the change of the coefficients that lessens the error most within the limits.

    Parameters
    ----------
    slope : ndarray, shape (P, M)
        Derivative of the displacement by each coefficient.
    error_um : ndarray, shape (P,)
        Reference less displacement.
    weight : ndarray, shape (P,)
        Weight of each sample's squared error.
    regularisation : float
        Weight lambda of the squared change.
    basis : ndarray, shape (P, M)
        Voltage by coefficient.
    coefficients : ndarray, shape (M,)
        The present ones.
    limits : AmplifierLimits
        What the new voltage keeps.
    sample_period_s : float
        Sample period, seconds.

    Returns
    -------
    ndarray, shape (M,)
        The change d.

    Raises
    ------
    InfeasibleError
        If no voltage of this basis keeps the limits.

    """
    weighted = slope * weight[:, None] / error_um.size
    normal = slope.T @ weighted + regularisation * np.eye(slope.shape[1])
    right = weighted.T @ error_um
    cuts = _Cuts(basis, limits, sample_period_s)
    change: _Floats = np.asarray(np.linalg.solve(normal, right), dtype=np.float64)
    if not cuts.add(coefficients + change, 1.0 + _TOLERANCE):
        return change
    cuts.add(coefficients, _NEAR)
    for _ in range(_ROUNDS):
        change = _quadratic_program(normal, right, coefficients, cuts)
        if not cuts.add(coefficients + change, 1.0 + _TOLERANCE):
            return change
    raise InfeasibleError(f'the limits are not kept after {_ROUNDS} rounds of cuts')


def _quadratic_program(
    normal: _Floats, right: _Floats, coefficients: _Floats, cuts: _Cuts,
) -> _Floats:
    """Minimise d' normal d/2 - right d within the cuts, at coefficients + d."""
    try:
        import clarabel
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            'a plan at the limits of the amplifier needs the package clarabel (pip install '
            'clarabel)') from None
    from scipy import sparse
    size = normal.shape[0]
    # In units in which the minimum without limits is round.
    root = np.linalg.cholesky(normal)
    rows = np.array(cuts.rows).reshape(-1, size)
    bounds = np.array(cuts.bounds) - rows @ coefficients
    scaled = np.linalg.solve(root, rows.T).T
    norm = np.maximum(np.linalg.norm(scaled, axis=1), 1e-300)
    matrix: Any = scaled / norm[:, None]
    bounds = bounds / norm
    curvature: Any = np.eye(size)
    linear = -np.linalg.solve(root, right)
    if cuts.average:
        rise, whole_v = cuts.average
        # Steps in units of their average.
        steps = np.linalg.solve(root, rise.T).T / whole_v
        present = rise @ coefficients / whole_v
        one = sparse.eye(present.size)
        blocks: Any = [
            [matrix, None], [steps, -one], [-steps, -one],
            [None, np.full((1, present.size), 1.0 / present.size)]]
        matrix = sparse.bmat(blocks)
        bounds = np.concatenate([bounds, -present, present, [1.0]])
        curvature = sparse.block_diag([curvature, 0.0 * one])
        linear = np.concatenate([linear, np.zeros(present.size)])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    solution = clarabel.DefaultSolver(
        sparse.csc_matrix(curvature), linear, sparse.csc_matrix(matrix), bounds,
        [clarabel.NonnegativeConeT(bounds.size)], settings).solve()
    status = str(solution.status)
    if 'Infeasible' in status:
        raise InfeasibleError('no voltage of this band keeps the limits')
    if not status.startswith(('Solved', 'AlmostSolved')):
        raise InfeasibleError(f'the quadratic program was not solved: {status}')
    return np.asarray(np.linalg.solve(root.T, np.array(solution.x)[:size]))
