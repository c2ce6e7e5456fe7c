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
The Prandtl-Ishlinskii model with equally spaced thresholds, as it is commonly used.

    x = p_0 u + sum_i p_i P[r_i](u),   r_i = i max|u| / (n + 1),   p_i >= 0

With thresholds that are fitted as well it is the MRC model, see
`piezo_ros.identification.hysteresis.mrc_fit`.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification.hysteresis.least_squares import minimise
from piezo_ros.identification.hysteresis.mrc_fit import PlayModel, play_bounds
from piezo_ros.identification.hysteresis.records import Record, accumulate

__all__ = ['fit_prandtl_ishlinskii']


def fit_prandtl_ishlinskii(
    records: Sequence[Record], plays: int, delay_samples: float,
) -> NDArray[np.float64]:
    """
    Fit the weights of equally spaced plays by non-negative least squares.

    Parameters
    ----------
    records : sequence of Record
        The data.
    plays : int
        Number n of plays beside the linear term.
    delay_samples : float
        Delay of the displacement.

    Returns
    -------
    ndarray, shape (2n + 3,)
        Parameters of a `PlayModel`.

    """
    reach_v = max(record.reach_v for record in records)
    reach_um = max(
        float(np.max(np.abs(record.displacement_um * record.weight))) for record in records)
    thresholds = np.arange(1, plays + 1) * (reach_v / (plays + 1))
    start = np.concatenate((
        np.full(plays + 1, reach_um / reach_v / (plays + 1)), thresholds, [delay_samples, 0.0]))
    lower, upper = play_bounds(start, reach_v, (delay_samples, delay_samples))
    lower[plays + 1:-2] = upper[plays + 1:-2] = thresholds
    theta, _ = minimise(partial(accumulate, PlayModel(plays), records), start, lower, upper)
    return theta
