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

"""What the printed numbers mean as functions, where more than one command needs it."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros import paper

__all__ = ['published_bound']


def published_bound(frequency_hz: ArrayLike) -> NDArray[np.float64]:
    """
    Return |W| of (19) in Liu 2015.

    Parameters
    ----------
    frequency_hz : array_like, shape (N,)
        Frequencies, hertz.

    """
    w = paper.UNCERTAINTY_BOUND
    s = 2j * math.pi * np.asarray(frequency_hz, dtype=np.float64)
    return np.asarray(w['gain'] * np.abs((s + w['zero_rad_per_s']) ** 2 / (
        (s + w['pole_1_rad_per_s']) * (s + w['pole_2_rad_per_s']))))
