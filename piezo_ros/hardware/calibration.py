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
Between the quantities of the package and the volts at the connectors of a card.

With the operating point u0, the scale s of the sensor in um/V and the sensor voltage v0 at the
operating point::

    output = u0 + u          u: deviation at the amplifier input
    y = s (input - v0)       y: deviation of the displacement
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from piezo_ros.model.parameters import ParameterError, ParameterSet, parameter

__all__ = [
    'Calibration',
    'deviation_v',
    'displacement_um',
    'output_v',
    'sensor_v',
    'two_point_calibration',
]


@dataclass(frozen=True, kw_only=True)
class Calibration(ParameterSet):
    """Operating point of the amplifier, scale and offset of the sensor."""

    operating_point_v: float = parameter(
        5.0, 'V', 'amplifier input at zero deviation', minimum=-1e3, maximum=1e3)
    sensor_scale_um_per_v: float = parameter(
        1.2, 'um/V', 'scale of the sensor; negative if it falls while the stage extends',
        minimum=-1e6, maximum=1e6)
    sensor_offset_v: float = parameter(
        0.0, 'V', 'voltage of the sensor at the operating point', minimum=-1e3, maximum=1e3)

    def check_together(self) -> None:
        """Refuse a sensor that shows nothing."""
        if abs(self.sensor_scale_um_per_v) < 1e-6:
            raise ParameterError(
                f'sensor_scale_um_per_v is {self.sensor_scale_um_per_v} um/V, allowed is a size '
                'of 1e-06 … 1e+06 um/V')


def output_v(calibration: Calibration, voltage_v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the volts at the amplifier input for deviations, shape (N,)."""
    return voltage_v + calibration.operating_point_v


def deviation_v(calibration: Calibration, held_v: float) -> float:
    """Return the deviation for the volts at the amplifier input."""
    return held_v - calibration.operating_point_v


def displacement_um(
    calibration: Calibration, readings_v: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return displacements for readings of the sensor in volts, shape (N,)."""
    return (readings_v - calibration.sensor_offset_v) * calibration.sensor_scale_um_per_v


def sensor_v(
    calibration: Calibration, deviation_um: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return what the sensor gives for displacements, volts, shape (N,)."""
    return deviation_um / calibration.sensor_scale_um_per_v + calibration.sensor_offset_v


def two_point_calibration(
    first_v: float, first_um: float, second_v: float, second_um: float, *,
    operating_point_um: float,
) -> tuple[float, float]:
    """
    Return scale and offset of a sensor from two known displacements.

    Parameters
    ----------
    first_v, second_v : float
        What the sensor gave, volts.
    first_um, second_um : float
        Where the stage was by another instrument, micrometres.
    operating_point_um : float
        Displacement at zero deviation, micrometres, counted as those two are.

    Returns
    -------
    sensor_scale_um_per_v, sensor_offset_v : float
        Parameters of `Calibration`.

    Raises
    ------
    ValueError
        If a value is not finite, or the points do not differ.

    Examples
    --------
    >>> two_point_calibration(-5.0, 0.0, 5.0, 12.0, operating_point_um=6.0)
    (1.2, 0.0)

    """
    values = {
        'first_v': first_v, 'first_um': first_um, 'second_v': second_v, 'second_um': second_um,
        'operating_point_um': operating_point_um}
    for name, value in values.items():
        if not math.isfinite(value):
            raise ValueError(f'{name} is {value}, it must be finite')
    for name, one, other in (('v', first_v, second_v), ('um', first_um, second_um)):
        if one == other:
            raise ValueError(
                f'first_{name} and second_{name} are both {one}, two different points are needed')
    scale_um_per_v = (second_um - first_um) / (second_v - first_v)
    return scale_um_per_v, first_v + (operating_point_um - first_um) / scale_um_per_v
