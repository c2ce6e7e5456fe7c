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
The output of a card wired to its input: whole-sample delay and gain, by a pseudo-random block.

With the block u[k] = +-A and the readings y[k], offset removed, the delay is the d with the largest
correlation between y[k+d] and u[k], and there::

    gain = sum u[k] y[k+d] / sum u[k]^2,   residual = y[k+d] - gain u[k]

A card and its driver are in order where d is 1 and the residual is its resolution.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.hardware.device import Device

__all__ = ['Loopback', 'measure_loopback', 'pseudo_random_block']

_MOST_DELAY: Final = 64
_LEAST_CORRELATION: Final = 0.9
_REST: Final = 16  # samples at zero before and behind


@dataclass(frozen=True)
class Loopback:
    """
    What came back of a block.

    Attributes
    ----------
    delay_samples : int
        From a voltage to the reading that answers it.
    gain : float
        Volts at the input for each volt at the output.
    offset_v : float
        Volts at the input at zero deviation.
    residual_v : float
        Root mean square of what delay, gain and offset do not explain.
    correlation : float
        Of the readings with the block at that delay, 0 … 1.

    """

    delay_samples: int
    gain: float
    offset_v: float
    residual_v: float
    correlation: float

    @property
    def problem(self) -> str:
        """What is wrong, '' for nothing."""
        if not self.correlation >= _LEAST_CORRELATION:
            return (
                f'the readings hardly follow the output: correlation {self.correlation:.3f}, '
                f'allowed is {_LEAST_CORRELATION} … 1; is the output wired to the input?')
        if self.delay_samples != 1:
            return (
                f'a reading answers the voltage of {self.delay_samples} samples before, it must '
                'be 1: something between output and input is slow, or input and output do not '
                'share their clock')
        return ''


def pseudo_random_block(amplitude_v: float, samples: int, seed: int = 1) -> NDArray[np.float64]:
    """Return +-A in pseudo-random order, shape (N,), with zeros before and behind."""
    signs = np.random.default_rng(seed).integers(0, 2, samples) * 2 - 1
    return np.concatenate([np.zeros(_REST), amplitude_v * signs, np.zeros(_REST)])


def measure_loopback(
    device: Device, amplitude_v: float, samples: int, sensor_scale_um_per_v: float,
) -> Loopback:
    """
    Play a pseudo-random block on a device that is open and at rest, and compare.

    Parameters
    ----------
    device : Device
        The device, its output wired to its input, no amplifier connected: the block is steps.
    amplitude_v : float
        Deviation of the output, volts.
    samples : int
        Length of the block.
    sensor_scale_um_per_v : float
        By which the device makes micrometres of the volts at its input.

    Raises
    ------
    DeviceError
        If the device fails.

    """
    voltage_v = pseudo_random_block(amplitude_v, samples)
    input_v = device.play(voltage_v) / sensor_scale_um_per_v
    centred_v = input_v - input_v.mean()
    counts = [
        min(voltage_v.size, input_v.size - delay) for delay in range(min(_MOST_DELAY, samples))]
    scores = [
        float(voltage_v[:count] @ centred_v[delay:delay + count])
        for delay, count in enumerate(counts)]
    delay = int(np.argmax(np.abs(scores)))
    count = counts[delay]
    asked_v, came_v = voltage_v[:count], input_v[delay:delay + count]
    table = np.column_stack([asked_v, np.ones(count)])
    (gain, offset_v), *_ = np.linalg.lstsq(table, came_v, rcond=None)
    residual_v = came_v - table @ np.array([gain, offset_v])
    spread = float(np.sqrt(np.mean((came_v - came_v.mean())**2)))
    rest = float(np.sqrt(np.mean(residual_v**2)))
    explained = 1.0 - (rest / spread)**2 if spread > 0.0 else 0.0
    return Loopback(
        delay, float(gain), float(offset_v), rest, float(np.sqrt(max(explained, 0.0))))
