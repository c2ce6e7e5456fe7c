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
Compiled kernels of the identification: a superposition of plays, the Bouc-Wen model, turns.

Play of threshold r, and the superposition of n plays with a displacement that lags by d samples:

    P_k = max(u_k - r, min(u_k + r, P_{k-1})),   x_k = p_0 u_k + sum_i p_i P_k[r_i]
    y(t) = x_{j-1} + s (x_j - x_{j-1}) + offset,   t - d between the times of j - 1 and j

As long as the voltage does not turn and no further play starts to move, every derivative of the
prediction is a straight line over U = u_{j-1} + s (u_j - u_{j-1}), that by the delay is a multiple
of the rate V = (u_j - u_{j-1})/(t_j - t_{j-1}). Of all samples of such a *piece* the normal
equations need the sums over 1, U, V and the residual alone: a sample costs the same for any number
of plays, a piece costs the square of the number of parameters.

Bouc-Wen model, implicit where h decays, so that no step, however coarse, makes h grow:

    q_k = beta |du_k| + gamma du_k sign(h_{k-1})
    h_k = (h_{k-1} + a du_k)/(1 + q_k) if q_k > 0 else (h_{k-1} + a du_k)(1 - q_k)
    x_k = d u_k - h_k + offset
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros.model.compiled import kernel
from piezo_ros.model.step import step

__all__ = ['add_play_equations', 'bouc_wen_chunk', 'find_reversals', 'play_predictions']

_Floats = NDArray[np.float64]


@step
def _move(play_v: Any, by_threshold: Any, moving: Any, theta: Any, voltage: float) -> float:
    """Move the plays to a voltage; return the displacement without offset."""
    plays = len(play_v)
    displacement: float = theta[0] * voltage
    for i in range(plays):
        threshold = theta[plays + 1 + i]
        moving[i] = 0.0
        if voltage - threshold > play_v[i]:
            play_v[i] = voltage - threshold
            by_threshold[i] = -1.0
            moving[i] = 1.0
        elif voltage + threshold < play_v[i]:
            play_v[i] = voltage + threshold
            by_threshold[i] = 1.0
            moving[i] = -1.0
        displacement += theta[1 + i] * play_v[i]
    return displacement


@step
def _add_row(
    row: Any, slope: Any, rate: float, sums: Any, gradient: Any, curvature: Any,
    held: Any, driven: Any,
) -> None:
    """
    Add a piece to the normal equations and clear its sums.

    The derivatives are row + slope U', U' the voltage from the start of the piece; that by the
    delay, the last but one, is rate V. The sums are those of w times
    1, U', U'^2, V, V U', V^2, e, e U', e V, with the residual e.
    """
    size = len(row)
    delay = size - 2
    for c in range(size):
        held[c] = sums[0] * row[c] + sums[1] * slope[c]
        driven[c] = sums[1] * row[c] + sums[2] * slope[c]
        gradient[c] += sums[6] * row[c] + sums[7] * slope[c]
    held[delay] = sums[3] * rate
    driven[delay] = sums[4] * rate
    for c in range(size):
        if c == delay:
            continue
        one = row[c]
        two = slope[c]
        if two == 0.0:
            for d in range(c, size):
                curvature[c, d] += one * held[d]
        else:
            for d in range(c, size):
                curvature[c, d] += one * held[d] + two * driven[d]
    gradient[delay] += rate * sums[8]
    curvature[delay, delay] += rate * rate * sums[5]
    curvature[delay, size - 1] += rate * sums[3]
    for i in range(len(sums)):
        sums[i] = 0.0


@kernel
def add_play_equations(
    theta: _Floats, index: _Floats, voltage_v: _Floats, displacement_um: _Floats, weight: _Floats,
    gradient: _Floats, curvature: _Floats, work: _Floats,
) -> float:
    """
    Add the normal equations of one record, the upper triangle of J'WJ; return e'We.

    ``theta`` is (p_0 … p_n, r_1 … r_n, delay, offset); ``work`` has at least 10 (2n + 3) + 9
    numbers. A moving play has the derivative -1 or +1 by its threshold; a play at rest keeps the
    derivative that it had when it stopped.
    """
    size = theta.size
    plays = (size - 3) // 2
    delay, offset = theta[size - 2], theta[size - 1]
    play_v, before_v = work[:plays], work[plays:2 * plays]
    by_threshold, by_before = work[2 * plays:3 * plays], work[3 * plays:4 * plays]
    moving = work[4 * plays:5 * plays]
    row, slope = work[5 * size:6 * size], work[6 * size:7 * size]
    held, driven = work[7 * size:8 * size], work[8 * size:9 * size]
    sums = work[9 * size:9 * size + 9]
    work[:] = 0.0
    last = voltage_v.size - 1
    at = 0
    now = _move(play_v, by_threshold, moving, theta, voltage_v[0])
    before = now
    # The piece: where it starts, its direction and reach, the displacement and its slope there.
    start_v, start_um, stiffness = voltage_v[0], now, theta[0]
    direction, reach_v = 0.0, 0.0
    inside = False
    rate = 0.0
    cost = 0.0
    for k in range(voltage_v.size):
        time = index[k] - delay
        while at < last and index[at] < time:
            at += 1
            voltage = voltage_v[at]
            change = voltage - voltage_v[at - 1]
            before = now
            if direction != 0.0 and change * direction >= 0.0 and (
                    (voltage - reach_v) * direction <= 0.0):
                inside = True
                now = start_um + stiffness * (voltage - start_v)
            else:
                if sums[0] > 0.0:
                    _add_row(row, slope, rate, sums, gradient, curvature, held, driven)
                # Moving plays are where the last voltage has them.
                for i in range(plays):
                    if slope[1 + i] != 0.0:
                        play_v[i] += voltage_v[at - 1] - start_v
                    before_v[i] = play_v[i]
                    by_before[i] = by_threshold[i]
                now = _move(play_v, by_threshold, moving, theta, voltage)
                inside = False
                direction = 1.0 if change > 0.0 else -1.0 if change < 0.0 else 0.0
                start_v, start_um, stiffness = voltage, now, theta[0]
                reach_v = direction * np.inf
                row[0] = voltage
                slope[0] = 1.0
                for i in range(plays):
                    slope[1 + i] = 1.0 if moving[i] != 0.0 else 0.0
                    row[1 + i] = play_v[i]
                    row[1 + plays + i] = theta[1 + i] * by_threshold[i]
                    if moving[i] != 0.0:
                        stiffness += theta[1 + i]
                    elif direction != 0.0:
                        edge_v = play_v[i] + direction * theta[plays + 1 + i]
                        if (edge_v - reach_v) * direction < 0.0:
                            reach_v = edge_v
                row[size - 1] = 1.0
                rate = -stiffness
        if weight[k] <= 0.0:
            continue
        share = 1.0
        gap = 1.0
        if at > 0:
            gap = index[at] - index[at - 1]
            if time < index[at]:
                share = max((time - index[at - 1]) / gap, 0.0)
        residual = displacement_um[k] - (before + share * (now - before) + offset)
        w = weight[k]
        cost += w * residual * residual
        old_v = voltage_v[at - 1] if at > 0 else voltage_v[0]
        if inside and time <= index[last]:
            u = old_v + share * (voltage_v[at] - old_v) - start_v
            v = (voltage_v[at] - old_v) / gap
            sums[0] += w
            sums[1] += w * u
            sums[2] += w * u * u
            sums[3] += w * v
            sums[4] += w * v * u
            sums[5] += w * v * v
            sums[6] += w * residual
            sums[7] += w * residual * u
            sums[8] += w * residual * v
            continue
        # Between two samples on different pieces, or before or after all of them.
        held[0] = old_v + share * (voltage_v[at] - old_v)
        for i in range(plays):
            p_now, d_now = play_v[i], by_threshold[i]
            p_before, d_before = before_v[i], by_before[i]
            if inside:  # after the last sample
                p_now += slope[1 + i] * (voltage_v[at] - start_v)
                p_before, d_before = p_now, d_now
            elif at == 0:
                p_before, d_before = p_now, d_now
            held[1 + i] = p_before + share * (p_now - p_before)
            held[1 + plays + i] = theta[1 + i] * (d_before + share * (d_now - d_before))
        held[size - 2] = (
            -(now - before) / gap if at > 0 and index[0] <= time <= index[last] else 0.0)
        held[size - 1] = 1.0
        for c in range(size):
            gradient[c] += w * residual * held[c]
            scaled = w * held[c]
            for d in range(c, size):
                curvature[c, d] += scaled * held[d]
    if sums[0] > 0.0:
        _add_row(row, slope, rate, sums, gradient, curvature, held, driven)
    return cost


@kernel
def play_predictions(
    theta: _Floats, index: _Floats, voltage_v: _Floats, prediction_um: _Floats, work: _Floats,
) -> None:
    """Fill in the prediction at every sample; ``work`` has at least 3n numbers."""
    size = theta.size
    plays = (size - 3) // 2
    delay, offset = theta[size - 2], theta[size - 1]
    work[:] = 0.0
    play_v, by_threshold = work[:plays], work[plays:2 * plays]
    moving = work[2 * plays:3 * plays]
    last = voltage_v.size - 1
    at = 0
    now = _move(play_v, by_threshold, moving, theta, voltage_v[0])
    before = now
    for k in range(voltage_v.size):
        time = index[k] - delay
        while at < last and index[at] < time:
            at += 1
            before = now
            now = _move(play_v, by_threshold, moving, theta, voltage_v[at])
        share = 1.0
        if at > 0 and time < index[at]:
            share = max((time - index[at - 1]) / (index[at] - index[at - 1]), 0.0)
        prediction_um[k] = before + share * (now - before) + offset


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
