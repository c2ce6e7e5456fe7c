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
The response of a closed loop over time, to a step and to a scan.

    e = h * y_d,   y = y_d - e

with the impulse response h of the system y_d[k] -> e[k] of `PiLoop.error_system`.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import oaconvolve

from piezo_ros.identification.tuning.itae import impulse_response
from piezo_ros.identification.tuning.pi_loop import PiLoop

__all__ = ['LoopResponse', 'loop_response', 'settling_samples']

_SETTLED: Final = 1e-3  # of the slowest mode
_FEWEST: Final = 50
_MOST: Final = 2**16

_Floats = NDArray[np.float64]


class LoopResponse(NamedTuple):
    """
    Response of a closed loop from rest.

    Attributes
    ----------
    time_s, reference_um, displacement_um : ndarray, shape (N,)
        Time, reference, and the displacement of the linear model.

    """

    time_s: _Floats
    reference_um: _Floats
    displacement_um: _Floats


def settling_samples(loop: PiLoop, step_s: float) -> int:
    """
    Return after how many samples the slowest mode has decayed to a thousandth.

    Parameters
    ----------
    loop : PiLoop
        A stable loop.
    step_s : float
        Time between the samples, seconds.

    """
    decay = loop.slowest_decay(step_s)
    if not decay < 1.0:
        return _MOST
    samples = math.log(_SETTLED) / math.log(decay) if decay > 0.0 else 1.0
    return int(min(max(samples, _FEWEST), _MOST))


def loop_response(loop: PiLoop, reference_um: ArrayLike, step_s: float) -> LoopResponse:
    """
    Return the response of the linear loop to a reference.

    Parameters
    ----------
    loop : PiLoop
        The loop.
    reference_um : array_like, shape (N,)
        The reference, micrometres.
    step_s : float
        Time between the samples, seconds; for a sampled loop its sample period.

    Raises
    ------
    ValueError
        If the loop is not stable.

    Examples
    --------
    An integral loop around a lag settles on a step:

    >>> from piezo_ros.identification.tuning.linear_plant import LinearPlant
    >>> lag = LinearPlant(np.array([1.0]), np.array([1e-4, 1.0]))
    >>> response = loop_response(PiLoop.of(lag, 0.0, 1e3, 1e-5), np.ones(1000), 1e-5)
    >>> bool(abs(response.displacement_um[-1] - 1.0) < 1e-3)
    True

    """
    if not loop.slowest_decay(step_s) < 1.0:
        raise ValueError('the loop is not stable, its response has no end')
    reference = np.asarray(reference_um, dtype=np.float64)
    impulse = impulse_response(loop.error_system(step_s), reference.size)
    error = oaconvolve(impulse, reference)[:reference.size]
    time_s = np.asarray(step_s * np.arange(reference.size), dtype=np.float64)
    return LoopResponse(time_s, reference, reference - error)
