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
The voltage that brings the hysteresis back to its virgin state: a triangle that dies away.

Period j = 0 ... n - 1 of n has the peak u_j = u_0 (1 - j / n), and all have the same frequency.
"""

from piezo_ros.control.waveform import WaveformParameters, reference_step, waveform_constants

__all__ = ['demagnetising_voltage']


def demagnetising_voltage(
    amplitude_v: float, levels: int, slew_v_per_s: float, sample_period_s: float,
) -> list[float]:
    """
    Return a triangle of decreasing periods, from the full amplitude to nothing.

    Every element of the hysteresis that the first period saturates is left near its middle, where
    the inverse model assumes it: the more levels, the nearer.

    Parameters
    ----------
    amplitude_v : float
        Peak of the first period, volts.
    levels : int
        Number of periods, each smaller than the one before by the same amount.
    slew_v_per_s : float
        Slope of the first period, volts per second.
    sample_period_s : float
        Sample period, seconds.

    Returns
    -------
    list of float
        Voltage, volts, deviation from the operating point; the last one is 0.

    Examples
    --------
    >>> voltage_v = demagnetising_voltage(2.0, 2, 1.0, 1.0)
    >>> len(voltage_v), max(voltage_v), voltage_v[-1]
    (17, 2.0, 0.0)

    """
    # At least 8 samples a period, whatever the slope.
    frequency_hz = min(slew_v_per_s / (4.0 * amplitude_v), 0.125 / sample_period_s)
    waveform = WaveformParameters(
        waveform='decreasing_triangle', output='voltage', amplitude_v=amplitude_v,
        frequency_hz=frequency_hz, periods=float(levels), sample_period_s=sample_period_s)
    constants = waveform_constants(waveform)
    turns = [constants.turns_per_sample * index for index in range(waveform.samples)]
    return [*(reference_step(constants, turn) for turn in turns), 0.0]
