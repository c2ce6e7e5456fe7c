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

"""A lead section tuned with the gains."""

import numpy as np
import pytest
import yaml

from piezo_ros.control import ControllerParameters
from piezo_ros.identification.tuning.lead_tuning import tune_pi_with_lead
from piezo_ros.identification.tuning.linear_plant import LinearPlant
from piezo_ros.identification.tuning.loop_shape import loop_shape
from piezo_ros.identification.tuning.pi_loop import Lead, PiLoop
from piezo_ros.identification.tuning.pi_tuning import tune_pi
from piezo_ros.model import LinearDynamics
from piezo_ros.model.state_space import frequency_response

OPTIONS = {'objective': 'feedback_band', 'max_sensitivity': 1.6}


def test_a_lead_at_the_pole_of_the_sensor_widens_the_band_of_feedback():
    alone, led = (
        tune_pi(LinearDynamics(), lead=lead, **OPTIONS) for lead in (None, Lead(870.0, 8700.0)))
    assert led.promised_sensitivity <= 1.6
    assert led.after.feedback_acceptable_frequency_hz > (
        1.5 * alone.after.feedback_acceptable_frequency_hz)
    assert led.integral_gain_per_s > 0.0


@pytest.fixture(scope='module')
def tunings():
    """Return the gains alone and those with a lead, of the published model."""
    model = LinearDynamics()
    return tune_pi(model, **OPTIONS), tune_pi_with_lead(model, ratio=10.0, **OPTIONS)


@pytest.mark.slow
def test_the_search_finds_a_lead_as_good_within_the_limit(tunings):
    alone, led = tunings
    assert led.promised_sensitivity <= 1.6
    assert led.after.stable
    assert alone.after.feedback_acceptable_frequency_hz > 900.0
    assert led.after.feedback_acceptable_frequency_hz > (
        1.5 * alone.after.feedback_acceptable_frequency_hz)
    assert led.after.loop.lead.pole_hz == pytest.approx(10.0 * led.after.loop.lead.zero_hz)
    # The slow pole of the sensor is at 1/(2 pi 160 us).
    assert 300.0 < led.after.loop.lead.zero_hz < 2000.0


@pytest.mark.slow
def test_the_file_gives_the_controller_this_lead(tunings):
    text = tunings[1].to_parameter_yaml(source='a model')
    law = ControllerParameters.among(
        yaml.safe_load(text)['/**/controller']['ros__parameters'])
    assert Lead.of(law) == tunings[1].after.loop.lead
    assert 'lead' not in tunings[0].to_parameter_yaml(source='a model')


@pytest.mark.parametrize('period_s', [1e-5, None])
def test_the_closed_loop_has_the_response_of_the_sensitivity(period_s):
    """The state space and the frequency response are two ways to the same loop."""
    loop = PiLoop.of(
        LinearDynamics(), 0.4, 900.0, period_s, 0 if period_s is None else 2, Lead(600.0, 6000.0))
    step_s = period_s or 1e-7
    frequency_hz = np.array([30.0, 300.0, 1500.0, 4000.0])
    response = frequency_response(
        loop.error_system(step_s), np.exp(2j * np.pi * frequency_hz * step_s))
    # y is read later than it is measured: the error is 1 - G K S, not S.
    expected = 1.0 - loop.plant_response(frequency_hz) * loop.controller_response(
        frequency_hz) * loop.sensitivity(frequency_hz)
    within = 2e-3 if period_s is None else 1e-9
    np.testing.assert_allclose(response, expected, rtol=0.0, atol=within)


@pytest.mark.parametrize('lead', [Lead(900.0, 900.0), Lead(0.0, 900.0), Lead(1.0, np.inf),
                                  Lead(np.nan, 1.0)])
def test_what_is_no_lead_is_refused(lead):
    with pytest.raises(ValueError, match='lead has its zero at'):
        loop_shape(LinearDynamics(), 0.2, 1e3, sample_period_s=1e-5, lead=lead)


@pytest.mark.parametrize('ratio', [1.0, 0.0, np.nan, 1e9])
def test_a_ratio_out_of_range_is_refused(ratio):
    with pytest.raises(ValueError, match='the ratio of the lead is'):
        tune_pi_with_lead(LinearDynamics(), ratio=ratio)


def test_no_gains_within_the_limits_is_told():
    unstable = LinearPlant(np.array([1.0]), np.array([1.0, -1.0]))
    with pytest.raises(ValueError, match='all must be stable'):
        tune_pi_with_lead(unstable, ratio=10.0)
