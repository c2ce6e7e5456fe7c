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

import math

import numpy as np
import pytest

from piezo_ros.hardware.device import Refused
from piezo_ros.hardware.limits import (
    DriveLimits,
    block_figures,
    refuse_beyond_limits,
    refuse_beyond_rails,
)
from piezo_ros.model.parameters import ParameterError

TS = 1e-5
C = 6e-6


def figures(voltage_v, held_v=0.0, sample_period_s=TS, **limits):
    found = block_figures(voltage_v, held_v, sample_period_s, DriveLimits(**limits))
    return {figure.name: figure for figure in found}


def test_a_block_within_every_limit_passes():
    refuse_beyond_limits(
        np.linspace(0.0, 1.0, 1000), 0.0, TS, DriveLimits(
            gain_um_per_v=1.2, slew_limit_v_per_s=200.0, load_capacitance_f=C))


def test_the_currents_of_a_sine_are_those_of_the_data_sheet():
    frequency_hz, amplitude_v = 100.0, 0.5
    t = np.arange(1, 50_001) * TS
    found = figures(
        amplitude_v * np.sin(2.0 * math.pi * frequency_hz * t), load_capacitance_f=C)
    upp = 10.0 * 2.0 * amplitude_v
    assert found['peak current'].value == pytest.approx(math.pi * frequency_hz * C * upp, rel=1e-4)
    assert found['average current'].value == pytest.approx(frequency_hz * C * upp, rel=1e-3)


def test_the_currents_of_a_triangle_are_those_of_the_data_sheet():
    t = np.arange(50_000) * TS
    found = figures(2.0 * np.abs((100.0 * t) % 1.0 - 0.5), held_v=1.0, load_capacitance_f=C)
    assert found['peak current'].value == pytest.approx(2.0 * 100.0 * C * 10.0, rel=1e-6)
    assert found['average current'].value == pytest.approx(100.0 * C * 10.0, rel=1e-3)


def test_the_average_slides_and_is_of_the_larger_direction():
    # Falls for 0.1 s, in the middle of the block; what is sunk counts as well.
    block_v = np.concatenate(
        [np.zeros(20_000), np.linspace(0.0, -1.0, 10_001)[1:], np.full(20_000, -1.0)])
    figure = figures(block_v, load_capacitance_f=C)['average current']
    assert figure.value == pytest.approx(C * 10.0 * 1.0 / 0.1, rel=1e-9)
    assert figure.sample == 29_999


def test_a_short_block_has_the_average_of_its_window():
    figure = figures([1.0], load_capacitance_f=C)['average current']
    assert figure.value == pytest.approx(C * 10.0 * 1.0 / 0.1)


def test_the_step_from_what_is_held_counts():
    block_v = np.full(10, 0.5)
    assert figures(block_v, held_v=0.5, slew_limit_v_per_s=100.0)['slew'].value == 0.0
    with pytest.raises(Refused, match=r'sample 0: slew is 5e\+04 V/s, allowed is at most 100 V/s'):
        refuse_beyond_limits(block_v, 0.0, TS, DriveLimits(slew_limit_v_per_s=100.0))


def test_a_slew_at_its_limit_is_allowed():
    block_v = np.cumsum(np.full(1000, 1e-3))
    refuse_beyond_limits(block_v, 0.0, TS, DriveLimits(slew_limit_v_per_s=100.0))
    with pytest.raises(Refused, match='slew is 100 V/s, allowed is at most 99.9 V/s'):
        refuse_beyond_limits(block_v, 0.0, TS, DriveLimits(slew_limit_v_per_s=99.9))


@pytest.mark.parametrize(('value_v', 'told'), [
    (5.2, 'sample 3: amplifier input is 10.2 V, allowed is -2 … 10 V'),
    (-7.5, 'sample 3: amplifier input is -2.5 V, allowed is -2 … 10 V'),
])
def test_a_voltage_beyond_a_rail_is_named(value_v, told):
    with pytest.raises(Refused, match=told):
        refuse_beyond_limits([0.0, 0.0, 0.0, value_v, 0.0], 0.0, TS, DriveLimits())


def test_a_displacement_beyond_the_travel_is_named():
    with pytest.raises(Refused, match='sample 1: displacement is 12.6 um, allowed is at most 12'):
        refuse_beyond_limits([0.0, 3.0], 0.0, TS, DriveLimits(gain_um_per_v=2.2))
    assert 'displacement' not in figures([0.0])


def test_every_figure_beyond_its_limit_is_named_at_once():
    with pytest.raises(Refused) as caught:
        refuse_beyond_limits([0.0, 8.0], 0.0, TS, DriveLimits(
            gain_um_per_v=1.2, slew_limit_v_per_s=1.0, load_capacitance_f=C))
    for name in ('amplifier input', 'displacement', 'slew', 'peak current'):
        assert name in str(caught.value)


def test_unknown_limits_have_no_figure():
    assert [*figures([0.0])] == ['amplifier input']


@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf])
def test_a_value_that_is_not_finite_is_named(value):
    with pytest.raises(Refused, match=r'voltage_v\[2\] is .* allowed is any finite value'):
        block_figures([0.0, 0.0, value], 0.0, TS, DriveLimits())
    with pytest.raises(Refused, match='held_v is'):
        block_figures([0.0], value, TS, DriveLimits())
    with pytest.raises(Refused, match=r'u\[0\] is'):
        refuse_beyond_rails('card', 'u', [value], -math.inf, math.inf)


def test_an_operating_point_outside_the_rails_is_refused():
    with pytest.raises(ParameterError, match='operating_point_v is 11.0'):
        DriveLimits(operating_point_v=11.0)
