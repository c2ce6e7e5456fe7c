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
from hypothesis import given
from hypothesis import strategies as st

from piezo_ros.model import RigParameters
from piezo_ros.model.converter import convert_step, converter_constants
from piezo_ros.model.rig import rig_constants

finite = st.floats(-1e6, 1e6)


def test_an_ideal_converter_only_clips():
    converter = converter_constants(-2.0, 10.0, 20.0, 0, 5.0)
    assert convert_step(converter, 1.2345) == pytest.approx(1.2345, abs=1e-15)
    assert convert_step(converter, 6.0) == 5.0
    assert convert_step(converter, -8.0) == -7.0


@given(finite, st.integers(4, 24))
def test_what_comes_out_is_a_step_of_the_converter_no_further_than_half_of_one(value, bits):
    converter = converter_constants(-10.0, 10.0, 20.0, bits, 0.0)
    step = 20.0 / 2**bits
    out = convert_step(converter, value)
    assert (out / step).is_integer()
    assert -10.0 <= out <= 10.0
    assert abs(out - min(max(value, -10.0), 10.0)) <= step / 2


@given(finite, st.floats(0.0, 10.0))
def test_more_in_is_never_less_out(value, more):
    converter = converter_constants(-2.0, 10.0, 20.0, 8, 5.0)
    assert convert_step(converter, value + more) >= convert_step(converter, value)


@given(finite)
def test_what_came_out_once_passes_unchanged(value):
    converter = converter_constants(-10.0, 10.0, 20.0, 16, 5.0)
    once = convert_step(converter, value)
    assert convert_step(converter, once) == pytest.approx(once, abs=1e-12)


def test_the_rig_has_the_converters_of_the_paper():
    constants = rig_constants(RigParameters(), 1e-5)
    assert constants.dac.resolution == 20.0 / 2**16
    assert constants.adc.resolution == pytest.approx(24.0 / 2**18)  # um
    readings = {convert_step(constants.adc, value) for value in np.linspace(0.0, 1e-3, 1000)}
    assert 10 <= len(readings) <= 13


def test_rounding_does_not_carry_the_voltage_beyond_a_rail():
    converter = converter_constants(-2.0, 10.0, 20.0, 16, 5.0)
    assert convert_step(converter, -7.0001) == -7.0
    assert convert_step(converter, 5.0001) == 5.0
