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

"""Table 3 of Liu 2015 offline: from which frequency on feedback does harm, by amplitude."""

from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros import paper
from piezo_ros.control import TrajectoryParameters
from piezo_ros.identification import crossing_frequency_hz
from piezo_ros.model import RigParameters
from piezo_ros.study.table_4 import tracking_errors

__all__ = ['SINE_FREQUENCIES_HZ', 'beyond_published_band_hz', 'crossing_frequencies_hz']

SINE_FREQUENCIES_HZ: Final = tuple(float(f) for f in range(300, 951, 50))


def crossing_frequencies_hz(
    plant: RigParameters, amplitudes_um: Iterable[float] = paper.TABLE_3,
) -> NDArray[np.float64]:
    """
    Return where FF and FBFF follow a sine equally well, all but the rig as published.

    Parameters
    ----------
    plant : RigParameters
        The rig.
    amplitudes_um : iterable of float, optional
        Rows of Table 3, all by default.

    Returns
    -------
    ndarray, shape (rows,)
        Hertz; 0 or infinite where one scheme is the better one at all frequencies.

    """
    sine = TrajectoryParameters(waveform='sine', harmonics=1)
    crossings_hz = []
    for amplitude_um in amplitudes_um:
        errors = tracking_errors(
            plant, [(amplitude_um, frequency_hz) for frequency_hz in SINE_FREQUENCIES_HZ],
            trajectory=sine)
        crossings_hz.append(
            crossing_frequency_hz(SINE_FREQUENCIES_HZ, errors[:, 0], errors[:, 1]))
    return np.array(crossings_hz)


def beyond_published_band_hz(amplitude_um: float, crossing_hz: float) -> float:
    """
    Return how far a crossing lies outside the published band.

    Parameters
    ----------
    amplitude_um : float
        Row of Table 3.
    crossing_hz : float
        The crossing; NaN where there is none.

    Returns
    -------
    float
        Hertz; 0 within the band, NaN without a crossing.

    """
    low_hz, high_hz = paper.TABLE_3[amplitude_um]
    return float(np.maximum(np.maximum(low_hz - crossing_hz, crossing_hz - high_hz), 0.0))
