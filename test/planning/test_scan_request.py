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

"""What is wanted of a scan: the band out of W(s), the shares of the predicted error."""

import math
from dataclasses import replace

import numpy as np
import pytest

from piezo_ros.model import DynamicsParameters, HysteresisParameters, RigParameters
from piezo_ros.model.effects.load import average_slew
from piezo_ros.planning.certificate import certificate
from piezo_ros.planning.constrained_step import AmplifierLimits
from piezo_ros.planning.scan import (
    ScanRequest,
    limits_of,
    plan_for_rig,
    planned_scan,
    with_bound,
)


def request(**given):
    return ScanRequest(**{
        'waveform': 'triangle', 'amplitude_um': 1.0, 'frequency_hz': 800.0,
        'sample_period_s': 1e-5, 'dynamics': DynamicsParameters(),
        'hysteresis': HysteresisParameters(),
        'limits': AmplifierLimits(slew_v_per_s=18_200.0), 'noise_rms_um': 0.002, **given})


def test_a_bound_narrows_the_band_to_where_the_model_is_known():
    narrowed = with_bound(request(), lambda frequency_hz: frequency_hz / 10_000.0)
    # 6 harmonics of 800 Hz are below 5 kHz, where |W| is 0.5.
    assert int(planned_scan(narrowed).orders[-1]) == 5
    assert narrowed.uncertainty == pytest.approx(0.48)
    whole = with_bound(request(), lambda frequency_hz: np.full_like(frequency_hz, 0.01))
    assert whole.band == request().band
    # 1 % of a triangle of 2 um peak to peak, 1/sqrt(3) um rms.
    assert whole.uncertainty_percent == pytest.approx(1.0 / math.sqrt(12.0), rel=0.01)


def test_a_bound_that_is_large_everywhere_leaves_one_harmonic_and_no_certificate():
    unknown = with_bound(request(), lambda frequency_hz: np.full_like(frequency_hz, 3.0))
    plan = planned_scan(unknown)
    assert plan.orders.tolist() == [1]
    assert not plan.certificate.holds


@pytest.mark.parametrize('magnitude', [math.inf, math.nan])
def test_a_bound_that_is_no_number_is_refused(magnitude):
    with pytest.raises(ValueError, match=f'uncertainty is {magnitude}'):
        with_bound(request(), lambda frequency_hz: np.full_like(frequency_hz, magnitude))


def test_the_predicted_error_is_told_by_its_shares():
    plan = planned_scan(with_bound(
        request(), lambda frequency_hz: np.full_like(frequency_hz, 0.004)))
    assert math.hypot(plan.truncation_percent, plan.limits_percent) == pytest.approx(
        plan.predicted_nrmse_percent)
    assert plan.limits_percent > plan.truncation_percent
    assert plan.noise_percent == pytest.approx(0.1, rel=0.02)
    assert plan.measured_nrmse_percent == pytest.approx(
        math.hypot(plan.predicted_nrmse_percent, plan.noise_percent))
    assert plan.highest_nrmse_percent > plan.measured_nrmse_percent
    free = planned_scan(request(limits=AmplifierLimits(), amplitude_um=0.2))
    assert free.limits_percent < 1e-6


def test_the_average_current_is_that_of_the_rig_unless_told():
    assert limits_of(RigParameters()).average_slew_v_per_s == math.inf
    rig = RigParameters(average_slew_limit_v_per_s=3000.0)
    assert limits_of(rig).average_slew_v_per_s == 3000.0
    assert limits_of(rig, 2000.0).average_slew_v_per_s == 2000.0


def test_a_plan_keeps_the_average_current_over_the_time_of_the_amplifier():
    period_s, average_s = 2e-5, 5e-4
    scan = request(frequency_hz=400.0, sample_period_s=period_s, band_hz=4000.0)
    voltage_v = np.tile(planned_scan(scan).period_voltage_v, 20)
    mean_v_per_s = float(np.abs(np.diff(voltage_v)).mean()) / period_s
    rig = RigParameters(average_slew_limit_v_per_s=mean_v_per_s, average_slew_time_s=average_s)
    assert average_slew(voltage_v, average_s, period_s).max() > 1.3 * mean_v_per_s
    kept, plan = plan_for_rig(replace(scan, limits=limits_of(rig)), rig)
    assert kept.limits.average_slew_v_per_s < mean_v_per_s
    averages = average_slew(np.tile(plan.period_voltage_v, 20), average_s, period_s)
    assert averages[averages.size // 2:].max() <= mean_v_per_s
    with pytest.raises(ValueError, match='allowed is 10 %'):
        plan_for_rig(
            replace(scan, limits=AmplifierLimits(average_slew_v_per_s=100.0)),
            rig.replaced(average_slew_limit_v_per_s=100.0))


def test_a_plan_within_a_tenth_of_its_band_is_no_less_certain_by_its_neighbours():
    rng = np.random.default_rng(2)
    slope = rng.standard_normal((60, 5))
    alone = certificate(slope, np.ones(60), 1e-3, 0.1)
    beside = certificate(slope, np.ones(60), 1e-3, 0.1, [1.2 * slope])
    assert alone.slip_share == 0.0
    assert beside.slip_share == pytest.approx(0.2, abs=0.01)
    assert beside.gamma == pytest.approx(
        beside.regularisation_share + beside.slip_share + 0.1)
    assert not certificate(slope, np.ones(60), 1e-3, 0.0, [2.5 * slope]).holds


@pytest.mark.parametrize(('name', 'value'), [
    ('uncertainty', -0.1), ('uncertainty_percent', math.nan), ('noise_rms_um', math.inf)])
def test_what_is_no_error_is_refused_by_name(name, value):
    with pytest.raises(ValueError, match=f'{name} is {value}'):
        request(**{name: value})
