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

"""A device of one's own: blocks alone, a file for the output, a made-up stage for the sensor."""

import math
import pathlib

import numpy as np

from piezo_ros.hardware.device import DeviceConstraints, Refused, refuse_other_rate
from piezo_ros.hardware.ramp import ramp_voltage

GAIN_UM_PER_V, LOW_V, HIGH_V, MOST = 1.2, -5.0, 5.0, 500_000


class FileDevice:
    """A converter that plays one finite block at a time, as a sound card does."""

    def __init__(self, values):
        # `address` and all other parameters of the hardware plant are there.
        self.log = pathlib.Path(values['address'] or 'output.f64')
        self.held_v, self.period_s = 0.0, 0.0
        self.constraints = DeviceConstraints(
            lowest_rate_hz=1.0, highest_rate_hz=192e3, lowest_voltage_v=LOW_V,
            highest_voltage_v=HIGH_V, most_samples=MOST, streams=False, buffer_samples=None,
            identity=f'file {self.log}, no serial number')

    def open(self, sample_period_s):
        rate_hz = min(1.0 / sample_period_s, self.constraints.highest_rate_hz)
        refuse_other_rate('file device', sample_period_s, rate_hz)
        self.period_s = sample_period_s
        return sample_period_s

    def hold(self):
        return self.held_v

    def reading(self):
        return GAIN_UM_PER_V * self.held_v

    def set_output(self, voltage_v):
        self.play([voltage_v])

    def ramp_to(self, voltage_v, slew_v_per_s):
        self.play(ramp_voltage(self.held_v, voltage_v, slew_v_per_s, self.period_s))

    def play(self, voltage_v):
        block_v = np.array(voltage_v, dtype=np.float64)
        if not 1 <= block_v.size <= MOST:
            raise Refused(f'file device: {block_v.size} voltages, allowed are 1 … {MOST}')
        for index, value_v in enumerate(block_v.tolist()):
            if not (math.isfinite(value_v) and LOW_V <= value_v <= HIGH_V):
                raise Refused(
                    f'file device: voltage_v[{index}] is {value_v} V, allowed is {LOW_V:g} … '
                    f'{HIGH_V:g} V')
        with self.log.open('ab') as file:  # a driver hands the block to its converter here
            file.write(block_v.tobytes())
        readings_um = GAIN_UM_PER_V * np.append(self.held_v, block_v)
        self.held_v = float(block_v[-1])
        return readings_um

    def _no_streams(self, *_):
        raise Refused('file device: it plays finite blocks alone')

    start = write = read = generated = finish = _no_streams

    def close(self):
        pass
