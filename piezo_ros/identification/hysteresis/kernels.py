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
Compiled kernels of the Bouc-Wen model and of the turns of a voltage.

Bouc-Wen model, implicit where h decays, so that no step, however coarse, makes h grow:

    q_k = beta |du_k| + gamma du_k sign(h_{k-1})
    h_k = (h_{k-1} + a du_k)/(1 + q_k) if q_k > 0 else (h_{k-1} + a du_k)(1 - q_k)
    x_k = d u_k - h_k + offset
"""

import numpy as np
from numpy.typing import NDArray

from piezo_ros.model.compiled import kernel

__all__ = ['bouc_wen_chunk', 'find_reversals']

_Floats = NDArray[np.float64]


@kernel
def bouc_wen_chunk(
    state: _Floats, theta: _Floats, voltage_v: _Floats, weight: _Floats, prediction_um: _Floats,
    jacobian: _Floats,
) -> int:
    """
    Predict some samples of the Bouc-Wen model and differentiate by every parameter.

    ``theta`` is (d, a, beta, gamma, offset), ``state`` is (u, h, dh/da, dh/dbeta, dh/dgamma).
    Samples without weight get no row of the Jacobian; the number of rows is returned.
    """
    row = 0
    gain, a, beta, gamma, offset = theta[0], theta[1], theta[2], theta[3], theta[4]
    for k in range(voltage_v.size):
        voltage = voltage_v[k]
        change = voltage - state[0]
        size = abs(change)
        before = state[1]
        sign = 1.0 if before >= 0.0 else -1.0
        rate = beta * size + gamma * change * sign
        keep = 1.0 / (1.0 + rate) if rate > 0.0 else 1.0 - rate
        grown = before + a * change
        by_rate = -keep * keep * grown if rate > 0.0 else -grown
        state[2] = keep * (state[2] + change)
        state[3] = keep * state[3] + by_rate * size
        state[4] = keep * state[4] + by_rate * change * sign
        state[1] = keep * grown
        state[0] = voltage
        prediction_um[k] = gain * voltage - state[1] + offset
        if weight[k] > 0.0:
            jacobian[row, 0] = voltage
            jacobian[row, 1] = -state[2]
            jacobian[row, 2] = -state[3]
            jacobian[row, 3] = -state[4]
            jacobian[row, 4] = 1.0
            row += 1
    return row


@kernel
def find_reversals(voltage_v: _Floats, band_v: float, reversals: NDArray[np.int64]) -> int:
    """Fill ``reversals`` with the indices of turns by more than a band; return their number."""
    count = 0
    highest = 0
    lowest = 0
    direction = 0
    for k in range(voltage_v.size):
        if voltage_v[k] > voltage_v[highest]:
            highest = k
        if voltage_v[k] < voltage_v[lowest]:
            lowest = k
        if direction >= 0 and voltage_v[k] < voltage_v[highest] - band_v:
            if direction > 0:
                reversals[count] = highest
                count += 1
            direction = -1
            lowest = k
            highest = k
        elif direction <= 0 and voltage_v[k] > voltage_v[lowest] + band_v:
            if direction < 0:
                reversals[count] = lowest
                count += 1
            direction = 1
            highest = k
            lowest = k
    return count
