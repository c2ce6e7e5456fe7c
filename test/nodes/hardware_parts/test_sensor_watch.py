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

"""A sensor that shows the same whatever the voltage is noticed, and no other."""

import numpy as np
import pytest

from piezo_ros.hardware.device import Refused
from piezo_ros.nodes.hardware_parts.sensor_watch import SensorWatch

REACH_V = 5.0


def watch(voltage_v, displacement_um, block):
    sensor = SensorWatch(REACH_V)
    sensor.play(voltage_v)
    for first in range(0, displacement_um.size, block):
        sensor.check(displacement_um[first:first + block])


@pytest.mark.parametrize('block', [1, 7, 1000])
def test_equal_readings_under_a_moving_voltage_are_refused(block):
    with pytest.raises(Refused, match=r'shows 2 um in \d+ readings, while the voltage went from 0'):
        watch(np.linspace(0.0, 3.0, 1000), np.full(1000, 2.0), block)


@pytest.mark.parametrize(('voltage_v', 'displacement_um'), [
    (np.zeros(1000), np.full(1000, 2.0)),  # at rest
    (np.linspace(0.0, 0.2, 1000), np.full(1000, 2.0)),  # within the resolution of a coarse sensor
    (np.linspace(0.0, 3.0, 1000), np.linspace(0.0, 3.0, 1000)),
    # A converter at the end of its range, which it has left before.
    (np.linspace(0.0, 3.0, 1000), np.minimum(np.linspace(0.0, 3.0, 1000), 0.01)),
    (np.linspace(0.0, 3.0, 100), np.full(100, 2.0)),  # too few to tell
])
def test_other_readings_are_taken(voltage_v, displacement_um):
    watch(voltage_v, displacement_um, 50)


def test_a_long_rest_before_a_noiseless_sensor_is_kept_as_two_numbers():
    sensor = SensorWatch(REACH_V)
    for _ in range(2000):
        sensor.play(np.zeros(1000))
        sensor.check(np.full(1000, 2.0))
    kept = [value for value in vars(sensor).values() if isinstance(value, list)]
    assert sum(map(len, kept)) == 0
    sensor.play(np.linspace(0.0, 1.0, 1000))
    with pytest.raises(Refused, match='in 2001000 readings, while the voltage went from 0 to 1 V'):
        sensor.check(np.full(1000, 2.0))


def test_voltages_ahead_of_the_readings_do_not_count_yet():
    sensor = SensorWatch(REACH_V)
    sensor.play(np.append(np.zeros(300), np.linspace(0.0, 3.0, 300)))
    sensor.check(np.full(300, 2.0))
    with pytest.raises(Refused):
        sensor.check(np.full(300, 2.0))
