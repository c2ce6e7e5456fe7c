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
The frequency below which feedback lessens the tracking error, for each amplitude of a scan.

For a sine (18) in Liu 2015 puts it at |S| = 1. For a scan it follows from the errors of FF and FBFF
at frequencies f_1 < ... < f_N: feedback is used at the first k of them, where k minimises

    sum_{i <= k} log(NRMSE_fbff(f_i)/NRMSE_ff(f_i)),

and the frequency is interpolated to where the logarithm crosses 0.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

__all__ = ['FeedbackTable', 'crossing_frequency_hz']


class FeedbackTable(NamedTuple):
    """
    Where feedback is acceptable, for the scheme auto of the controller.

    Attributes
    ----------
    amplitude_um : tuple of float
        Amplitudes, ascending.
    frequency_hz : tuple of float
        Frequency below which FBFF is predicted to have a smaller error than FF; 0 if there is none.

    """

    amplitude_um: tuple[float, ...]
    frequency_hz: tuple[float, ...]


def crossing_frequency_hz(
    frequency_hz: ArrayLike, ff_error: ArrayLike, fbff_error: ArrayLike,
) -> float:
    """
    Return the frequency below which feedback lessens the error.

    Parameters
    ----------
    frequency_hz : array_like, shape (N,)
        Ascending frequencies, hertz.
    ff_error, fbff_error : array_like, shape (N,)
        Errors under both schemes there, above 0.

    Returns
    -------
    float
        Interpolated where the ratio of the errors rises through 1; infinite where feedback helps up
        to the highest frequency, 0 where the error is least without it. Of several crossings the
        one of least error (geometric mean over the frequencies) with feedback below and none above;
        the lowest of equals.

    Examples
    --------
    >>> crossing_frequency_hz([200.0, 300.0, 400.0], [1.0, 1.0, 1.0], [0.5, 0.5, 2.0])
    350.0

    """
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    excess = np.log(np.asarray(fbff_error) / np.asarray(ff_error))
    # With feedback at the first k frequencies the error is that of FF and the first k excesses.
    with_feedback = int(np.argmin(np.concatenate([[0.0], np.cumsum(excess)])))
    if with_feedback == 0:
        return 0.0
    if with_feedback == frequency.size:
        return math.inf
    last = with_feedback - 1
    share = -excess[last] / (excess[last + 1] - excess[last])
    return float(frequency[last] + share * (frequency[last + 1] - frequency[last]))
