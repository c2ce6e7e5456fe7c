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

"""Notices a sensor that shows one and the same value whatever the voltage."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.hardware.device import Refused
from piezo_ros.runtime.streams.sample_queue import SampleQueue

__all__ = ['SensorWatch']

_READINGS: Final = 200  # equal ones in a row; of a converter with any noise two are rare
_SHARE: Final = 0.05  # of the way to the nearer rail, which the voltage must have moved meanwhile


class SensorWatch:
    """
    Compares readings with each other until two of them differ.

    Parameters
    ----------
    reach_v : float
        Distance of the nearer rail from the operating point.

    """

    def __init__(self, reach_v: float) -> None:
        self._least_span_v = _SHARE * reach_v
        self._unanswered = SampleQueue()  # voltages, as long as no reading has differed
        self._lowest_v, self._highest_v = math.inf, -math.inf  # of those that were answered
        self._first_um: float | None = None
        self._readings = 0
        self._has_moved = False

    def play(self, voltage_v: NDArray[np.float64]) -> None:
        """Take note of the next voltages, shape (N,)."""
        if not self._has_moved:
            self._unanswered.extend(voltage_v)

    def check(self, displacement_um: NDArray[np.float64]) -> None:
        """
        Look at the readings that answer the next of the voltages, shape (N,).

        Raises
        ------
        Refused
            If all have been equal although the voltage moved the stage.

        """
        if self._has_moved or not displacement_um.size:
            return
        if self._first_um is None:
            self._first_um = float(displacement_um[0])
        if np.any(displacement_um != self._first_um):
            self._has_moved = True
            self._unanswered.clear()
            return
        self._readings += displacement_um.size
        answered_v = self._unanswered.pull(displacement_um.size)
        self._lowest_v = float(answered_v.min(initial=self._lowest_v))
        self._highest_v = float(answered_v.max(initial=self._highest_v))
        if self._readings >= _READINGS and self._highest_v - self._lowest_v > self._least_span_v:
            raise Refused(
                f'the sensor shows {self._first_um:g} um in {self._readings} readings, while the '
                f'voltage went from {self._lowest_v:g} to {self._highest_v:g} V: it is stuck, '
                'off or not connected (input_channel, servo, cable)')
