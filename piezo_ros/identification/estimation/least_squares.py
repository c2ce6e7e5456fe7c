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
Least squares within bounds for few parameters and any number of samples.

The projected Levenberg-Marquardt method on the normal equations. With residual e, Jacobian J of the
prediction, and scale D = diag(J'J)^(-1/2), a step of the parameters that no bound stops is

    step = D (D J'J D + damping I)^(-1) D J'e,   theta -> clip(theta + step, lower, upper)

Only J'J, J'e and e'e are kept, so that a record of any length needs little memory.

Examples
--------
A straight line through three points, its slope bounded to 1 at most:

>>> import numpy as np
>>> x, y = np.array([0.0, 1.0, 2.0]), np.array([1.0, 3.0, 5.0])
>>> jacobian = np.stack([x, np.ones(3)], axis=1)
>>> def evaluate(theta):
...     error = y - jacobian @ theta
...     return NormalEquations(error @ error, jacobian.T @ error, jacobian.T @ jacobian, 3)
>>> theta, _ = minimise(
...     evaluate, np.zeros(2), np.array([0.0, -np.inf]), np.array([1.0, np.inf]))
>>> theta.round(6)
array([1., 2.])

"""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

__all__ = ['NormalEquations', 'minimise']

# Relative reduction of the sum of squares; two steps in a row below it end the search.
_SMALLEST_REDUCTION: Final = 1e-9
# Steps, and the relative reduction that they must bring together.
_WINDOW, _CRAWL = 30, 1e-5
_LARGEST_DAMPING: Final = 1e10

_Floats = NDArray[np.float64]


class NormalEquations(NamedTuple):
    """
    The sums over all samples that least squares needs, at one set of m parameters.

    Attributes
    ----------
    cost : float
        Sum of the squared residuals (measured less predicted).
    gradient : ndarray, shape (m,)
        Transposed Jacobian of the prediction times the residuals.
    curvature : ndarray, shape (m, m)
        Transposed Jacobian times Jacobian.
    samples : int
        Residuals in the sum.

    """

    cost: float
    gradient: _Floats
    curvature: _Floats
    samples: int


def minimise(
    evaluate: Callable[[_Floats], NormalEquations], start: _Floats, lower: _Floats, upper: _Floats,
    maximum_steps: int = 200,
) -> tuple[_Floats, NormalEquations]:
    """
    Minimise a sum of squares within bounds (projected Levenberg-Marquardt method).

    Parameters
    ----------
    evaluate : callable
        Parameters to normal equations.
    start : ndarray, shape (m,)
        First parameters; clipped to the bounds.
    lower, upper : ndarray, shape (m,)
        Bounds; equal ones keep a parameter fixed.
    maximum_steps : int, optional
        Steps tried at most.

    Returns
    -------
    theta : ndarray, shape (m,)
        The best parameters found, within the bounds.
    normal : NormalEquations
        The normal equations there.

    """
    theta = np.clip(start, lower, upper)
    normal = evaluate(theta)
    damping, small_steps = 1e-3, 0
    costs = [normal.cost]
    for _ in range(maximum_steps):
        # Along a valley of parameters that the data hardly determine no step is small.
        if len(costs) > _WINDOW and costs[-1] > (1.0 - _CRAWL) * costs[-1 - _WINDOW]:
            break
        costs.append(normal.cost)
        trial = np.clip(theta + _step(theta, normal, damping, lower, upper), lower, upper)
        if np.array_equal(trial, theta):
            break
        new = evaluate(trial)
        if new.cost < normal.cost:
            reduction = 1.0 - new.cost / normal.cost
            theta, normal = trial, new
            damping = max(damping / 10.0, 1e-14)
            small_steps = small_steps + 1 if reduction < _SMALLEST_REDUCTION else 0
            if small_steps == 2:
                break
        else:
            damping *= 10.0
            if damping > _LARGEST_DAMPING:
                break
    return theta, normal


def _step(
    theta: _Floats, normal: NormalEquations, damping: float, lower: _Floats, upper: _Floats,
) -> _Floats:
    """Return the damped step of the parameters that are free of their bounds, 0 for the others."""
    at_bound = ((theta <= lower) & (normal.gradient <= 0.0)) | (
        (theta >= upper) & (normal.gradient >= 0.0))
    free = np.flatnonzero(~at_bound & (np.diag(normal.curvature) > 0.0))
    scale = 1.0 / np.sqrt(np.diag(normal.curvature)[free])
    # In units in which every column of the Jacobian has length one.
    curvature = normal.curvature[np.ix_(free, free)] * np.outer(scale, scale)
    curvature[np.diag_indices_from(curvature)] += damping
    step = np.zeros_like(theta)
    gradient = scale * normal.gradient[free]
    try:
        step[free] = scale * cho_solve(cho_factor(curvature), gradient)
    except np.linalg.LinAlgError:  # not positive definite, by rounding
        step[free] = scale * np.linalg.lstsq(curvature, gradient, rcond=None)[0]
    return step
