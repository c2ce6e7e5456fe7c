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

"""The loopback tells delay, gain and offset of a wire, and what is no wire."""

import numpy as np
import pytest

from piezo_ros.hardware.checks.loopback import measure_loopback
from piezo_ros.hardware.simulated import SimulatedDevice

SCALE = 1.2


class Wire:
    """Readings of the output itself, some samples later, in micrometres of the sensor."""

    def __init__(self, delay=1, gain=1.0, offset_v=0.0, noise_v=0.0):
        self.delay, self.gain, self.offset_v, self.noise_v = delay, gain, offset_v, noise_v

    def play(self, voltage_v):
        came_v = np.zeros(len(voltage_v) + 1)
        came_v[self.delay:] = self.gain * np.asarray(voltage_v)[:came_v.size - self.delay]
        noise_v = self.noise_v * np.random.default_rng(2).standard_normal(came_v.size)
        return SCALE * (came_v + self.offset_v + noise_v)


@pytest.mark.parametrize('delay', [1, 2, 7])
@pytest.mark.parametrize(('gain', 'offset_v', 'noise_v'), [
    (1.0, 0.0, 0.0), (0.25, 3.0, 1e-3), (-1.1, -0.2, 1e-3)])
def test_a_wire_is_measured(delay, gain, offset_v, noise_v):
    found = measure_loopback(Wire(delay, gain, offset_v, noise_v), 0.5, 1000, SCALE)
    assert found.delay_samples == delay
    assert found.gain == pytest.approx(gain, abs=1e-3)
    assert found.offset_v == pytest.approx(offset_v, abs=1e-3)
    assert found.residual_v == pytest.approx(noise_v, rel=0.1, abs=1e-12)
    assert ('share their clock' in found.problem) == (delay != 1)


def test_noise_alone_is_no_wire():
    found = measure_loopback(Wire(gain=0.0, noise_v=0.1), 0.5, 1000, SCALE)
    assert 'wired to the input' in found.problem


def test_a_dead_input_is_no_wire():
    assert 'wired to the input' in measure_loopback(Wire(gain=0.0), 0.5, 1000, SCALE).problem


def test_a_stage_is_no_wire():
    device = SimulatedDevice(compiled=False)
    device.open(1e-5)
    assert measure_loopback(device, 0.5, 1000, SCALE).problem
