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
Covariance of an estimate and the region that contains a complex number, by singular values.

With the Jacobian J of the weighted residuals and the norms D of its columns,

    J D^-1 = U S V^T,   covariance = F F^T,   F = D^-1 V S^-1

which keeps all digits where J^T J loses half of them. Directions V with a vanishing singular value
are not determined by the data: they are returned apart, and their standard errors are infinite.
For a complex number of covariance C with eigenvalues a >= b (real and imaginary part), the radius r
of a 95 % circle satisfies P(a x^2 + b y^2 <= r^2) = 0.95, x and y being standard normal:

    P(r) = 1 - mean over t of exp(-r^2/(2 (a cos^2 t + b sin^2 t)))

Examples
--------
A real number in all but name, and one that is equally uncertain in both directions:

>>> covariance = np.array([np.diag([1.0, 0.0]), np.diag([1.0, 1.0])])
>>> radius_95(covariance).round(2)
array([1.96, 2.45])

"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

__all__ = ['Covariance', 'radius_95']

_LEAST = 1e-10  # singular value over the largest one: below it, the Jacobian is rounding
_PART = 1e-4  # of an undetermined direction in a number: below it, the number is determined
_RATIOS = 33


class Covariance(NamedTuple):
    """
    Covariance of P parameters.

    Attributes
    ----------
    factor : ndarray, shape (P, R)
        F with covariance F F^T, of the directions that the data determine.
    undetermined : ndarray, shape (P, P - R)
        Directions that they do not determine, in units of the parameters.
    scale : ndarray, shape (P,)
        Changes of the parameters that have effects of equal size.

    """

    factor: NDArray[np.float64]
    undetermined: NDArray[np.float64]
    scale: NDArray[np.float64]

    @classmethod
    def of(cls, jacobian: NDArray[np.float64], variance: float = 1.0) -> 'Covariance':
        """
        Return the covariance of a least squares estimate.

        Parameters
        ----------
        jacobian : ndarray, shape (N, P)
            Of the residuals, each over its standard error.
        variance : float, optional
            Of a weighted residual.

        """
        norms = np.linalg.norm(jacobian, axis=0)
        largest = float(norms.max(initial=0.0))
        scale = 1.0 / np.where(norms > 0.0, norms, largest or 1.0)
        _, singular, rows = np.linalg.svd(jacobian * scale, full_matrices=False)
        known = singular > _LEAST * singular.max(initial=0.0)
        directions = scale[:, None] * rows.T
        return cls(
            np.sqrt(variance) * directions[:, known] / singular[known], directions[:, ~known],
            scale)

    @classmethod
    def of_sample(cls, estimates: NDArray[np.float64]) -> 'Covariance':
        """
        Return the covariance of repeated estimates.

        Parameters
        ----------
        estimates : ndarray, shape (N, P)
            At least two.

        """
        factor = (estimates - estimates.mean(axis=0)).T / np.sqrt(estimates.shape[0] - 1)
        return cls(
            factor, np.empty((factor.shape[0], 0)), np.linalg.norm(factor, axis=1))

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The covariance of the determined directions, shape (P, P)."""
        return np.asarray(self.factor @ self.factor.T)

    def standard_errors(self, transform: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Return standard errors of functions of the parameters, infinite if undetermined.

        Parameters
        ----------
        transform : ndarray, shape (V, P)
            Derivatives of the functions by the parameters.

        """
        errors = np.linalg.norm(transform @ self.factor, axis=1)
        open_part = np.linalg.norm(transform @ self.undetermined, axis=1)
        size = np.linalg.norm(transform * self.scale, axis=1)
        return np.asarray(np.where(open_part > _PART * size, np.inf, errors))


def radius_95(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return the radius of the circle that contains a complex number in 95 % of cases.

    Parameters
    ----------
    covariance : ndarray, shape (N, 2, 2)
        Of real and imaginary part.

    Returns
    -------
    ndarray, shape (N,)
        The radii.

    """
    small, large = np.moveaxis(np.linalg.eigvalsh(covariance), -1, 0)
    large = np.maximum(large, 0.0)
    ratio = np.clip(small / np.where(large > 0.0, large, 1.0), 0.0, 1.0)
    return np.asarray(np.sqrt(large) * np.interp(np.sqrt(ratio), _GRID, _RADII))


def _radius_of(ratio: float) -> float:
    """Return the radius for the eigenvalues 1 and `ratio`."""
    turn = (np.arange(400) + 0.5) * (0.5 * np.pi / 400)
    spread = np.cos(turn)**2 + ratio * np.sin(turn)**2

    def excess(radius: float) -> float:
        return float(np.mean(np.exp(-0.5 * radius**2 / spread))) - 0.05

    return float(brentq(excess, 1.0, 4.0))


_GRID = np.linspace(0.0, 1.0, _RATIOS)  # square roots of the ratio of the eigenvalues
_RADII = np.array([_radius_of(float(root)**2) for root in _GRID])
