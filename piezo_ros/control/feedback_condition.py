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
Where feedback lessens what feedforward leaves: the feedback-acceptable condition as a table.

(18) in Liu 2015 puts it at |S| = 1, one frequency. What the amplifier allows and what the models do
not know make it a frequency for each amplitude, as in Table 3. ``piezo tune`` predicts the table,
the controller looks it up.
"""

from collections.abc import Sequence

__all__ = ['feedback_acceptable_below_hz']


def feedback_acceptable_below_hz(
    amplitudes_um: Sequence[float], frequencies_hz: Sequence[float], amplitude_um: float,
) -> float:
    """
    Return the frequency of a scan below which feedback is acceptable.

    Parameters
    ----------
    amplitudes_um : sequence of float, length N
        Amplitudes of the table, ascending; one alone stands for every amplitude.
    frequencies_hz : sequence of float, length N
        Frequency below which feedback is acceptable at each of them.
    amplitude_um : float
        Amplitude of the scan.

    Returns
    -------
    float
        On a straight line between the two nearest amplitudes; that of the nearest one beyond all.

    """
    above = 0
    while above < len(amplitudes_um) and amplitudes_um[above] <= amplitude_um:
        above += 1
    if above == 0:
        return frequencies_hz[0]
    if above == len(amplitudes_um):
        return frequencies_hz[-1]
    low_um, high_um = amplitudes_um[above - 1], amplitudes_um[above]
    low_hz, high_hz = frequencies_hz[above - 1], frequencies_hz[above]
    return low_hz + (amplitude_um - low_um) / (high_um - low_um) * (high_hz - low_hz)
