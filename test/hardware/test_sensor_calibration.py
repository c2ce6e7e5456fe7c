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

import numpy as np
import pytest

from piezo_ros.hardware.calibration import (
    Calibration,
    deviation_v,
    displacement_um,
    output_v,
    sensor_v,
    two_point_calibration,
)
from piezo_ros.model.parameters import ParameterError

CALIBRATION = Calibration(
    operating_point_v=4.5, sensor_scale_um_per_v=-2.4, sensor_offset_v=0.3)


def test_zero_deviation_is_the_operating_point():
    assert output_v(CALIBRATION, np.zeros(1)) == [4.5]
    assert displacement_um(CALIBRATION, np.array([0.3])) == [0.0]


def test_the_ways_back_undo_the_ways_out():
    values = np.linspace(-3.0, 3.0, 11)
    np.testing.assert_allclose(
        [deviation_v(CALIBRATION, value) for value in output_v(CALIBRATION, values)], values,
        atol=1e-12)
    np.testing.assert_allclose(
        displacement_um(CALIBRATION, sensor_v(CALIBRATION, values)), values, atol=1e-12)


def test_two_points_give_back_the_calibration():
    volts = sensor_v(CALIBRATION, np.array([1.0, 9.0]) - 6.0)
    scale, offset = two_point_calibration(
        volts[0], 1.0, volts[1], 9.0, operating_point_um=6.0)
    assert (scale, offset) == pytest.approx((-2.4, 0.3))


@pytest.mark.parametrize(('points', 'told'), [
    ((1.0, 0.0, 1.0, 12.0), 'first_v and second_v are both 1.0'),
    ((0.0, 3.0, 1.0, 3.0), 'first_um and second_um are both 3.0'),
    ((np.nan, 3.0, 1.0, 3.0), 'first_v is nan'),
])
def test_points_that_tell_nothing_are_refused(points, told):
    with pytest.raises(ValueError, match=told):
        two_point_calibration(*points, operating_point_um=6.0)


def test_a_sensor_without_scale_is_refused():
    with pytest.raises(ParameterError, match='sensor_scale_um_per_v is 0.0'):
        Calibration(sensor_scale_um_per_v=0.0)
