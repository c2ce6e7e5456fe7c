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

"""The linear loop of the paper, Table 2 and (19), by python-control and plain complex numbers."""

import control
import numpy as np
import pytest
from scipy.optimize import brentq

from piezo_ros import paper
from piezo_ros.control import ControllerParameters
from piezo_ros.model import LinearDynamics

GAINS = ControllerParameters()
DYNAMICS = LinearDynamics()
FREQUENCY_HZ = np.geomspace(0.1, 2e4, 200_000)


def loop(frequency_hz):
    s = 2j * np.pi * np.asarray(frequency_hz)
    return DYNAMICS.response(frequency_hz) * (
        GAINS.proportional_gain + GAINS.integral_gain_per_s / s)


def sensitivity(frequency_hz):
    return 1 / (1 + loop(frequency_hz))


def complementary(frequency_hz):
    return loop(frequency_hz) / (1 + loop(frequency_hz))


def bound(frequency_hz):
    s = 2j * np.pi * frequency_hz
    w = paper.UNCERTAINTY_BOUND
    return w['gain'] * (s + w['zero_rad_per_s']) ** 2 / (
        (s + w['pole_1_rad_per_s']) * (s + w['pole_2_rad_per_s']))


def test_feedback_is_acceptable_up_to_425_hz():
    crossing_hz = brentq(lambda f: abs(sensitivity([f])[0]) - 1, 100.0, 1000.0)
    assert crossing_hz == pytest.approx(425.2, abs=0.5)
    below = FREQUENCY_HZ[FREQUENCY_HZ < crossing_hz - 1]
    assert np.abs(sensitivity(below)).max() < 1.0


def test_the_loop_is_robust_against_the_published_uncertainty():
    worst = np.abs(bound(FREQUENCY_HZ) * complementary(FREQUENCY_HZ)).max()
    assert worst == pytest.approx(0.207, abs=0.002)
    assert abs(bound(0.0)) == pytest.approx(0.0645, abs=1e-4)


def test_the_largest_sensitivity_is_that_of_the_paper():
    assert np.abs(sensitivity(FREQUENCY_HZ)).max() == pytest.approx(1.393, abs=0.001)


def test_the_margins_are_those_of_the_paper():
    s = control.tf('s')
    controller = GAINS.proportional_gain + GAINS.integral_gain_per_s / s
    gain_margin, phase_margin_deg, *_ = control.margin(controller * DYNAMICS.transfer_function)
    assert gain_margin == pytest.approx(5.22, abs=0.01)
    assert phase_margin_deg == pytest.approx(64.2, abs=0.1)


def test_the_closed_loop_reaches_705_hz():
    assert brentq(
        lambda f: abs(complementary([f])[0]) - np.sqrt(0.5), 300.0, 2000.0
    ) == pytest.approx(705.0, abs=1.0)
