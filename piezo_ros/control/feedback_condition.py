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
The feedback acceptable condition as a table: where feedback lessens the error of feedforward.

(15), (16) and (18) in Liu 2015::

    E_fbff = E_ff S,   S = 1 / (1 + K G),   feedback helps where abs(S(i w)) < 1

This gives one frequency. The limits of the amplifier and the errors of the models make it a
frequency for each amplitude, as in Table 3. ``piezo tune`` predicts the table, the controller looks
it up.
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

    Examples
    --------
    >>> feedback_acceptable_below_hz((1.0, 2.0), (600.0, 400.0), 1.5)
    500.0
    >>> feedback_acceptable_below_hz((1.0, 2.0), (600.0, 400.0), 5.0)
    400.0

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
