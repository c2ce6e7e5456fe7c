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
Shapes of one period, for a peak of 1, all odd about phase 0 and about phase 1/2.

Straight lines with parabolic turns: a rise of the share 1 - b of a period and a fly-back of the
share b (a triangle has b = 1/2), of each of which the share t is spent in turns, half of it at each
end. With the straight rise up to t1 = (1 - b)(1 - t)/2, the turn of the length w = t/2 behind it,
and c = b (1 - t)/2 + w/2, the middle of the turn being 1/2 - c::

    x(p) = rise p                                    p < t1
    x(p) = rise p - (rise + fall)/(2 w) (p - t1)^2   t1 <= p < t1 + w
    x(p) = fall (1/2 - p)                            t1 + w <= p <= 1/2
    rise = 1/(t1 + w c),   fall = (1/2 - c)/c rise

Staircase of n steps from the middle to the peak, from the triangle h(p) = n triangle(p), each step
as smooth as s(v) = 3 v^2 - 2 v^3 over the share t of a stair::

    x(p) = (floor(h) + s(v))/n,   v = (h - floor(h) - (1 - t)/2)/t  within 0 ... 1
"""

import math
from typing import NamedTuple

from piezo_ros.model.step import step

__all__ = [
    'TurningShape', 'straight_triangle_step', 'staircase_step', 'turning_shape', 'turning_step',
]


class TurningShape(NamedTuple):
    """Straight lines with parabolic turns."""

    rise: float  # slope per period, for a peak of 1
    fall: float
    straight_until: float  # phase at which the turn begins
    turn: float  # its length


def turning_shape(flyback_fraction: float, turn_fraction: float) -> TurningShape:
    """
    Return the shape of a triangle or sawtooth.

    Parameters
    ----------
    flyback_fraction : float
        Share b of a period from the positive to the negative peak, above 0 and below 1.
    turn_fraction : float
        Share t of each line that is spent in turns, 0 … 1.

    Examples
    --------
    >>> turning_shape(0.5, 0.0)
    TurningShape(rise=4.0, fall=4.0, straight_until=0.25, turn=0.0)

    """
    turn = 0.5 * turn_fraction
    straight_until = 0.5 * (1.0 - flyback_fraction) * (1.0 - turn_fraction)
    behind = 0.5 * flyback_fraction * (1.0 - turn_fraction) + 0.5 * turn
    rise = 1.0 / (straight_until + turn * behind)
    return TurningShape(rise, (0.5 - behind) / behind * rise, straight_until, turn)


@step
def turning_step(shape: TurningShape, phase: float) -> float:
    """Return the value of a shape with turns at a phase, 0 … 1."""
    mirrored = phase > 0.5
    nearest = 1.0 - phase if mirrored else phase
    if nearest < shape.straight_until:
        value = shape.rise * nearest
    elif nearest < shape.straight_until + shape.turn:
        into = nearest - shape.straight_until
        value = shape.rise * nearest - 0.5 * (shape.rise + shape.fall) / shape.turn * into * into
    else:
        value = shape.fall * (0.5 - nearest)
    return -value if mirrored else value


@step
def straight_triangle_step(phase: float) -> float:
    """Return the value of a triangle without turns at a phase, 0 … 1."""
    if phase < 0.25:
        return 4.0 * phase
    if phase < 0.75:
        return 2.0 - 4.0 * phase
    return 4.0 * phase - 4.0


@step
def staircase_step(stairs: float, turn_fraction: float, triangle: float) -> float:
    """Return the value of a staircase where the triangle beneath it has a value, -1 … 1."""
    height = stairs * triangle
    stair = math.floor(height)
    into = height - stair - 0.5 * (1.0 - turn_fraction)
    if into <= 0.0:
        return stair / stairs
    if into >= turn_fraction:
        return (stair + 1.0) / stairs
    share = into / turn_fraction
    return (stair + share * share * (3.0 - 2.0 * share)) / stairs
