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
A synthetic sample: heights at any position, for images without a microscope.

A grating of square pits with rounded edges, a few round particles, and a slow tilt::

    z(x, y) = depth S(sin(2 pi x/p)) S(sin(2 pi y/p)) + sum_i h_i exp(-|r - r_i|^2/(2 s_i^2)) + tilt

with S(v) = (1 + tanh(v/edge))/2.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ['SyntheticSample']

_PARTICLES: Final = 12
_EDGE: Final = 0.15


@dataclass(frozen=True)
class SyntheticSample:
    """
    Heights of a calibration grating with particles on it.

    Attributes
    ----------
    pitch_um : float
        Period of the grating.
    depth_um : float
        Depth of its pits.
    size_um : float
        Side of the square around the origin in which the particles lie.
    seed : int
        Seed of their places.

    Examples
    --------
    >>> sample = SyntheticSample(pitch_um=0.5, size_um=4.0)
    >>> bool(abs(sample.height_um(0.125, 0.125) - sample.height_um(0.375, 0.125)) > 0.05)
    True

    """

    pitch_um: float = 0.4
    depth_um: float = 0.1
    size_um: float = 4.0
    seed: int = 7

    def height_um(
        self, x_um: NDArray[np.float64] | float, y_um: NDArray[np.float64] | float,
    ) -> NDArray[np.float64]:
        """
        Return the heights at positions, of the shape to which x and y broadcast.

        Parameters
        ----------
        x_um, y_um : array_like
            Positions, micrometres from the operating point.

        """
        x, y = np.broadcast_arrays(
            np.asarray(x_um, dtype=np.float64), np.asarray(y_um, dtype=np.float64))
        turn = 2.0 * np.pi / self.pitch_um
        height = self.depth_um * _step(np.sin(turn * x)) * _step(np.sin(turn * y))
        random = np.random.default_rng(self.seed)
        places = self.size_um * (random.random((_PARTICLES, 2)) - 0.5)
        widths = self.size_um * (0.01 + 0.02 * random.random(_PARTICLES))
        for (centre_x, centre_y), width in zip(places.tolist(), widths.tolist(), strict=True):
            height = height + self.depth_um * np.exp(
                -((x - centre_x)**2 + (y - centre_y)**2) / (2.0 * width**2))
        return np.asarray(height + 0.02 * self.depth_um / self.size_um * (x + 0.5 * y))


def _step(value: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(0.5 * (1.0 + np.tanh(value / _EDGE)))
