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

"""Samples at the limits of the amplifier, beside those that the simulated rig counts itself."""

import numpy as np
import pytest

from piezo_ros.model import RigParameters
from piezo_ros.model.simulated_rig import Rig
from piezo_ros.report.amplifier_use import amplifier_limits, limited_samples


@pytest.mark.parametrize('seed', range(4))
@pytest.mark.parametrize('values', [
    {'slew_limit_v_per_s': 2e4}, {'slew_limit_v_per_s': 2e4, 'dac_bits': 0},
    {'slew_limit_v_per_s': 0.0}, {'slew_limit_v_per_s': 5e3, 'operating_point_v': 1.0}])
def test_the_counts_are_those_of_the_rig(seed, values):
    generator = np.random.default_rng(seed)
    steps = generator.normal(0.0, 0.2, 3000)
    voltage_v = np.clip(np.cumsum(steps), -9.0, 9.0) * generator.integers(0, 2)
    voltage_v += 4.0 * np.sin(np.arange(3000) / 40.0)
    voltage_v[0] = 0.0
    parameters = RigParameters(**values)
    rig = Rig(parameters, 1e-5, compiled=False)
    rig.run(voltage_v)
    at_rails, slewing = limited_samples(
        voltage_v, amplifier_limits(parameters.to_mapping()), 1e-5)
    assert (at_rails.sum(), slewing.sum()) == rig.saturated_samples


def test_a_stretch_counts_from_the_voltage_at_its_begin():
    limits = amplifier_limits(RigParameters(slew_limit_v_per_s=1e4, dac_bits=0).to_mapping())
    _, slewing = limited_samples(np.array([2.0, 2.0, 2.25, 2.25, 2.25]), limits, 1e-5)
    assert slewing.tolist() == [False, False, True, True, False]


@pytest.mark.parametrize('plant', [
    {}, {'gain': 2.0},
    {'voltage_minimum_v': 'low', 'voltage_maximum_v': 1, 'operating_point_v': 0}])
def test_a_foreign_plant_tells_no_limits(plant):
    assert amplifier_limits(plant) is None


def test_a_slew_limit_of_hardware_that_is_not_told_is_not_known():
    plant = {'device': 'x', 'voltage_minimum_v': -2.0, 'voltage_maximum_v': 10.0,
             'operating_point_v': 5.0}
    assert amplifier_limits(plant).slew_limit_v_per_s is None
    assert amplifier_limits({**plant, 'slew_limit_v_per_s': 7.0}).slew_limit_v_per_s == 7.0
