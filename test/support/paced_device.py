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
A device with a clock: the simulated one, played by the wall clock, with a log of its output.

As ``device: paced_device:PacedDevice``; ``address`` is the file that the output is logged to, as
float64, and ``output_channel`` may be ``held VOLTAGE`` for what it holds at first, or
``gone AFTER_READS``, or ``stuck READING``, or ``raises AFTER_READS``, an error that is none of a
device; some of them by commas.
"""

import time
from typing import ClassVar

import numpy as np

from piezo_ros.hardware.device import Gone, Underflow
from piezo_ros.hardware.ramp import ramp_voltage
from piezo_ros.hardware.simulated import SimulatedDevice, SimulatedDeviceParameters

__all__ = ['PacedDevice']


class PacedDevice:
    devices: ClassVar[list] = []  # every one that was made, the newest last

    def __init__(self, values):
        names = SimulatedDeviceParameters.names()
        own = {name: value for name, value in values.items() if name in names}
        asked = dict(
            word.split(' ') for word in values['output_channel'].split(',') if ' ' in word)
        if 'held' in asked:
            own['held_v'] = float(asked['held'])
        self._reads_left = int(asked['gone']) if 'gone' in asked else None
        self._reads_that_go_well = int(asked.get('raises', 1 << 60))
        self._stuck_um = float(asked['stuck']) if 'stuck' in asked else None
        self._inner = SimulatedDevice(SimulatedDeviceParameters(**own), compiled=False)
        self.constraints = self._inner.constraints
        self._file = values['address']
        self._output = [self._inner.parameters.held_v]
        self._stream_v = None
        self.is_closed = False
        PacedDevice.devices.append(self)

    @property
    def output(self):
        """Everything that the output was, from what it held at first."""
        return np.array(self._output)

    def _log(self, voltage_v):
        self._output.extend(voltage_v)
        if self._file:
            with open(self._file, 'ab') as file:
                file.write(np.asarray(voltage_v, np.float64).tobytes())

    def open(self, sample_period_s):
        self._period_s = sample_period_s
        period_s = self._inner.open(sample_period_s)
        self._log([self._inner.hold()])
        return period_s

    def _alive(self):
        if self._reads_left is not None and self._reads_left <= 0:
            raise Gone('paced device at made-up address: it does not answer; switch it on')

    def hold(self):
        self._alive()
        return self._output[-1] if self._stream_v is not None else self._inner.hold()

    def reading(self):
        self._alive()
        return self._inner.reading()

    def set_output(self, voltage_v):
        self._alive()
        self._inner.set_output(voltage_v)
        self._log([voltage_v])

    def ramp_to(self, voltage_v, slew_v_per_s):
        self._alive()
        if self._stream_v is not None:
            reached = self._tick()
            if reached + 1 > self._fetched:
                self._inner.read(reached + 1 - self._fetched)
            self._stream_v = None
        self._log(ramp_voltage(self._output[-1], voltage_v, slew_v_per_s, self._period_s))
        self._inner.ramp_to(voltage_v, slew_v_per_s)

    def play(self, voltage_v):
        self._alive()
        readings_um = self._inner.play(voltage_v)
        self._log(voltage_v)
        return self._shown(readings_um)

    def _shown(self, readings_um):
        if self._stuck_um is None:
            return readings_um
        return np.full_like(readings_um, self._stuck_um)

    def start(self, prefill_v):
        self._alive()
        self._inner.start(prefill_v)
        self._stream_v = [*prefill_v]
        self._fetched = self._logged = 0
        self._is_finished = False
        self._began_s = time.monotonic()

    def _tick(self):
        """Let the output go where it is by now; return how many voltages have gone out."""
        due = int((time.monotonic() - self._began_s) / self._period_s)
        due = min(due, len(self._stream_v))
        if due > self._logged:
            self._log(self._stream_v[self._logged:due])
            self._logged = due
        return self._logged

    def _has_run_dry(self):
        due = int((time.monotonic() - self._began_s) / self._period_s)
        return due > len(self._stream_v) and not self._is_finished

    def write(self, voltage_v):
        self._alive()
        if self._has_run_dry():
            raise self._ran_dry()
        self._inner.write(voltage_v)
        self._stream_v.extend(voltage_v)

    def _ran_dry(self):
        index = len(self._stream_v)
        return Underflow(f'paced device: the output ran out of samples at index {index}', index)

    def read(self, samples):
        self._alive()
        if self._reads_left is not None:
            self._reads_left -= 1
        self._reads_that_go_well -= 1
        if self._reads_that_go_well < 0:
            raise RuntimeError('made up, in a reading')
        last = self._fetched + samples - 1
        while time.monotonic() < self._began_s + last * self._period_s:
            time.sleep(1e-4)
        self._tick()
        if last > len(self._stream_v):
            raise self._ran_dry()
        self._fetched += samples
        readings_um = self._shown(self._inner.read(samples))
        if self._is_finished and self._fetched == len(self._stream_v) + 1:
            self._tick()
            self._stream_v = None
        return readings_um

    def generated(self):
        self._alive()
        return self._tick()

    def finish(self):
        self._inner.finish()
        self._is_finished = True

    def close(self):
        self.is_closed = True
        self._inner.close()
