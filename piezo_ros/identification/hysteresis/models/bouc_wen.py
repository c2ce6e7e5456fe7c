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
The Bouc-Wen model of hysteresis, rate-independent, from voltage u to displacement x.

    x = d u - h + offset,   dh = a du - beta |du| h - gamma du |h|
"""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification.estimation.least_squares import minimise
from piezo_ros.identification.hysteresis.records import Record, accumulate

__all__ = ['BoucWenModel', 'fit_bouc_wen']

# The sum of squares has several minima. The starts differ in the voltage over which h decays, as a
# share of the largest voltage.
_STARTS: Final = (0.05, 0.2, 0.8)
_CHUNK_SAMPLES: Final = 4096  # the Jacobian of a chunk stays in the cache of the processor

_Floats = NDArray[np.float64]


class BoucWenModel:
    """The model without delay; theta is (d, a, beta, gamma, offset)."""

    def add(
        self, record: Record, theta: _Floats, gradient: _Floats, curvature: _Floats,
    ) -> float:
        """Add the normal equations of a record, see `RecordModel.add`."""
        cost = 0.0
        jacobian = np.empty((_CHUNK_SAMPLES, theta.size))
        for chunk, predicted, count in self._chunks(record, theta, record.weight, jacobian):
            used = record.weight[chunk] > 0.0
            weight = record.weight[chunk][used]
            residual = (record.displacement_um[chunk] - predicted)[used]
            rows = jacobian[:count]
            cost += float(weight @ residual**2)
            gradient += rows.T @ (weight * residual)
            curvature += rows.T @ (weight[:, np.newaxis] * rows)
        return cost

    def predict(self, record: Record, theta: _Floats) -> _Floats:
        """Return the displacement at every sample, see `RecordModel.predict`."""
        nothing = np.zeros_like(record.weight)
        return np.concatenate([
            predicted.copy() for _, predicted, _ in self._chunks(
                record, theta, nothing, np.empty((0, theta.size)))])

    def _chunks(
        self, record: Record, theta: _Floats, weight: _Floats, jacobian: _Floats,
    ) -> Iterator[tuple[slice, _Floats, int]]:
        """Run through a record; yield slice, prediction and number of rows of the Jacobian."""
        from piezo_ros.identification.hysteresis.fit_kernels import bouc_wen_chunk
        state = np.zeros(5)  # voltage, h and the derivatives of h of a virgin stage
        prediction = np.empty(_CHUNK_SAMPLES)
        for first in range(0, weight.size, _CHUNK_SAMPLES):
            chunk = slice(first, min(first + _CHUNK_SAMPLES, weight.size))
            part = prediction[:chunk.stop - first]
            yield chunk, part, bouc_wen_chunk(
                state, theta, record.voltage_v[chunk], weight[chunk], part, jacobian)


def fit_bouc_wen(records: Sequence[Record]) -> _Floats:
    """
    Fit the Bouc-Wen model by least squares, from several starts.

    Parameters
    ----------
    records : sequence of Record
        The data, free of delay.

    Returns
    -------
    ndarray, shape (5,)
        (d, um/V; a, um/V; beta, 1/V; gamma, 1/V; offset, um).

    """
    reach_v = max(float(np.max(np.abs(record.voltage_v))) for record in records)
    squares = sum(float(np.sum(record.weight * record.voltage_v**2)) for record in records)
    gain = sum(
        float(np.sum(record.weight * record.voltage_v * record.displacement_um))
        for record in records) / squares
    steepest = 100.0 / reach_v
    lower = np.array([-np.inf, -np.inf, 0.0, -steepest, -np.inf])
    upper = np.array([np.inf, np.inf, steepest, steepest, np.inf])
    evaluate = partial(accumulate, BoucWenModel(), records)
    fits = [
        minimise(evaluate, np.array([
            1.1 * gain, 0.5 * gain, 1.0 / (share * reach_v), 0.0, 0.0]), lower, upper)
        for share in _STARTS]
    return min(fits, key=lambda fit: fit[1].cost)[0]
