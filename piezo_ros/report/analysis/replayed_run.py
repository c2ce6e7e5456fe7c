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

"""The samples of a recorded run and of its replay, and the errors of both."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from piezo_ros.report.metrics import nrmse

__all__ = ['ReplayedRun']

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ReplayedRun:
    """
    The samples that a recorded run and its replay have in common.

    Attributes
    ----------
    time_s, reference_um : ndarray, shape (N,)
        Time from the start of the run, and reference.
    displacement_um, voltage_v : tuple of ndarray, shape (N,) each
        Recorded and replayed.
    scored : slice
        The part over which errors are told: behind the transients of the start.

    """

    time_s: _Floats
    reference_um: _Floats
    displacement_um: tuple[_Floats, _Floats]
    voltage_v: tuple[_Floats, _Floats]
    scored: slice

    def nrmse_percent(self) -> tuple[float, float]:
        """Return the NRMSE of the recorded and of the replayed run, percent."""
        reference_um = self.reference_um[self.scored]
        one, other = (
            100.0 * nrmse(reference_um, displacement_um[self.scored])
            for displacement_um in self.displacement_um)
        return one, other

    def max_error_um(self) -> tuple[float, float]:
        """Return the largest error of both, micrometres."""
        one, other = (
            float(np.max(np.abs(self.reference_um - displacement_um)[self.scored]))
            for displacement_um in self.displacement_um)
        return one, other

    def max_voltage_v(self) -> tuple[float, float]:
        """Return the largest size of the voltage of both, volts."""
        one, other = (
            float(np.max(np.abs(voltage_v[self.scored]))) for voltage_v in self.voltage_v)
        return one, other
