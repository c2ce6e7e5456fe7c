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

"""Average current and self-heating of the rig: what they do, and that they are nothing when off."""

import numpy as np
import pytest

from piezo_ros.model import Rig, RigParameters
from piezo_ros.model.effects.load import NO_LOAD, LoadParameters, load_constants
from piezo_ros.model.rig import rig_constants

PERIOD_S = 1e-5
IDEAL = {'noise_rms_um': 0.0, 'dac_bits': 0, 'adc_bits': 0}
LOADED = {'average_slew_limit_v_per_s': 9000.0, 'self_heating_gain': 0.01}


def triangle_v(slew_v_per_s, peak_v=2.0, samples=4000):
    turns = slew_v_per_s / (4.0 * peak_v) * PERIOD_S * np.arange(samples)
    return peak_v * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * turns))


def driven_v(voltage_v, **values):
    rig, driven = Rig(RigParameters(**IDEAL, **values), PERIOD_S, compiled=False), []
    for value in voltage_v.tolist():
        rig.step(value)
        driven.append(rig.driven_v)
    return np.array(driven), rig


def test_a_slope_within_the_average_is_kept_up_for_ever():
    voltage_v = triangle_v(8900.0)
    driven, rig = driven_v(voltage_v, average_slew_limit_v_per_s=9000.0)
    np.testing.assert_allclose(driven, voltage_v, rtol=0, atol=1e-12)
    assert (rig.saturated_samples, rig.average_current_samples) == ((0, 0), 0)


def test_the_peak_lasts_as_long_as_the_time_constant_allows_then_the_average_is_left():
    voltage_v = 18000.0 * PERIOD_S * np.arange(3000)
    driven, rig = driven_v(
        voltage_v[:400], average_slew_limit_v_per_s=9000.0, average_slew_time_s=2e-3,
        voltage_maximum_v=100.0)
    steps = np.diff(driven)
    full = int(np.sum(steps > 0.999 * 0.18))
    assert full * PERIOD_S == pytest.approx(2e-3 * np.log(2.0), rel=0.02)
    np.testing.assert_allclose(steps[full + 1:], 0.09, rtol=1e-9)
    assert rig.average_current_samples == 399 - full


def test_the_gain_grows_with_the_mean_square_speed():
    # 2 V at 100 Hz: some 2 um times 2 pi 100 Hz; by the time constant the end is reached.
    voltage_v = np.sin(2 * np.pi * 100.0 * PERIOD_S * np.arange(30_000))
    still = Rig(RigParameters(**IDEAL), PERIOD_S).run(voltage_v)
    warm = Rig(RigParameters(**IDEAL, self_heating_gain=0.1), PERIOD_S).run(voltage_v)
    ratio = np.ptp(warm[-1000:]) / np.ptp(still[-1000:])
    mean_square = np.mean(np.diff(warm[-1000:] * 1e-3 / PERIOD_S) ** 2)
    assert ratio == pytest.approx(1.0 + 0.1 * mean_square, rel=5e-4)
    assert ratio > 1.005
    assert np.ptp(warm[:1000]) < np.ptp(warm[-1000:])


@pytest.mark.parametrize('values', [
    LOADED, {**LOADED, 'order': 'lumped'}, {**LOADED, 'creep_per_decade': 0.02},
    {'self_heating_gain': 10.0}, {'average_slew_limit_v_per_s': 5000.0}])
def test_python_and_compiled_code_have_the_same_bits(values):
    voltage_v = triangle_v(15000.0, samples=1500)
    ours, theirs = (
        Rig(RigParameters(slew_limit_v_per_s=18200.0, **values), PERIOD_S, compiled=compiled)
        for compiled in (False, True))
    assert ours.run(voltage_v).tobytes() == theirs.run(voltage_v).tobytes()
    assert ours.saturated_samples == theirs.saturated_samples
    assert ours.average_current_samples == theirs.average_current_samples
    assert ours.state == theirs.state


def test_off_nothing_of_them_is_computed_and_beside_creep_they_change_no_bit():
    constants = rig_constants(RigParameters(), PERIOD_S)
    assert constants.load is None
    assert load_constants(LoadParameters(), PERIOD_S) is None
    creeping = rig_constants(RigParameters(creep_per_decade=0.02), PERIOD_S)
    assert creeping.load == NO_LOAD
    voltage_v = triangle_v(15000.0, samples=500)
    slewing = RigParameters(slew_limit_v_per_s=12000.0)
    plain = Rig(slewing, PERIOD_S, compiled=False)
    neutral = Rig(slewing, PERIOD_S, compiled=False)
    neutral.constants = neutral.constants._replace(
        load=NO_LOAD, creep=rig_constants(RigParameters(self_heating_gain=1.0), PERIOD_S).creep)
    assert plain.run(voltage_v).tobytes() == neutral.run(voltage_v).tobytes()
