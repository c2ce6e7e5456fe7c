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

from piezo_ros.control.demagnetisation import demagnetising_voltage
from piezo_ros.model import Rig, RigParameters

PERIOD_S = 1e-5


def test_it_decays_from_the_amplitude_to_zero_no_faster_than_the_slope():
    voltage_v = np.array(demagnetising_voltage(5.0, 10, 1000.0, PERIOD_S))
    assert voltage_v[0] == voltage_v[-1] == 0.0
    assert voltage_v.max() == pytest.approx(5.0)
    assert voltage_v.min() == pytest.approx(-5.0)
    assert np.abs(np.diff(voltage_v)).max() <= 1000.0 * PERIOD_S * (1.0 + 1e-9)
    peaks_v = np.abs(voltage_v[:-1]).reshape(10, -1).max(axis=1)
    np.testing.assert_allclose(peaks_v, np.linspace(5.0, 0.5, 10), atol=0.02)


def test_a_steep_slope_still_leaves_samples_for_every_peak():
    voltage_v = demagnetising_voltage(5.0, 3, 1e9, PERIOD_S)
    assert len(voltage_v) == 3 * 8 + 1
    assert max(voltage_v) == pytest.approx(5.0)


@pytest.mark.parametrize('levels', [100, 1000])
def test_it_takes_a_stage_back_to_where_the_inverse_model_assumes_it(levels):
    rig = Rig(RigParameters(noise_rms_um=0.0, adc_bits=0))
    rig.run(3.0 * np.sin(np.linspace(0.0, 2.5 * np.pi, 20_000)))
    rig.run(np.linspace(3.0, 0.0, 3000))
    rig.run(np.zeros(2000))
    remanent_um = rig.measure()
    assert remanent_um > 0.3
    rig.run(demagnetising_voltage(5.0, levels, 1000.0, PERIOD_S))
    rig.run(np.zeros(2000))
    # Half a level of voltage is what is left of the last swing.
    left_v = 5.0 / levels
    kappa_um_per_v = RigParameters().kappa_um_per_v[-1]
    assert abs(rig.measure()) < left_v * kappa_um_per_v / 2.0
