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

"""Planned scans: the model in its periodic state, the limits, the prediction against runs."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezo_ros.control import ControllerParameters
from piezo_ros.control.closed_loop import run_loop
from piezo_ros.model import HysteresisParameters, LinearDynamics, RigParameters
from piezo_ros.model.simulated_rig import Rig
from piezo_ros.parameters.parameter_file import read_parameter_set
from piezo_ros.planning.certificate import certificate, contraction
from piezo_ros.planning.constrained_step import (
    AmplifierLimits,
    constrained_step,
)
from piezo_ros.planning.harmonics import harmonic_basis, repeating_samples
from piezo_ros.planning.periodic_plan import PlanAccuracy, plan_periodic, regularisation_of
from piezo_ros.planning.periodic_stage import PeriodicStage, gain

PERIOD_S = 1e-5
SLEW_V_PER_S = 18_200.0
RIG = read_parameter_set(
    Path(__file__).parents[2] / 'config' / 'rig.yaml', 'plant', RigParameters).replaced(
        noise_rms_um=0.0, dac_bits=0, adc_bits=0, slew_limit_v_per_s=0.0)
# The plans of the reference study, before any run: true NRMSE in percent.
STUDY = {
    (0.5, 300.0): 0.062, (0.5, 800.0): 0.294, (1.0, 500.0): 0.174, (1.5, 300.0): 0.073,
    (1.5, 600.0): 0.419, (2.0, 800.0): 1.042, (2.5, 800.0): 1.193}


def triangle(amplitude_um, frequency_hz, samples):
    turns = np.arange(samples) * frequency_hz * PERIOD_S
    return amplitude_um * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * turns))


def stage_of(rig, samples):
    dynamics = LinearDynamics(rig.true_dynamics)
    return PeriodicStage(
        dynamics.amplifier, rig, dynamics.mechanics_and_sensor, PERIOD_S, samples)


def planned(amplitude_um, frequency_hz, rig=RIG, **given):
    samples = repeating_samples(frequency_hz, PERIOD_S)
    return plan_periodic(
        stage_of(rig, samples), triangle(amplitude_um, frequency_hz, samples), frequency_hz,
        PERIOD_S, band_hz=15_000.0, **given)


@pytest.mark.parametrize(('amplitude_um', 'frequency_hz'), STUDY)
def test_a_run_is_as_planned_and_no_worse_than_the_study(amplitude_um, frequency_hz):
    plan = planned(
        amplitude_um, frequency_hz, limits=AmplifierLimits(slew_v_per_s=SLEW_V_PER_S))
    rig = Rig(RIG.replaced(slew_limit_v_per_s=SLEW_V_PER_S * (1.0 + 2e-6)), PERIOD_S)
    samples, periods = plan.reference_um.size, 12
    readings_um = rig.run(
        plan.soft_start(periods * samples, 1.0) * plan.voltage_v(periods * samples))
    assert rig.saturated_samples == (0, 0)
    np.testing.assert_allclose(
        readings_um[-samples - 1:-1], plan.displacement_um, atol=1e-9 * amplitude_um)
    assert plan.predicted_nrmse_percent < 1.02 * STUDY[amplitude_um, frequency_hz]
    assert plan.limit_use < 1.0 + 1e-6
    assert plan.truncation_percent <= plan.predicted_nrmse_percent * (1.0 + 1e-9)
    assert plan.certificate.holds


def test_the_command_is_what_the_compensator_turns_into_the_voltage():
    from piezo_ros.model.hysteresis_and_inverse import InverseHysteresis
    plan = planned(1.0, 500.0)
    command_um = plan.command_um(800, RIG, ramp_periods=1.0)
    voltage_v = InverseHysteresis(RIG).answer(0, command_um)
    np.testing.assert_allclose(
        voltage_v, plan.soft_start(800, 1.0) * plan.voltage_v(800), atol=1e-12)


@settings(max_examples=20, deadline=None)
@given(
    shape=st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6),
    size=st.floats(0.3, 4.0), seed=st.integers(0, 2**16))
def test_the_slope_is_the_difference_of_two_answers(shape, size, seed):
    samples = 250
    basis = harmonic_basis(np.arange(samples) / samples, np.array([1, 3, 5]))
    coefficients = np.array(shape) * size / (1.0 + 2.0 * np.array([0, 1, 2, 0, 1, 2]))
    coefficients[3] += size
    direction = np.random.default_rng(seed).standard_normal(6)
    stage = stage_of(RIG, samples)
    answer = stage.linearise(basis @ coefficients, basis)
    # The elements that slip may change within a step; it then is of second order.
    step = 1e-6
    difference = (
        stage.answer(basis @ (coefficients + step * direction))
        - stage.answer(basis @ (coefficients - step * direction))) / (2.0 * step)
    np.testing.assert_allclose(
        difference, answer.slope @ direction,
        atol=2e-3 * float(np.max(np.abs(answer.slope @ direction))))


def run_beside_feedback(plan, rig, reference_delay_samples):
    """Return the NRMSE of the planned command under feedback, percent."""
    samples = 4 * plan.reference_um.size
    run = run_loop(
        rig, RIG, ControllerParameters(reference_delay_samples=reference_delay_samples), PERIOD_S,
        np.tile(plan.reference_um, 4) * plan.soft_start(samples, 1.0),
        plan.command_um(samples, RIG, 1.0))
    error_um = plan.reference_um - run.displacement_um[-plan.reference_um.size - 1:-1]
    return 100.0 * math.sqrt(np.mean(error_um**2)) / np.ptp(plan.reference_um)


def test_feedback_that_is_aligned_does_not_spoil_a_plan_and_removes_drift():
    plan = planned(1.0, 300.0, limits=AmplifierLimits(slew_v_per_s=SLEW_V_PER_S))
    late, aligned = (run_beside_feedback(plan, RIG, delay) for delay in (0, 1))
    assert late > 5.0 * plan.predicted_nrmse_percent
    assert aligned < plan.predicted_nrmse_percent + 0.02
    drifting = RIG.replaced(drift_um_per_s=0.2)
    assert run_beside_feedback(plan, drifting, 1) < plan.predicted_nrmse_percent + 0.02


def test_a_stage_with_an_asymmetry_is_planned_with_all_harmonics():
    lopsided = RIG.replaced(
        asymmetry_threshold_um=(-1.0, 0.5, 1.2), asymmetry_weight=(0.1, -0.08, -0.05))
    samples = repeating_samples(500.0, PERIOD_S)
    reference_um = triangle(2.0, 500.0, samples)
    plans = [
        plan_periodic(
            stage_of(lopsided, samples), reference_um, 500.0, PERIOD_S, band_hz=15_000.0,
            is_symmetric=symmetric)
        for symmetric in (False, True)]
    assert plans[0].predicted_nrmse_percent < 0.1 * plans[1].predicted_nrmse_percent
    rig = Rig(lopsided, PERIOD_S)
    readings_um = rig.run(plans[0].started_voltage_v(5 * samples, 1.0))
    np.testing.assert_allclose(
        readings_um[-samples - 1:-1], plans[0].displacement_um, atol=1e-9)


def test_a_stage_without_hysteresis_and_poles_follows_exactly():
    stage = PeriodicStage(
        gain(1.0), HysteresisParameters(kappa_um_per_v=(1.0, 2.0), saturation_v=(0.0,)),
        gain(1.0), PERIOD_S, 200)
    sine_um = 1.5 * np.sin(2.0 * np.pi * np.arange(200) / 200)
    plan = plan_periodic(stage, sine_um, 500.0, PERIOD_S, band_hz=2000.0)
    np.testing.assert_allclose(plan.displacement_um, sine_um, atol=1e-6)
    np.testing.assert_allclose(plan.period_voltage_v, sine_um / 2.0, atol=1e-6)


@pytest.mark.parametrize('limits', [
    AmplifierLimits(slew_v_per_s=9_000.0),
    AmplifierLimits(average_slew_v_per_s=3_000.0),
    AmplifierLimits(minimum_v=-1.9, maximum_v=1.9),
    AmplifierLimits(slew_v_per_s=9_000.0, average_slew_v_per_s=4_000.0, minimum_v=-2.1,
                    maximum_v=2.1),
])
def test_every_limit_is_kept_and_used(limits):
    plan = planned(2.0, 500.0, limits=limits)
    assert 0.999 < limits.worst(plan.period_voltage_v, PERIOD_S) < 1.0 + 1e-5
    assert plan.predicted_nrmse_percent > plan.truncation_percent


@pytest.mark.parametrize(('name', 'value'), [
    ('minimum_v', 0.5), ('maximum_v', 0.0), ('slew_v_per_s', -1.0),
    ('average_slew_v_per_s', math.nan)])
def test_a_limit_that_leaves_no_room_is_refused(name, value):
    with pytest.raises(ValueError, match=f'{name} is {value}, it must be'):
        AmplifierLimits(**{name: value})


def test_a_free_turn_lessens_the_error_of_the_lines():
    samples = repeating_samples(500.0, PERIOD_S)
    turns = np.arange(samples) / samples
    lines = np.abs(np.abs(((turns + 0.25) % 0.5) - 0.25)) < 0.2
    weight = np.where(lines, 1.0, 0.03)
    limits = AmplifierLimits(slew_v_per_s=SLEW_V_PER_S)
    free, plain = (planned(2.0, 500.0, limits=limits, **each) for each in ({'weight': weight}, {}))

    def lines_rms_um(plan):
        return math.sqrt(float(np.mean((plan.reference_um - plan.displacement_um)[lines]**2)))

    assert lines_rms_um(free) < 0.3 * lines_rms_um(plain)


def test_learning_with_the_model_of_another_stage_contracts_as_certified():
    samples = repeating_samples(500.0, PERIOD_S)
    plan = planned(1.0, 500.0, accuracy=PlanAccuracy(uncertainty=0.4))
    basis = harmonic_basis(
        np.arange(samples) * 500.0 * PERIOD_S, plan.orders)
    slope = stage_of(RIG, samples).linearise(plan.period_voltage_v, basis).slope
    other = stage_of(RIG.replaced(gain_mismatch=0.1), samples).linearise(
        plan.period_voltage_v, basis).slope
    gamma = contraction(slope, other, plan.weight, regularisation_of(slope))
    assert 0.0 < gamma <= plan.certificate.gamma < 1.0
    certain = certificate(slope, plan.weight, regularisation_of(slope), 0.0)
    assert contraction(slope, slope, plan.weight, regularisation_of(slope)) == pytest.approx(
        certain.gamma)
    assert not certificate(slope, plan.weight, regularisation_of(slope), 1.0).holds


def test_a_step_within_the_limits_is_the_one_of_least_squares():
    rng = np.random.default_rng(3)
    slope, error = rng.standard_normal((40, 4)), rng.standard_normal(40)
    step = constrained_step(
        slope, error, np.ones(40), 0.0, np.eye(40)[:, :4], np.zeros(4), AmplifierLimits(), 1.0)
    np.testing.assert_allclose(step, np.linalg.lstsq(slope, error, rcond=None)[0])


@pytest.mark.parametrize(('frequency_hz', 'samples'), [(300.0, 1000), (700.0, 1000), (800.0, 125)])
def test_what_repeats_after_whole_samples_is_found(frequency_hz, samples):
    assert repeating_samples(frequency_hz, PERIOD_S) == samples


def test_a_scan_that_never_repeats_names_a_frequency_that_does():
    with pytest.raises(ValueError, match=r'frequency_hz is 301.2345678.* 301.20481'):
        repeating_samples(301.2345678, PERIOD_S)


def test_a_band_below_the_scan_is_refused():
    samples = repeating_samples(500.0, PERIOD_S)
    with pytest.raises(ValueError, match='band_hz is 400: it must be at least frequency_hz, 500'):
        plan_periodic(
            stage_of(RIG, samples), triangle(1.0, 500.0, samples), 500.0, PERIOD_S, band_hz=400.0)


def test_a_period_of_too_many_samples_is_refused_before_it_is_made():
    with pytest.raises(ValueError, match='a period has 1e[+]11 samples, allowed are 20000'):
        repeating_samples(1e-6, PERIOD_S)
