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

"""What a control law of one's own returns is looked at before it goes on."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from piezo_ros.control import ControlLaw, ControllerParameters
from piezo_ros.control.control_law import check_command
from piezo_ros.control.pi_controller import PiController


class Law(ControlLaw):
    pass


def test_one_finite_command_for_each_sample_is_taken():
    check_command(Law, 0, np.array([1.0, -2.0]), 2)


@pytest.mark.parametrize('returned', [
    np.zeros(3), np.zeros((2, 1)), [0.0, 0.0], 0.0, None])
def test_another_shape_is_refused(returned):
    with pytest.raises(ValueError, match=r'Law\.answer returned .* at sample 7, .* \(2,\)'):
        check_command(Law, 7, returned, 2)


@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_refused_and_its_sample_named(value):
    with pytest.raises(ValueError, match=rf'{value} at sample 11, it must be finite'):
        check_command(Law, 10, np.array([0.0, value, 0.0]), 3)


def test_our_own_controller_is_one():
    assert isinstance(PiController(ControllerParameters(), 1e-5, compiled=False), ControlLaw)


def test_a_law_without_an_answer_says_so():
    with pytest.raises(NotImplementedError):
        Law(ControllerParameters(), 1e-5).answer(0, *np.zeros((3, 1)))


def test_the_law_of_the_tutorial_is_one_and_integrates_the_error():
    pytest.importorskip('rclpy')
    example = Path(__file__).parents[2] / 'docs' / 'examples' / 'integral_law.py'
    law = runpy.run_path(str(example))['IntegralLaw'](
        ControllerParameters(integral_gain_per_s=100.0), 1e-3)
    assert isinstance(law, ControlLaw)
    error_um = np.array([1.0, 2.0, -3.0])
    for start in (0, 3):
        command_um = law.answer(start, error_um, np.zeros(3), np.zeros(3))
        check_command(type(law), start, command_um, 3)
        np.testing.assert_allclose(command_um, [0.1, 0.3, 0.0], atol=1e-15)
