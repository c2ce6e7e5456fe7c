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
Whether learning by a model is certain to lessen the error on the true stage.

A learning run replaces the coefficients c by c + H^-1 J' W e/N with the slope J of the model and
H = J' W J/N + lambda I. On a stage with the slope J_true the distance to the best voltage shrinks
by

    gamma(J_true) = || I - H^{-1/2} J' W J_true H^{-1/2}/N ||

also under the limits, which are a projection in the norm of H. J_true differs from J by the errors
of the linear dynamics, J_true = J (I + D), and by which elements slip when. The bound is

    gamma = max over J_n of gamma(J_n) + max |D|,   gamma(J) = lambda/(sigma^2 + lambda)

over the model's slopes J_n at voltages about the plan, at which other elements slip: the plays are
homogeneous, so that 5 % of the voltage are 5 % of the saturations. sigma is the smallest singular
value of the weighted slope. gamma < 1 accepts a plan; it is no rate, and no proof either: a stage
may slip as it does at none of these voltages.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

__all__ = ['Certificate', 'certificate', 'contraction']


class Certificate(NamedTuple):
    """
    The bound of the contraction of a learning run.

    Attributes
    ----------
    gamma : float
        The bound; below 1 learning is certain to approach the best voltage.
    regularisation_share : float
        What of it is due to the regularisation.
    slip_share : float
        What of it is due to elements that may slip at other times than in the model.
    uncertainty : float
        What of it is due to the uncertainty of the linear dynamics.

    """

    gamma: float
    regularisation_share: float
    slip_share: float
    uncertainty: float

    @property
    def holds(self) -> bool:
        """Whether learning is certain to approach the best voltage."""
        return self.gamma < 1.0


def certificate(
    slope: NDArray[np.float64], weight: NDArray[np.float64], regularisation: float,
    uncertainty: float, neighbours: Sequence[NDArray[np.float64]] = (),
) -> Certificate:
    """
    Return the bound for a relative uncertainty of the slope.

    Parameters
    ----------
    slope : ndarray, shape (P, M)
        Derivative of the displacement by each coefficient, of the model.
    weight : ndarray, shape (P,)
        Weight of each sample's squared error.
    regularisation : float
        Weight lambda of the squared change of the coefficients.
    uncertainty : float
        Largest relative error of the slope.
    neighbours : sequence of ndarray of shape (P, M), optional
        Slopes of the model at other voltages, at which other elements slip.

    """
    share, *others = _contractions(slope, [slope, *neighbours], weight, regularisation)
    worst = max(share, *others) if others else share
    return Certificate(worst + uncertainty, share, worst - share, uncertainty)


def contraction(
    slope: NDArray[np.float64], true_slope: NDArray[np.float64], weight: NDArray[np.float64],
    regularisation: float,
) -> float:
    """
    Return gamma for a known true slope, shape (P, M) as `slope`.

    Parameters
    ----------
    slope, weight, regularisation
        As for `certificate`.
    true_slope : ndarray, shape (P, M)
        Derivative of the displacement of the true stage.

    """
    return _contractions(slope, [true_slope], weight, regularisation)[0]


def _contractions(
    slope: NDArray[np.float64], others: Sequence[NDArray[np.float64]],
    weight: NDArray[np.float64], regularisation: float,
) -> list[float]:
    """Return gamma for each of some slopes."""
    weighted = (weight / weight.size)[:, None] * slope
    eye = np.eye(slope.shape[1])
    root = np.linalg.cholesky(slope.T @ weighted + regularisation * eye)
    left = solve_triangular(root, weighted.T, lower=True)
    return [
        float(np.linalg.norm(
            eye - solve_triangular(root, (left @ other).T, lower=True).T, 2))
        for other in others]
