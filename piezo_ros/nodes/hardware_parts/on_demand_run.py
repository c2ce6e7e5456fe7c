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
A run that software times: slow, open to feedback, with its jitter measured.

u[k] is set as soon as it is there, and y[k+1] is read at the end of its period::

    t[0] = when u[0] came,   y[k+1] is read at t[0] + (k+1) Ts,   u[k+1] is set after that

How late u[k] is set after t[0] + k Ts is the jitter. A voltage that comes only after its whole
period is an overrun; the schedule then begins anew from there.
"""

import math
import time

import numpy as np
from numpy.typing import NDArray

from piezo_ros.nodes.hardware_parts.reading_check import checked_readings
from piezo_ros.nodes.hardware_parts.stage_output import StageOutput
from piezo_ros.runtime.streams.sample_queue import SampleQueue

__all__ = ['OnDemandRun']

_NAP_S = 0.002  # the longest sleep before a request to stop is looked at
_SPIN_S = 0.0002  # before a reading is due: a sleep ends late


class OnDemandRun:
    """
    Sets one voltage after the other and reads once for each.

    Parameters
    ----------
    output : StageOutput
        The output, at rest.
    sample_period_s : float
        Sample period, seconds.

    Attributes
    ----------
    is_over : bool
        Whether the last voltage has been answered.
    overruns : int
        Number of voltages that came only after their period.
    opening_difference_um : None
        No reading is taken twice here.

    """

    opening_difference_um = None
    mode = 'on demand'
    why_waiting = ''

    def __init__(self, output: StageOutput, sample_period_s: float) -> None:
        self.is_over = False
        self.overruns = 0
        self._output = output
        self._period_s = sample_period_s
        self._waiting = SampleQueue()
        self._has_ended = False
        self._due_s: float | None = None  # of the reading that is next
        self._set = 0
        self._origin_s = 0.0  # when u[0] was set, or would have been but for overruns
        self._lateness_s = (0.0, 0.0, 0.0)  # sum, sum of squares, largest

    def jitter(self) -> dict[str, float]:
        """Return how late voltages were set, seconds: mean, rms and largest."""
        total_s, squares, most_s = self._lateness_s
        count = max(self._set - 1, 1)
        return {
            'jitter_mean_s': total_s / count, 'jitter_rms_s': math.sqrt(squares / count),
            'jitter_max_s': most_s}

    def accept(self, voltage_v: NDArray[np.float64]) -> None:
        """Take the next voltages; each is checked before it is set."""
        self._waiting.extend(voltage_v)

    def end(self) -> None:
        """Take note that no voltage is to come."""
        self._has_ended = True

    def is_making_progress(self) -> bool:
        """Return whether a reading is yet to come."""
        return self._due_s is not None

    def advance(self) -> NDArray[np.float64] | None:
        """
        Set a voltage, or read once its period is over.

        Returns
        -------
        ndarray of float64, shape (1,) or (0,), or None
            The reading; nothing where a voltage was set; None where nothing could be done yet.

        Raises
        ------
        DeviceError
            If the device fails, or a voltage is beyond a limit.

        """
        if self._due_s is not None:
            return self._read(self._due_s)
        if self._waiting:
            self._set_next()
            return np.empty(0)
        if self._has_ended and not self.is_over:
            self.is_over = True
            return np.empty(0)
        return None

    def _set_next(self) -> None:
        voltage_v = self._waiting.pull(1)
        self._output.limits.check(voltage_v)
        self._output.opened.set_output(float(voltage_v[0]))
        now_s = time.monotonic()
        self._output.held_v = float(voltage_v[0])
        if not self._set:
            self._origin_s = now_s
        late_s = now_s - self._origin_s - self._set * self._period_s
        total_s, squares, most_s = self._lateness_s
        self._lateness_s = total_s + late_s, squares + late_s**2, max(most_s, late_s)
        if late_s >= self._period_s:
            self.overruns += 1
            self._origin_s += late_s
        self._set += 1
        self._due_s = self._origin_s + self._set * self._period_s

    def _read(self, due_s: float) -> NDArray[np.float64] | None:
        left_s = due_s - time.monotonic()
        if left_s > _NAP_S:
            time.sleep(_NAP_S)
            return None
        if left_s > _SPIN_S:
            time.sleep(left_s - _SPIN_S)
        while time.monotonic() < due_s:
            pass
        self._due_s = None
        return checked_readings([self._output.opened.reading()], self._set, 1)
