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
Poles of a rational function by relaxed vector fitting, without a start near them.

Two functions with the same poles a_i are fitted to the points f(s) by linear least squares,

    sum_i c_i/(s - a_i) = sigma(s) f(s),   sigma(s) = d + sum_i e_i/(s - a_i),   sum Re sigma = N

and the zeros of sigma are the next poles (Gustavsen and Semlyen 1999, relaxed by Gustavsen 2006).
Unstable poles are reflected into the left half plane.

Examples
--------
A resonance at 3 rad/s, from poles elsewhere:

>>> s = 1j * np.linspace(0.1, 5.0, 50)
>>> found = vector_fitting(s, 9.0 / (s**2 + 0.06 * s + 9.0), np.ones(50), initial_poles(2, s))
>>> np.sort_complex(found).round(4)
array([-0.03-2.9998j, -0.03+2.9998j])

"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, lstsq

__all__ = ['initial_poles', 'vector_fitting']

_ROUNDS = 10
_SAME_POLES = 1e-4  # relative change of the poles that ends the search
_SMALLEST_CONSTANT = 1e-6  # of sigma, below which its zeros are not defined
_INITIAL_DAMPING = 0.02


def initial_poles(order: int, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """
    Return weakly damped pairs (and one real pole for an odd order) over the measured band.

    Parameters
    ----------
    order : int
        Number of poles.
    s : ndarray of complex, shape (N,)
        The measured points, on the imaginary axis.

    """
    low, high = float(np.abs(s).min()), float(np.abs(s).max())
    pairs = order // 2
    size = np.geomspace(low, high, pairs + 2)[1:-1] if pairs > 1 else np.array([0.5 * high])
    upper = size[:pairs] * (-_INITIAL_DAMPING + 1j)
    real = np.full(order % 2, -0.3 * high, dtype=np.complex128)
    return np.concatenate([real, upper, upper.conj()])


def vector_fitting(
    s: NDArray[np.complex128], response: NDArray[np.complex128], weight: NDArray[np.float64],
    poles: NDArray[np.complex128],
) -> NDArray[np.complex128]:
    """
    Return the stable poles of a strictly proper rational function near the points.

    Parameters
    ----------
    s : ndarray of complex, shape (N,)
        Where the response is known, best of order 1.
    response : ndarray of complex, shape (N,)
        The points.
    weight : ndarray, shape (N,)
        Inverse standard errors.
    poles : ndarray of complex, shape (P,)
        The poles of the start, closed under conjugation.

    Returns
    -------
    ndarray of complex, shape (P,)
        Poles, closed under conjugation.

    """
    for _ in range(_ROUNDS):
        moved = _moved(s, response, weight, poles)
        if moved is None:
            break
        before, poles = np.sort_complex(poles), moved
        if np.max(np.abs(np.sort_complex(moved) - before)) < _SAME_POLES * np.max(np.abs(moved)):
            break
    return poles


def _moved(
    s: NDArray[np.complex128], response: NDArray[np.complex128], weight: NDArray[np.float64],
    poles: NDArray[np.complex128],
) -> NDArray[np.complex128] | None:
    """Return the zeros of sigma, reflected; None where the equations have no finite solution."""
    real, upper = poles[poles.imag == 0.0].real, poles[poles.imag > 0.0]
    terms = np.hstack([
        1.0 / (s[:, None] - real), *(
            np.stack([1.0 / (s - a) + 1.0 / (s - a.conjugate()),
                      1j / (s - a) - 1j / (s - a.conjugate())], axis=1) for a in upper.tolist())])
    count = terms.shape[1]
    rows = weight[:, None] * np.hstack(
        [terms, -response[:, None] * terms, -response[:, None]])
    # The sum of sigma is fixed in place of its constant, with about the weight of all points.
    fixed = np.concatenate([np.zeros(count), terms.real.sum(axis=0), [s.size]])
    share = float(np.linalg.norm(weight * response)) / s.size
    design = np.vstack([rows.real, rows.imag, share * fixed])
    right = np.zeros(design.shape[0])
    right[-1] = share * s.size
    scale = np.linalg.norm(design, axis=0)
    if not (np.all(np.isfinite(scale)) and np.all(scale > 0.0)):
        return None
    solution = lstsq(design / scale, right)[0] / scale
    constant = float(solution[-1])
    if abs(constant) < _SMALLEST_CONSTANT:
        constant = _SMALLEST_CONSTANT if constant >= 0.0 else -_SMALLEST_CONSTANT
    blocks = [np.array([[a]]) for a in real.tolist()] + [
        np.array([[a.real, a.imag], [-a.imag, a.real]]) for a in upper.tolist()]
    inputs = np.concatenate([np.ones(real.size), np.tile([2.0, 0.0], upper.size)])
    zeros = np.linalg.eigvals(
        block_diag(*blocks) - np.outer(inputs, solution[count:-1]) / constant)
    if not np.all(np.isfinite(zeros)):
        return None
    return np.asarray(-np.abs(zeros.real) + 1j * zeros.imag, dtype=np.complex128)
