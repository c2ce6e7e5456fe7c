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

from pathlib import Path

import control
import numpy as np
import pytest
import yaml

from piezo_ros import paper
from piezo_ros.control import TrajectoryParameters
from piezo_ros.control.tables.excitation import multisine, odd_lines
from piezo_ros.control.tables.excitation import stepped_sine as build_stepped_sine
from piezo_ros.identification.dynamics.dynamics_fit import fit_dynamics
from piezo_ros.identification.dynamics.rational_model import (
    Sections,
    Shape,
    polynomials,
    sampled_response,
)
from piezo_ros.identification.response.frequency_response import (
    Amplifier,
    FrequencyResponse,
    frequency_response,
)
from piezo_ros.identification.response.offline_excitation import run_excitation_offline
from piezo_ros.model import (
    DynamicsParameters,
    LinearDynamics,
    MaxwellResistiveCapacitor,
    RigParameters,
)

TS = 1e-5
TABLE_2 = {
    name: value for name, value in paper.TABLE_2.items() if name in DynamicsParameters.names()}
CHECK_HZ = np.geomspace(10.0, 2000.0, 60)
RIG_FILE = Path(__file__).parents[3] / 'config' / 'rig.yaml'
PHYSICAL = RigParameters.from_mapping(
    yaml.safe_load(RIG_FILE.read_text())['/**/plant']['ros__parameters'])


def sampled_truth(parameters, frequency_hz, sample_period_s=TS):
    system = LinearDynamics(parameters).discrete(sample_period_s)
    return np.array([
        (system.c @ np.linalg.solve(z * np.eye(5) - system.a, system.b))[0, 0]
        for z in np.exp(2j * np.pi * np.asarray(frequency_hz) * sample_period_s)])


def measure(plant, excitation, **options):
    period = excitation.sample_period_s
    compensator = MaxwellResistiveCapacitor(plant.kappa_um_per_v, plant.saturation_v)
    voltage, displacement = run_excitation_offline(
        plant, compensator, excitation.command, period)
    return frequency_response(
        excitation.command, displacement, period, excitation=excitation, voltage_v=voltage,
        **options)


def synthetic(frequency_hz, response, error, seed=0, period=TS):
    """Return a response with circular Gaussian errors of known size."""
    generator = np.random.default_rng(seed)
    n = len(frequency_hz)
    noise = error * (generator.normal(size=n) + 1j * generator.normal(size=n)) / np.sqrt(2.0)
    one = np.ones(n)
    return FrequencyResponse(
        np.asarray(frequency_hz), np.asarray(response + noise), np.maximum(error, 1e-9)**2 * one,
        one, 0.0 * one, one, 0.0 * one, period)


def test_on_the_noise_free_lumped_rig_table_2_comes_back_within_a_thousandth():
    plant = RigParameters(order='lumped', noise_rms_um=0.0)
    excitation = build_stepped_sine(np.geomspace(20.0, 15000.0, 30), 0.5, TS, dwell_s=0.03)
    fit = fit_dynamics(measure(plant, excitation))
    ratio = fit.sampled_response(CHECK_HZ) / sampled_truth(DynamicsParameters(), CHECK_HZ)
    assert np.max(np.abs(ratio - 1.0)) < 1e-3
    for name, value in TABLE_2.items():
        assert getattr(fit.parameters, name) == pytest.approx(value, rel=1e-3)
    # The continuous response, without the hold, differs from the sampled one by 6 % at 2 kHz.
    continuous = LinearDynamics().response(CHECK_HZ)
    assert np.max(np.abs(fit.response(CHECK_HZ) / continuous - 1.0)) < 1e-3


@pytest.mark.parametrize('kind', ['stepped sine', 'multisine'])
@pytest.mark.parametrize('amplitude_um', [0.3, 1.0])
def test_on_the_physical_rig_g_is_within_two_percent_and_two_degrees(kind, amplitude_um):
    if kind == 'stepped sine':
        excitation = build_stepped_sine(np.geomspace(20.0, 10000.0, 30), amplitude_um, TS)
    else:
        lines = np.array(odd_lines(160, per_decade=20.0))
        # Less at high frequencies, where the amplifier would slew.
        excitation = multisine(
            20.0, lines, amplitude_um, TS, weights=1.0 / (1.0 + lines * 20.0 / 500.0), periods=5)
    fit = fit_dynamics(measure(
        PHYSICAL, excitation, amplifier=Amplifier(PHYSICAL.slew_limit_v_per_s)))
    # The truth at this amplitude: the same rig without noise, sine by sine.
    check = build_stepped_sine(np.geomspace(15.0, 1990.0, 15), amplitude_um, TS)
    truth = measure(PHYSICAL.replaced(noise_rms_um=0.0), check)
    ratio = fit.sampled_response(truth.frequency_hz) / truth.response
    assert np.max(np.abs(np.abs(ratio) - 1.0)) < 0.02
    assert np.max(np.abs(np.angle(ratio, deg=True))) < 2.0


def test_another_stage_is_found_as_well():
    own = RigParameters(
        order='lumped', noise_rms_um=5e-3, travel_um=100.0, operating_point_um=50.0,
        sensor_scale_um_per_v=10.0, kappa_um_per_v=(60.0, 12.0), saturation_v=(0.1,),
        natural_frequency_1_rad_per_s=9000.0, damping_ratio_1=0.8, time_constant_s=2e-4,
        natural_frequency_2_rad_per_s=1885.0, damping_ratio_2=0.05, zero_b1_rad_per_s=-4000.0,
        zero_b2_rad2_per_s2=3e7, gain_k_rad3_per_s3=5e10)
    period = 1e-4
    excitation = build_stepped_sine(
        np.geomspace(5.0, 3000.0, 40), 5.0, period, dwell_s=1.0, ramp_s=0.5, settle_s=0.2)
    fit = fit_dynamics(measure(own, excitation))
    frequency = np.geomspace(1.0, 1000.0, 50)
    ratio = fit.sampled_response(frequency) / sampled_truth(own, frequency, period)
    assert np.max(np.abs(ratio - 1.0)) < 5e-3


# 8 parameters in each of 50 runs with another noise.
@pytest.mark.slow
def test_95_percent_bands_hold_the_true_parameters_in_90_to_99_percent_of_cases():
    excitation = build_stepped_sine(np.geomspace(50.0, 15000.0, 40), 0.5, TS, dwell_s=0.03)
    truth = TABLE_2
    held = []
    for seed in range(50):
        fit = fit_dynamics(measure(RigParameters(order='lumped', seed=seed), excitation))
        for name, value in truth.items():
            low, high = fit.confidence_interval(name)
            held.append(low <= value <= high)
    assert len(held) == 400
    assert 0.90 <= np.mean(held) <= 0.99


def test_standard_errors_are_the_scatter_of_the_parameters():
    # As the slow test above, but quick: no rig, errors of known size.
    frequency = np.geomspace(50.0, 15000.0, 40)
    truth = TABLE_2
    response = sampled_truth(DynamicsParameters(), frequency)
    deviations = []
    for seed in range(40):
        fit = fit_dynamics(synthetic(frequency, response, 2e-4, seed))
        deviations.append([
            (fit.values[name] - truth[name]) / fit.standard_errors[name] for name in truth])
    assert np.std(deviations, axis=0) == pytest.approx(1.0, abs=0.35)
    assert np.abs(np.mean(deviations, axis=0)).max() < 0.5


def test_the_standard_error_of_the_response_is_its_scatter():
    frequency = np.geomspace(50.0, 15000.0, 40)
    response = sampled_truth(DynamicsParameters(), frequency)
    ratios = []
    for seed in range(40):
        fit = fit_dynamics(synthetic(frequency, response, 2e-4, seed))
        error = fit.sampled_response(frequency) - response
        ratios.append(np.abs(error)**2 / fit.response_standard_error(frequency)**2)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.2)


def test_points_of_little_confidence_count_little():
    frequency = np.geomspace(50.0, 15000.0, 60)
    response = sampled_truth(DynamicsParameters(), frequency)
    error = np.where(np.arange(60) % 2, 1e-5, 1e-2)
    measured = synthetic(frequency, response, error)
    fit = fit_dynamics(measured)
    assert np.max(np.abs(fit.sampled_response(frequency) / response - 1.0)) < 1e-3


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('orders', [None, (0, 1), (2, 3), (3, 6)])
def test_the_model_is_stable_even_when_fitted_to_noise(seed, orders):
    generator = np.random.default_rng(seed)
    frequency = np.geomspace(10.0, 5000.0, 30)
    measured = synthetic(
        frequency, generator.normal(size=30) + 1j * generator.normal(size=30), 1e-3)
    if orders is None:
        fit = fit_dynamics(measured)
    else:
        fit = fit_dynamics(
            measured, structure='rational', numerator_order=orders[0], denominator_order=orders[1])
    assert np.all(fit.transfer_function.poles().real < 0.0)


@pytest.mark.parametrize(('shape', 'vector'), [
    (Shape(0, 1, 0), [-0.5, 0.9]),
    (Shape(1, 0, 1), [-0.2, -1.0, 1.0, 0.3]),
    (Shape(3, 0, 2), [-0.2, -1.0, -1.0, 0.0, 1.0, 0.3, -0.1, 0.2]),
    (Shape(2, 1, 2), [-1.0, -0.5, 0.1, -1.0, 0.4, 1.0, -0.2, 0.3]),
])
def test_the_sampled_response_is_that_of_the_exact_discretisation(shape, vector):
    reference = 2.0 * np.pi * 20000.0
    sections = Sections.split(shape, np.array(vector), 0.0)
    frequency = np.geomspace(20.0, 20000.0, 50)
    exact = control.c2d(control.ss(control.tf(*polynomials(sections, reference))), TS)
    expected = np.squeeze(exact(np.exp(2j * np.pi * frequency * TS)))
    found, _ = sampled_response(
        sections, 2.0 * np.pi * frequency / reference, reference * TS)
    assert np.max(np.abs(found - expected)) < 1e-5 * np.max(np.abs(expected))


@pytest.mark.parametrize(('shape', 'vector', 'delay_samples'), [
    (Shape(0, 1, 0, True), [-0.5, 0.9, 0.05], 2.3),
    (Shape(2, 1, 2), [-1.0, -0.5, 0.1, -1.0, 0.4, 1.0, -0.2, 0.3], 0.0),
    (Shape(3, 0, 2, True), [-0.2, -1.0, -1.0, 0.0, 1.0, 0.3, -0.1, 0.2, 0.1], 1.0),
])
def test_the_analytic_derivatives_are_those_of_small_differences(shape, vector, delay_samples):
    omega, period = np.geomspace(1e-3, 1.0, 20), 1.2
    base = np.array(vector)

    def value(x):
        return sampled_response(Sections.split(shape, x, delay_samples * period), omega, period)

    _, jacobian = value(base)
    for i in range(base.size):
        step = np.zeros(base.size)
        step[i] = 1e-6
        difference = (value(base + step)[0] - value(base - step)[0]) / 2e-6
        assert np.max(np.abs(difference - jacobian[:, i])) < 1e-6 * np.max(np.abs(jacobian))


def half_sample_delayed(frequency_hz):
    """0.9/(1 + 3e-4 s), half a sample late, behind a hold: by the modified z-transform."""
    z = np.exp(2j * np.pi * frequency_hz * TS)
    pole, half = np.exp(-TS / 3e-4), np.exp(-0.5 * TS / 3e-4)
    return 0.9 * ((1.0 - half) + half * (1.0 - half) / z) / (z - pole)


def test_a_rational_model_with_delay_is_found():
    frequency = np.geomspace(20.0, 10000.0, 60)
    late = half_sample_delayed(frequency) * np.exp(-2j * np.pi * frequency * 7 * TS)
    fit = fit_dynamics(
        synthetic(frequency, late, 1e-5), structure='rational', numerator_order=0,
        denominator_order=1, fit_delay=True)
    assert fit.delay_s == pytest.approx(7.5 * TS, rel=1e-4)
    assert fit.values['rate_1_rad_per_s'] == pytest.approx(1.0 / 3e-4, rel=1e-3)
    assert fit.values['numerator_s0'] == pytest.approx(0.9, rel=1e-3)
    assert abs(fit.values['delay_s'] - 7.5 * TS) < 5.0 * fit.standard_errors['delay_s']
    assert np.max(np.abs(fit.sampled_response(frequency) - late)) < 1e-4


def test_a_known_delay_is_taken_out_of_the_dynamics():
    frequency = np.geomspace(50.0, 15000.0, 50)
    response = sampled_truth(DynamicsParameters(), frequency)
    late = response * np.exp(-2j * np.pi * frequency * 2 * TS)
    fit = fit_dynamics(synthetic(frequency, late, 1e-6), delay_samples=2)
    assert fit.parameters.time_constant_s == pytest.approx(1.5997e-4, rel=1e-3)
    assert np.max(np.abs(fit.sampled_response(frequency) - late)) < 1e-5
    assert fit.delay_s == pytest.approx(2 * TS)


@pytest.mark.parametrize('orders', [(2, 5), (3, 5), (4, 6)])
def test_a_rational_model_of_enough_order_fits_table_2(orders):
    frequency = np.geomspace(50.0, 15000.0, 60)
    response = sampled_truth(DynamicsParameters(), frequency)
    fit = fit_dynamics(
        synthetic(frequency, response, 1e-5), structure='rational', numerator_order=orders[0],
        denominator_order=orders[1])
    assert np.max(np.abs(fit.sampled_response(frequency) - response)) < 1e-4
    assert fit.transfer_function.poles().size == orders[1]


def test_the_transfer_function_is_the_model():
    frequency = np.geomspace(50.0, 15000.0, 40)
    fit = fit_dynamics(
        synthetic(frequency, sampled_truth(DynamicsParameters(), frequency), 1e-6))
    transfer = fit.transfer_function
    assert isinstance(transfer, control.TransferFunction)
    expected = LinearDynamics(fit.parameters).response(frequency)
    assert np.squeeze(transfer(2j * np.pi * frequency)) == pytest.approx(expected, rel=1e-9)
    assert fit.response(frequency) == pytest.approx(expected, rel=1e-9)


def test_points_above_the_wanted_frequency_are_ignored():
    frequency = np.geomspace(50.0, 15000.0, 60)
    response = sampled_truth(DynamicsParameters(), frequency)
    spoiled = np.where(frequency > 9000.0, 5.0, response)
    fit = fit_dynamics(synthetic(frequency, spoiled, 1e-6), maximum_frequency_hz=9000.0)
    low = frequency[frequency < 9000.0]
    assert np.max(np.abs(
        fit.sampled_response(low) - sampled_truth(DynamicsParameters(), low))) < 1e-4
    assert fit.frequency_range_hz[1] < 9000.0


def test_the_trajectory_node_loads_the_parameter_file_unchanged():
    frequency = np.geomspace(50.0, 15000.0, 40)
    fit = fit_dynamics(
        synthetic(frequency, sampled_truth(DynamicsParameters(), frequency), 1e-5))
    text = fit.to_parameter_yaml('bags/dynamics_1\nbags/dynamics_2')
    loaded = yaml.safe_load(text)
    assert list(loaded) == ['/**/trajectory', '/**/identified_dynamics']
    parameters = loaded['/**/trajectory']['ros__parameters']
    assert parameters == {
        **fit.values, 'hysteresis_place': 'undecided', 'model_response': 'sampled'}
    assert TrajectoryParameters.from_mapping(parameters).dc_gain == fit.parameters.dc_gain
    assert '# source: bags/dynamics_1' in text
    assert '# source: bags/dynamics_2' in text
    assert 'format_version: 1' in text
    for name, error in fit.standard_errors.items():
        line = next(line for line in text.splitlines() if line.strip().startswith(name))
        assert f'# standard error {error:.3g}' in line


def test_another_structure_is_written_as_sections_that_the_node_loads():
    frequency = np.geomspace(50.0, 15000.0, 40)
    fit = fit_dynamics(
        synthetic(frequency, half_sample_delayed(frequency), 1e-5), structure='rational',
        numerator_order=1, denominator_order=3, fit_delay=True)
    parameters = yaml.safe_load(fit.to_parameter_yaml('a bag'))['/**/trajectory'][
        'ros__parameters']
    assert parameters['dynamics'] == 'sections'
    loaded = LinearDynamics(DynamicsParameters.among(parameters))
    assert loaded.delay_s == fit.delay_s
    assert loaded.sampled_response(frequency, TS) == pytest.approx(
        fit.sampled_response(frequency), rel=1e-4)
    assert TrajectoryParameters.among(parameters).hysteresis_place == 'undecided'
    assert fit.parameters == loaded.parameters


def test_a_model_of_negative_gain_is_no_stage():
    frequency = np.geomspace(50.0, 15000.0, 40)
    fit = fit_dynamics(
        synthetic(frequency, -half_sample_delayed(frequency), 1e-5), structure='auto')
    assert fit.parameters is None
    with pytest.raises(ValueError, match=r'the dc gain of the model is -0\.9'):
        fit.to_parameter_yaml('a bag')


@pytest.mark.parametrize(('options', 'words'), [
    ({'structure': 'fir'}, "structure is 'fir'"),
    ({'structure': 'rational'}, 'needs numerator_order'),
    ({'structure': 'rational', 'numerator_order': 3, 'denominator_order': 3},
     'numerator_order is 3 and denominator_order 3'),
    ({'numerator_order': 3}, "belong to structure 'rational'"),
    ({'delay_samples': -1}, 'delay_samples is -1'),
    ({'maximum_frequency_hz': 60.0}, 'cannot determine 8 parameters'),
])
def test_an_impossible_request_is_refused_by_name(options, words):
    frequency = np.geomspace(50.0, 15000.0, 20)
    measured = synthetic(frequency, sampled_truth(DynamicsParameters(), frequency), 1e-5)
    with pytest.raises(ValueError, match=words):
        fit_dynamics(measured, **options)
