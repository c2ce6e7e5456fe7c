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
The asymmetry of a hysteresis: one-sided dead zones behind the MRC operator, and the exact inverse.

Behind H stands a strictly rising map without memory, the superposition of one-sided dead zones of
the modified Prandtl-Ishlinskii model (Kuhnen 2003), with thresholds t_i and weights w_i::

    S(x) = x + sum over t_i >= 0 of w_i max(x - t_i, 0) + sum over t_i < 0 of w_i min(x - t_i, 0)

It is a straight line between the thresholds, about zero of slope 1, and so is its inverse. The
whole operator is S(H(u)), its inverse that of H behind that of S.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from piezo_ros.model.step import step

__all__ = [
    'AsymmetryConstants',
    'asymmetry_constants',
    'asymmetry_step',
    'symmetric_step',
]


class AsymmetryConstants(NamedTuple):
    """What the steps need of the map; lists in a node, arrays in a kernel."""

    threshold_um: Any  # (m,) rising
    image_um: Any  # (m,) S at the thresholds
    slope_below: Any  # (m,) slope of S below a threshold
    slope_above: Any  # (m,) slope of S above it


def asymmetry_constants(
    threshold_um: Sequence[float], weight: Sequence[float],
) -> AsymmetryConstants:
    """
    Return the constants of the steps as lists.

    Parameters
    ----------
    threshold_um : sequence of float, shape (m,)
        Thresholds t_i, rising.
    weight : sequence of float, shape (m,)
        Weights w_i.

    Returns
    -------
    AsymmetryConstants
        The slopes may be zero or negative, which the caller refuses.

    """
    size = len(threshold_um)
    first = sum(1 for threshold in threshold_um if threshold < 0.0)  # from zero on
    slopes = [1.0] * (size + 1)
    images = list(threshold_um)
    for i in range(first, size):
        slopes[i + 1] = slopes[i] + weight[i]
    for i in reversed(range(first)):
        slopes[i] = slopes[i + 1] + weight[i]
    for i, j in pairwise(range(first, size)):
        images[j] = images[i] + slopes[j] * (threshold_um[j] - threshold_um[i])
    for j, i in pairwise(reversed(range(first))):
        images[i] = images[j] - slopes[j] * (threshold_um[j] - threshold_um[i])
    return AsymmetryConstants(list(threshold_um), images, slopes[:-1], slopes[1:])


@step
def asymmetry_step(constants: AsymmetryConstants, displacement_um: float) -> float:
    """Return S of a displacement; the displacement itself where S has no threshold."""
    image_um = displacement_um
    for i in range(len(constants.threshold_um)):
        threshold_um = constants.threshold_um[i]
        if threshold_um < 0.0:
            if displacement_um < threshold_um:
                below_um: float = constants.image_um[i] + constants.slope_below[i] * (
                    displacement_um - threshold_um)
                return below_um
        elif displacement_um > threshold_um:
            image_um = constants.image_um[i] + constants.slope_above[i] * (
                displacement_um - threshold_um)
    return image_um


@step
def symmetric_step(constants: AsymmetryConstants, image_um: float) -> float:
    """Return the displacement of which S is the image: the exact inverse."""
    displacement_um = image_um
    for i in range(len(constants.threshold_um)):
        threshold_um = constants.threshold_um[i]
        if threshold_um < 0.0:
            if image_um < constants.image_um[i]:
                below_um: float = threshold_um + (
                    image_um - constants.image_um[i]) / constants.slope_below[i]
                return below_um
        elif image_um > constants.image_um[i]:
            displacement_um = threshold_um + (
                image_um - constants.image_um[i]) / constants.slope_above[i]
    return displacement_um
