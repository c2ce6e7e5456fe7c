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
Compiled kernels of the hysteresis identification: predictions with their derivatives.

Play of threshold r, and a superposition of n plays:

    P_k = max(u_k - r, min(u_k + r, P_{k-1})),   x_k = p_0 u_k + sum_i p_i P_k[r_i]

Bouc-Wen model, implicit where h decays, so that no step, however coarse, makes h grow:

    q_k = beta |du_k| + gamma du_k sign(h_{k-1})
    h_k = (h_{k-1} + a du_k)/(1 + q_k) if q_k > 0 else (h_{k-1} + a du_k)(1 - q_k)
    x_k = d u_k - h_k + offset

Delay of d samples, with the share s that `delayed` returns:

    x(k - d) = x_{j-1} + s (x_j - x_{j-1})
"""

import numpy as np
from numpy.typing import NDArray

from piezo_ros.model.compiled import kernel

__all__ = ['bouc_wen_chunk', 'find_reversals', 'play_chunk']

_Floats = NDArray[np.float64]


@kernel
def play_chunk(
    play_v: _Floats, by_threshold: _Floats, last: _Floats, theta: _Floats, share: float,
    voltage_v: _Floats, weight: _Floats, prediction_um: _Floats, jacobian: _Floats,
) -> int:
    """
    Predict some samples of a delayed superposition of plays and differentiate by every parameter.

    ``theta`` is (p_0 … p_n, r_1 … r_n, delay, offset). The prediction is interpolated between the
    displacements of the last and the present voltage, with the weight ``share`` of the present one.
    A moving play has the derivative -1 or +1 by its threshold; a play at rest keeps the derivative
    that it had when it stopped. The state between chunks is ``play_v`` and ``by_threshold``, shape
    (n,), and ``last``, the last voltage and displacement. Samples without weight get no row of the
    Jacobian; the number of rows is returned.
    """
    plays = play_v.size
    row = 0
    for k in range(voltage_v.size):
        voltage = voltage_v[k]
        used = weight[k] > 0.0
        if used:
            jacobian[row, 0] = last[0] + share * (voltage - last[0])
        displacement = theta[0] * voltage
        for i in range(plays):
            threshold = theta[plays + 1 + i]
            before = play_v[i]
            play = before
            by_before = by_threshold[i]
            by_now = by_before
            if voltage - threshold > play:
                play = voltage - threshold
                by_now = -1.0
            elif voltage + threshold < play:
                play = voltage + threshold
                by_now = 1.0
            play_v[i] = play
            by_threshold[i] = by_now
            displacement += theta[1 + i] * play
            if used:
                jacobian[row, 1 + i] = before + share * (play - before)
                jacobian[row, plays + 1 + i] = theta[1 + i] * (
                    by_before + share * (by_now - by_before))
        change = displacement - last[1]
        prediction_um[k] = last[1] + share * change + theta[2 * plays + 2]
        if used:
            jacobian[row, 2 * plays + 1] = -change
            jacobian[row, 2 * plays + 2] = 1.0
            row += 1
        last[0] = voltage
        last[1] = displacement
    return row


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
