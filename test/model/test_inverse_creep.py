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

"""The inverse of creep: exact, the same bits in Python and compiled, nothing when off."""

import numpy as np
import pytest

from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.control.closed_loop import run_loop
from piezo_ros.model import (
    CompensatorParameters,
    HysteresisParameters,
    InverseHysteresis,
    RigParameters,
)
from piezo_ros.model.creep import CreepParameters, creep_constants, creep_step, inverse_creep_step

CREEP = {'creep_per_decade': 0.03, 'creep_start_s': 0.005, 'creep_end_s': 50.0}
IDEAL = {'noise_rms_um': 0.0, 'dac_bits': 0, 'adc_bits': 0, 'sensor_scale_um_per_v': 1e3}


@pytest.mark.parametrize('period_s', [1e-5, 1e-3, 0.5])
def test_the_round_trip_is_exact(period_s):
    constants = creep_constants(CreepParameters(**CREEP), period_s)
    there, back = ([0.0] * len(constants.rate) for _ in range(2))
    wanted_um = np.random.default_rng(3).normal(size=2000).cumsum()
    got_um = [
        creep_step(back, constants, inverse_creep_step(there, constants, value))
        for value in wanted_um.tolist()]
    np.testing.assert_allclose(got_um, wanted_um, rtol=0, atol=1e-13 * np.abs(wanted_um).max())


def test_python_and_compiled_code_have_the_same_bits_in_any_blocks():
    parameters = CompensatorParameters(**CREEP)
    command_um = np.sin(np.arange(700) / 40.0)
    whole = InverseHysteresis(parameters, 1e-3, compiled=False).answer(0, command_um)
    element = InverseHysteresis(parameters, 1e-3)
    parts = [element.answer(k, command_um[k:k + 100]) for k in range(0, 700, 100)]
    assert np.concatenate(parts).tobytes() == whole.tobytes()


def test_off_not_a_bit_changes():
    command_um = np.sin(np.arange(700) / 40.0)
    for compiled in (False, True):
        with_set = InverseHysteresis(CompensatorParameters(), compiled=compiled)
        without = InverseHysteresis(HysteresisParameters(), compiled=compiled)
        assert not with_set.inverts_creep
        assert with_set.memory.tobytes() == without.memory.tobytes()
        assert with_set.answer(0, command_um).tobytes() == without.answer(0, command_um).tobytes()


def run_of(plant, compensator, scheme='ff'):
    still_um = np.concatenate([np.linspace(0.0, 2.0, 200), np.full(9800, 2.0)])
    return run_loop(
        RigParameters(**IDEAL, **plant), compensator,
        ControllerParameters(scheme=scheme, integral_gain_per_s=100.0, proportional_gain=0.0),
        1e-3, still_um, still_um / TrajectoryParameters().dc_gain)


def test_it_holds_a_creeping_stage_still():
    bare = run_of(CREEP, HysteresisParameters())
    held = run_of(CREEP, CompensatorParameters(**CREEP))
    assert np.ptp(bare.displacement_um[300:]) > 0.05
    # What is left is that the creep of the rig is that of a substep of the sample.
    assert np.ptp(held.displacement_um[300:]) < 1e-3
    assert np.ptp(held.voltage_v[300:]) > 0.05


def test_with_feedback_the_creep_is_gone_with_or_without_it():
    for compensator in (HysteresisParameters(), CompensatorParameters(**CREEP)):
        run = run_of(CREEP, compensator, 'fbff')
        assert np.abs(run.displacement_um[1000:-1] - 2.0).max() < 3e-3


def test_a_whole_run_has_the_bits_of_its_elements():
    compensator = CompensatorParameters(**CREEP)
    run = simulate(
        RigParameters(), compensator, ControllerParameters(scheme='ff'),
        TrajectoryParameters(periods=2.0))
    element = InverseHysteresis(compensator, 1e-5, compiled=False)
    assert element.answer(0, run.command_um).tobytes() == run.voltage_v.tobytes()
