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
Data converters: a range and a step, as of a D/A or A/D card.

With the operating point o, the rails lo and hi, and the step q = span / 2^bits::

    out = min(max(q floor((in + o) / q + 1/2), lo), hi) - o
"""

import math
from typing import NamedTuple

from piezo_ros.model.step import step

__all__ = ['ConverterConstants', 'convert_step', 'converter_constants']


class ConverterConstants(NamedTuple):
    """Range and resolution of a converter, in the unit of the quantity and absolute."""

    minimum: float
    maximum: float
    resolution: float  # 0 for an ideal converter
    operating_point: float


def converter_constants(
    minimum: float, maximum: float, span: float, bits: int, operating_point: float,
) -> ConverterConstants:
    """
    Return the constants of a converter.

    Parameters
    ----------
    minimum, maximum : float
        Absolute range that is let through.
    span : float
        Range of the converter, which its steps divide.
    bits : int
        Resolution; 0 for an ideal converter.
    operating_point : float
        Absolute value of zero deviation.

    """
    resolution = span / 2.0**bits if bits else 0.0
    return ConverterConstants(minimum, maximum, resolution, operating_point)


@step
def convert_step(constants: ConverterConstants, deviation: float) -> float:
    """
    Return the deviation that comes out of the converter: to the nearest step, then clipped.

    Examples
    --------
    >>> constants = converter_constants(-2.0, 10.0, 20.0, 16, 5.0)
    >>> round(convert_step(constants, 1.0), 4)  # 20 V over 2^16 steps: 0.3 mV
    1.0001
    >>> convert_step(constants, 6.0)  # 11 V are beyond the rail at 10 V
    5.0

    """
    value = deviation + constants.operating_point
    if constants.resolution > 0.0:
        # A step beyond the rails is as far as any: the number of steps must fit into an integer.
        value = max(value, constants.minimum - constants.resolution)
        value = min(value, constants.maximum + constants.resolution)
        value = math.floor(value / constants.resolution + 0.5) * constants.resolution
    # Last, so that rounding cannot carry it beyond a rail.
    if value < constants.minimum:
        value = constants.minimum
    elif value > constants.maximum:
        value = constants.maximum
    return value - constants.operating_point
