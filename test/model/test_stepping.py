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

from piezo_ros.model import HysteresisParameters, Rig, RigParameters
from piezo_ros.model.noise import unit_noise
from piezo_ros.model.stepping import compensator_stepper, rig_stepper, saturated_samples

PERIOD_S = 1e-5
CREEP = {'creep_per_decade': 0.02, 'creep_start_s': 1e-3}


@pytest.mark.parametrize('parameters', [
    RigParameters(slew_limit_v_per_s=18900.0, gain_mismatch=-0.06),
    RigParameters(order='lumped'),
    RigParameters(**CREEP, drift_um_per_s=0.1),
    RigParameters(order='lumped', **CREEP),
    RigParameters(drift_um_per_s=-0.1),
    RigParameters(kappa_um_per_v=[20.0, 1.3], saturation_v=[0.0], **CREEP),
])
def test_a_rig_behind_one_call_gives_the_same_bits_in_python_and_compiled(parameters):
    inputs = 4.0 * np.sin(np.arange(4000) / 30)
    noise = unit_noise(parameters.seed, 1, inputs.size).tolist()
    expected = Rig(parameters).run(inputs)
    for compiled in (False, True):
        hold = rig_stepper(parameters, PERIOD_S, compiled=compiled)
        readings = np.array([hold(*pair) for pair in zip(inputs.tolist(), noise, strict=True)])
        assert readings.tobytes() == expected.tobytes()


def test_the_inverse_behind_one_call_gives_the_same_bits_in_python_and_compiled():
    wanted_um = (3.0 * np.sin(np.arange(2000) / 30)).tolist()
    plain, compiled = (
        [step(value) for value in wanted_um] for step in (
            compensator_stepper(HysteresisParameters(), compiled=flag) for flag in (False, True)))
    assert plain == compiled


@pytest.mark.parametrize('compiled', [False, True])
def test_samples_beyond_a_rail_and_slewing_samples_are_counted(compiled):
    parameters = RigParameters(slew_limit_v_per_s=1e5, dac_bits=0)  # 1 V a sample
    hold = rig_stepper(parameters, PERIOD_S, compiled=compiled)
    counts = []
    for voltage_v in (0.5, 5.0, 5.0, 5.0, 5.1, 5.1, -7.0, -6.0, -8.0):
        hold(voltage_v, 0.0)
        counts.append(saturated_samples(hold))
    # From 0.5 V to the rail at 5 V in five samples, two of them asking for more than the rail.
    assert counts == [
        (0, 0), (0, 1), (0, 2), (0, 3), (1, 4), (2, 4), (2, 5), (2, 6), (3, 7)]
