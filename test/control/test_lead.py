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

"""The lead section before the gains of the controller."""

import math

import numpy as np
import pytest

from piezo_ros.control.changes import parse_changes
from piezo_ros.control.closed_loop import run_loop
from piezo_ros.control.controller_step import (
    ControllerParameters,
    controller_constants,
    controller_step,
    initial_state,
    prepare_transfer,
)
from piezo_ros.control.pi_controller import PiController
from piezo_ros.identification.tuning.pi_loop import Lead, PiLoop
from piezo_ros.model import HysteresisParameters, LinearDynamics, ParameterError, RigParameters

PERIOD_S = 1e-5
LEAD = {'lead_zero_hz': 870.0, 'lead_pole_hz': 8700.0}


def law(scheme='fb', **values):
    return ControllerParameters(**{
        'scheme': scheme, 'measurement_delay_samples': 0, 'bumpless_start': False,
        'proportional_gain': 0.5, 'integral_gain_per_s': 500.0, **values})


def answers(parameters, reference_um, feedforward_um=None, displacement_um=None, *, compiled=False):
    zeros = np.zeros_like(reference_um)
    return PiController(parameters, PERIOD_S, compiled=compiled).answer(
        0, reference_um, zeros if feedforward_um is None else feedforward_um,
        zeros if displacement_um is None else displacement_um)


def test_a_sine_comes_out_as_the_frequency_response_says():
    frequency_hz = 1000.0
    time_s = np.arange(3000) * PERIOD_S
    parameters = law(integral_gain_per_s=0.0, proportional_gain=1.0, command_minimum_um=-1e3,
                     command_maximum_um=1e3, **LEAD)
    out_um = answers(parameters, np.sin(2 * np.pi * frequency_hz * time_s))[2000:]
    wave = np.exp(-2j * np.pi * frequency_hz * time_s[2000:])
    measured = 2j * np.mean(out_um * wave)
    expected = Lead(870.0, 8700.0).response(np.array([frequency_hz]), PERIOD_S)[0]
    assert measured == pytest.approx(expected, rel=1e-9)
    assert abs(expected) > 1.3
    assert math.degrees(np.angle(expected)) > 30.0


def test_a_constant_error_passes_unchanged():
    out_um = answers(law(integral_gain_per_s=0.0, **LEAD), np.full(500, 1.3))
    np.testing.assert_allclose(out_um, 0.65, rtol=1e-12)


def test_python_and_compiled_give_the_same_bits():
    streams = np.random.default_rng(3).normal(size=(3, 400))
    for scheme in ('fb', 'fbff', 'ff'):
        parameters = law(scheme, measurement_delay_samples=2, reference_delay_samples=1, **LEAD)
        pair = [answers(parameters, *streams, compiled=compiled) for compiled in (False, True)]
        assert pair[0].tobytes() == pair[1].tobytes()


def test_the_closed_loop_is_the_linear_one_of_the_margins():
    """A linear rig under PI + lead follows a step as `PiLoop` says, sample by sample."""
    dynamics = RigParameters().true_dynamics
    hysteresis = HysteresisParameters(kappa_um_per_v=(1.0,), saturation_v=())
    rig = RigParameters.from_mapping({
        **dynamics.to_mapping(), **hysteresis.to_mapping(), 'dac_bits': 0, 'adc_bits': 0,
        'noise_rms_um': 0.0, 'sensor_scale_um_per_v': 1e4, 'travel_um': 1e5, 'order': 'lumped',
        'operating_point_um': 0.0, 'operating_point_v': 0.0, 'slew_limit_v_per_s': 0.0,
        'voltage_minimum_v': -1e3, 'voltage_maximum_v': 1e3})
    parameters = law(measurement_delay_samples=1, command_minimum_um=-1e3, command_maximum_um=1e3,
                     **LEAD)
    reference_um = np.where(np.arange(600) > 5, 1.0, 0.0)
    run = run_loop(
        rig, hysteresis, parameters, PERIOD_S, reference_um, np.zeros(600))
    system = PiLoop.of(
        LinearDynamics(dynamics), 0.5, 500.0, PERIOD_S, 1, Lead(870.0, 8700.0)).error_system(0.0)
    state, expected = np.zeros((system.a.shape[0], 1)), []
    for value in reference_um:
        expected.append(float((system.c @ state + system.d * value)[0, 0]))
        state = system.a @ state + system.b * value
    np.testing.assert_allclose(
        reference_um - run.displacement_um[:-1], expected, rtol=0, atol=1e-9)


def test_the_integral_does_not_wind_up_behind_a_lead():
    """Clamping goes by the error that the integral takes, not by the one before the lead."""
    parameters = law(command_minimum_um=-1.0, command_maximum_um=1.0, **LEAD)
    constants, state = controller_constants(parameters, PERIOD_S), initial_state(parameters)
    for k in range(2000):
        controller_step(state, constants, k, 5.0, 0.0, 0.0)
    held_um = state.memory[0]
    assert held_um <= 1.0
    # The lead drives the command below its lower limit at once; the integral must not follow.
    command_um = controller_step(state, constants, 2000, -5.0, 0.0, 0.0)
    assert command_um == -1.0
    assert state.memory[0] == held_um


@pytest.mark.parametrize('anti_windup', ['clamping', 'back_calculation', 'none'])
def test_the_command_keeps_its_limits_and_stays_finite(anti_windup):
    streams = 1e3 * np.random.default_rng(5).normal(size=(3, 500))
    parameters = law('fbff', anti_windup=anti_windup, **LEAD)
    out_um = answers(parameters, *streams)
    assert np.isfinite(out_um).all()
    assert np.abs(out_um).max() <= 8.0


def test_a_lead_that_comes_during_a_run_is_bumpless():
    before, after = law('fbff'), law('fbff', **LEAD)
    state = initial_state(before)
    rng = np.random.default_rng(7)
    for k, error_um in enumerate(rng.normal(size=50)):
        last_um = controller_step(
            state, controller_constants(before, PERIOD_S), k, error_um, 0.1, 0.0)
    prepare_transfer(state)
    command_um = controller_step(
        state, controller_constants(after, PERIOD_S), 50, 0.7, 0.1, 0.0)
    assert command_um == pytest.approx(last_um, abs=1e-15)


def test_a_lead_can_be_listed_as_a_change():
    change = parse_changes('[{"at_sample": 7, "lead_zero_hz": 0.0, "lead_pole_hz": 0.0}]')
    assert change[0].values == {'lead_zero_hz': 0.0, 'lead_pole_hz': 0.0}


@pytest.mark.parametrize(('zero_hz', 'pole_hz'), [(870.0, 0.0), (0.0, 900.0), (900.0, 870.0),
                                                  (900.0, 900.0)])
def test_a_lead_that_is_none_is_refused_by_name(zero_hz, pole_hz):
    with pytest.raises(ParameterError, match=f'lead_zero_hz is {zero_hz} Hz and lead_pole_hz'):
        ControllerParameters(lead_zero_hz=zero_hz, lead_pole_hz=pole_hz)


@pytest.mark.parametrize('value', [math.nan, math.inf, -1.0])
def test_a_zero_that_is_no_frequency_is_refused(value):
    with pytest.raises(ParameterError, match='lead_zero_hz'):
        ControllerParameters(lead_zero_hz=value, lead_pole_hz=1e4)
