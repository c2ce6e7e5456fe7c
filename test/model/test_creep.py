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

from piezo_ros.model import ParameterError, Rig, RigParameters
from piezo_ros.model.rig import rig_constants

PERIOD_S = 1e-4
IDEAL = {'noise_rms_um': 0.0, 'dac_bits': 0, 'adc_bits': 0}
CREEP = {'creep_per_decade': 0.02, 'creep_start_s': 0.01, 'creep_end_s': 1e4}


@pytest.mark.parametrize('order', ['physical', 'lumped'])
def test_a_step_grows_by_the_same_share_in_every_tenfold_time(order):
    times_s = np.array([0.1, 1.0, 10.0])
    voltage_v = np.ones(round(times_s[-1] / PERIOD_S))
    still, creeping = (
        Rig(RigParameters(order=order, **IDEAL, **more), PERIOD_S).run(voltage_v)
        for more in ({}, CREEP))
    growth = creeping / still
    at = np.round(times_s / PERIOD_S).astype(int) - 1
    np.testing.assert_allclose(np.diff(growth[at]), 0.02, rtol=0.02)


def test_in_the_end_all_decades_have_come_together():
    rig = Rig(RigParameters(**IDEAL, creep_per_decade=0.02, creep_end_s=1.0), PERIOD_S)
    still = Rig(RigParameters(**IDEAL), PERIOD_S)
    voltage_v = np.ones(100_000)
    assert rig.run(voltage_v)[-1] == pytest.approx(1.02 * still.run(voltage_v)[-1], rel=1e-4)


def test_the_response_falls_slowly_with_frequency_and_not_where_the_paper_scans():
    def amplitude_um(frequency_hz, **more):
        period = round(1.0 / (frequency_hz * 1e-5))
        time = np.arange(3 * period) / period
        run = Rig(RigParameters(**IDEAL, **more)).run(np.sin(2 * np.pi * time))
        return abs(np.mean(run[-period:] * np.exp(-2j * np.pi * time[-period:])))

    creep = {'creep_per_decade': 0.02, 'creep_start_s': 0.01}
    share = [amplitude_um(f, **creep) / amplitude_um(f) - 1.0 for f in (1.0, 10.0, 300.0)]
    # Slower by a decade there is 2 % more; beyond the start of the creep there is none.
    assert share[0] - share[1] == pytest.approx(0.02, abs=0.002)
    assert abs(share[2]) < 1e-4


def test_drift_is_a_constant_rate_that_no_voltage_changes():
    still, drifting = (
        Rig(RigParameters(**IDEAL, drift_um_per_s=rate)).run(np.sin(np.arange(20_000) / 50))
        for rate in (0.0, -0.5))
    expected_um = -0.5 * 1e-5 * np.arange(1, 20_001)
    np.testing.assert_allclose(drifting - still, expected_um, rtol=0, atol=1e-12)


def test_without_creep_and_drift_nothing_of_them_is_computed():
    assert rig_constants(RigParameters(), 1e-5).creep is None


def test_creep_that_ends_before_it_begins_is_refused():
    with pytest.raises(ParameterError, match=r'creep_start_s is 2\.0 s.*creep_end_s 1\.0 s'):
        RigParameters(creep_start_s=2.0, creep_end_s=1.0)
