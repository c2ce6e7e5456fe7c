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

from piezo_ros.model import HysteresisParameters, InverseHysteresis, Rig, RigParameters

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
    expected = Rig(parameters).run(inputs)
    for compiled in (False, True):
        rig = Rig(parameters, PERIOD_S, compiled=compiled)
        readings = np.array([rig.step(voltage_v) for voltage_v in inputs.tolist()])
        assert readings.tobytes() == expected.tobytes()
        blocks = Rig(parameters, PERIOD_S, compiled=compiled)
        readings = np.concatenate([
            blocks.answer(at, inputs[at:at + 700]) for at in range(0, inputs.size, 700)])
        assert readings.tobytes() == expected.tobytes()


def test_the_inverse_behind_one_call_gives_the_same_bits_in_python_and_compiled():
    wanted_um = 3.0 * np.sin(np.arange(2000) / 30)
    plain, compiled = (
        InverseHysteresis(HysteresisParameters(), compiled=flag).answer(0, wanted_um)
        for flag in (False, True))
    assert plain.tobytes() == compiled.tobytes()
    one_by_one = InverseHysteresis(HysteresisParameters())
    assert plain.tolist() == [
        one_by_one.answer(k, wanted_um[k:k + 1])[0] for k in range(wanted_um.size)]


@pytest.mark.parametrize('compiled', [False, True])
def test_samples_beyond_a_rail_and_slewing_samples_are_counted(compiled):
    parameters = RigParameters(slew_limit_v_per_s=1e5, dac_bits=0)  # 1 V a sample
    rig = Rig(parameters, PERIOD_S, compiled=compiled)
    counts = []
    for voltage_v in (0.5, 5.0, 5.0, 5.0, 5.1, 5.1, -7.0, -6.0, -8.0):
        rig.drive(np.array([voltage_v]))
        counts.append(rig.saturated_samples)
    # From 0.5 V to the rail at 5 V in five samples, two of them asking for more than the rail.
    assert counts == [
        (0, 0), (0, 1), (0, 2), (0, 3), (1, 4), (2, 4), (2, 5), (2, 6), (3, 7)]
