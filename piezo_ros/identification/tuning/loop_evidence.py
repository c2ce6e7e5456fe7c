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
What is known of a stage beside its model: the measured points, and how far the model misses them.

A loop tuned on a model G holds on the stage only as far as G does. With the measured response H and
the relative error e of the model::

    |S| on the points = 1/|1 + K H z^-d|
    |S| on the band   = |S| / (1 - e |T|),   the largest for any |Delta| <= e
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.identification.tuning.linear_plant import LinearPlant, Model
from piezo_ros.identification.tuning.pi_loop import PiLoop

__all__ = ['LoopEvidence']

_UNCERTAIN: Final = 0.3  # relative standard error of a point that tells nothing

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LoopEvidence:
    """
    Measured points of a stage, and the error of the model that stands for it.

    Attributes
    ----------
    frequency_hz : ndarray, shape (N,)
        Frequencies of the points, below the Nyquist frequency of the loop; may be empty.
    response : ndarray of complex, shape (N,)
        The sampled response v[k] -> y[k] there, micrometres per micrometre.
    model_error : float
        Relative error of the model; 0 where it is not known.
    usable_to_hz : float
        Up to where the model holds; above, its error is taken as 100 %.

    """

    frequency_hz: _Floats
    response: NDArray[np.complex128]
    model_error: float = 0.0
    usable_to_hz: float = math.inf

    @classmethod
    def of(
        cls, model: Model, sample_period_s: float, frequency_hz: ArrayLike, response: ArrayLike,
        standard_error: ArrayLike, recorded_period_s: float, *, model_error: float | None = None,
        usable_to_hz: float | None = None,
    ) -> 'LoopEvidence':
        """
        Return the evidence for a loop of any sample period.

        Parameters
        ----------
        model : LinearDynamics, DynamicsFit or control.TransferFunction
            The model, by which points of another sample period are converted.
        sample_period_s : float
            Sample period of the loop.
        frequency_hz, response, standard_error : array_like, shape (N,)
            The points behind the hold of their record. Points with a standard error above 30 %
            tell nothing and are left out.
        recorded_period_s : float
            Sample period of their record.
        model_error, usable_to_hz : float, optional
            As far as known.

        """
        frequency = np.asarray(frequency_hz, dtype=np.float64)
        points = np.asarray(response, dtype=np.complex128)
        errors = np.nan_to_num(np.asarray(standard_error, dtype=np.float64))
        used = (errors <= _UNCERTAIN * np.abs(points)) & (frequency < 0.5 / sample_period_s)
        frequency, points = frequency[used], points[used]
        if frequency.size and not math.isclose(sample_period_s, recorded_period_s, rel_tol=1e-9):
            plant = LinearPlant.of(model)
            points = points * (
                plant.sampled(sample_period_s).response(frequency)
                / plant.sampled(recorded_period_s).response(frequency))
        return cls(
            frequency, points, model_error or 0.0,
            math.inf if usable_to_hz is None else usable_to_hz)

    def point_sensitivity(self, loop: PiLoop) -> _Floats:
        """Return |S| at the measured points, shape (N,)."""
        open_loop = (
            loop.controller_response(self.frequency_hz) * self.response
            * loop.measurement_response(self.frequency_hz))
        return np.asarray(np.abs(1.0 / (1.0 + open_loop)))

    def relative_error(self, frequency_hz: _Floats) -> _Floats:
        """Return the relative error of the model at frequencies in hertz, shape (N,)."""
        return np.where(frequency_hz <= self.usable_to_hz, self.model_error, 1.0)

    def band_sensitivity(self, frequency_hz: _Floats, open_loop: ArrayLike) -> _Floats:
        """Return the largest |S| within the error of the model, shape (N,); infinite for none."""
        response = np.asarray(open_loop, dtype=np.complex128)
        sensitivity = 1.0 / (1.0 + response)
        left = 1.0 - self.relative_error(frequency_hz) * np.abs(response * sensitivity)
        with np.errstate(divide='ignore'):
            return np.where(left > 0.0, np.abs(sensitivity) / np.maximum(left, 0.0), np.inf)

    def largest_on_points(self, loop: PiLoop) -> float | None:
        """Return the largest |S| on the points; None without any."""
        return float(self.point_sensitivity(loop).max()) if self.frequency_hz.size else None

    def largest_on_band(self, loop: PiLoop) -> float | None:
        """Return the largest |S| on the band of the model; None where its error is not known."""
        if not self.model_error:
            return None
        frequency_hz = loop.frequencies_hz()
        return float(self.band_sensitivity(frequency_hz, loop.loop(frequency_hz)).max())
