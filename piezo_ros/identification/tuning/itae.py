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
The objective of the tuning: integral of time times absolute error.

    ITAE = integral of t |e(t)| dt, (9) in Liu 2015

The closed loop x[k+1] = A x[k] + B y_d[k], e[k] = C x[k] + D y_d[k] is linear. Its impulse response
C A^(k-1) B, or step response, follows from powers of A by doubling, without a simulation.

Examples
--------
An integral loop around a lag:

>>> from piezo_ros.identification.tuning.linear_plant import LinearPlant
>>> lag = LinearPlant(np.array([1.0]), np.array([1e-3, 1.0]))
>>> fast, slow = (PiLoop.of(lag, 0.0, gain) for gain in (250.0, 100.0))
>>> itae(fast, None, 1e-5, 10_000) < itae(slow, None, 1e-5, 10_000)
True

"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import trapezoid
from scipy.signal import oaconvolve

from piezo_ros.identification.tuning.pi_loop import PiLoop
from piezo_ros.model.state_space import StateSpace

__all__ = ['impulse_response', 'itae']

_STEP_POINTS = 8192  # over the settling of a step

_Floats = NDArray[np.float64]


def itae(loop: PiLoop, reference_um: _Floats | None, step_s: float, steps: int) -> float:
    """
    Return the integral of t |e| dt of a closed loop from rest, (9) in Liu 2015.

    Parameters
    ----------
    loop : PiLoop
        The loop.
    reference_um : ndarray, shape (N,), or None
        The reference; None for a unit step.
    step_s : float
        Time between the samples, seconds; for a sampled loop its sample period.
    steps : int
        Number of samples.

    Returns
    -------
    float
        The integral by the trapezoidal rule; infinite for an unstable loop.

    """
    if not loop.slowest_decay(step_s) < 1.0:
        return math.inf
    system = loop.error_system(step_s)
    if reference_um is None:
        stride = math.ceil(steps / _STEP_POINTS)
        error = _step_response(system, stride, steps // stride)
    else:
        stride = 1
        error = oaconvolve(impulse_response(system, steps), reference_um)[:steps]
    time_s = step_s * stride * np.arange(error.size)
    return float(trapezoid(time_s * np.abs(error), time_s))


def impulse_response(system: StateSpace, steps: int) -> _Floats:
    """
    Return the output of a discrete system after a unit impulse of its input, shape (steps,).

    Parameters
    ----------
    system : StateSpace
        The system, from rest.
    steps : int
        Number of samples.

    """
    states = _powers(system.a, system.b, steps - 1)
    return np.concatenate([system.d[0], (system.c @ states)[0]])


def _step_response(system: StateSpace, stride: int, points: int) -> _Floats:
    """Return every ``stride``-th output after a unit step of the input, shape (points,)."""
    order = system.a.shape[0]
    driven = np.eye(order + 1)
    driven[:order] = np.hstack([system.a, system.b])
    rest = np.zeros((order + 1, 1))
    rest[order] = 1.0
    states = _powers(np.linalg.matrix_power(driven, stride), rest, points)
    return np.asarray((np.hstack([system.c, system.d]) @ states)[0])


def _powers(matrix: _Floats, vector: _Floats, count: int) -> _Floats:
    """Return vector, matrix vector, matrix^2 vector, … as columns, by doubling."""
    columns = vector
    while columns.shape[1] < count:
        columns = np.hstack([columns, matrix @ columns])
        matrix = matrix @ matrix
    return columns[:, :count]
