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

"""Any stage is identified, or the verdict says where not; standard errors and bands are honest."""

import dataclasses

import numpy as np
import pytest
import yaml
from independent_stages import ORDERS, STAGES, lag, measured, mode, parallel, slowed, truth

from piezo_ros.identification.dynamics.dynamics_fit import fit_dynamics

TS = 1e-4
BAND_HZ = np.geomspace(20.0, 3000.0, 50)


def orders_of(name):
    numerator, denominator, delay = ORDERS[name]
    return {
        'structure': 'rational', 'numerator_order': numerator, 'denominator_order': denominator,
        'fit_delay': delay}


def assert_usable_as_far_as_it_says(fit, stage, sample_period_s):
    low, _ = fit.frequency_range_hz
    usable = fit.validation.usable_to_hz
    frequency = np.geomspace(low, max(usable, 1.001 * low), 200)
    ratio = fit.sampled_response(frequency) / truth(stage, frequency, sample_period_s)
    assert np.max(np.abs(np.abs(ratio) - 1.0)) < 0.03
    assert np.max(np.abs(np.angle(ratio, deg=True))) < 2.0


@pytest.mark.parametrize('name', [
    'lag before', *(
        pytest.param(name, marks=pytest.mark.slow) for name in STAGES if name != 'lag before')])
def test_the_structure_of_a_stage_is_found(name):
    fit = fit_dynamics(measured(STAGES[name], BAND_HZ, TS, 3e-4), structure='auto')
    assert (*fit.orders, fit.delay_s > 0.0) == ORDERS[name]
    assert fit.validation.usable_to_hz == fit.frequency_range_hz[1]
    assert str(fit.validation.verdict) == 'good'
    assert_usable_as_far_as_it_says(fit, STAGES[name], TS)
    assert len(fit.candidates) > 3


# Eight stages of other sampling frequency, band and noise each.
@pytest.mark.slow
@pytest.mark.parametrize('name', list(STAGES))
@pytest.mark.parametrize('sample_period_s', [5e-4, 1e-5])
@pytest.mark.parametrize('noise', [1e-3, 5e-2])
def test_every_stage_is_within_3_percent_and_2_degrees_where_the_verdict_says_so(
        name, sample_period_s, noise):
    stage = slowed(STAGES[name], sample_period_s / TS)
    frequency = np.geomspace(20.0, 3000.0, 60) * TS / sample_period_s
    fit = fit_dynamics(measured(stage, frequency, sample_period_s, noise), structure='auto')
    assert not fit.validation.verdict.is_poor
    assert_usable_as_far_as_it_says(fit, stage, sample_period_s)


def test_d3_two_close_modes_are_not_bent_by_a_bound():
    stage = STAGES['two close modes']
    fit = fit_dynamics(measured(stage, BAND_HZ, TS, 3e-5))
    shape = fit.sampled_response(BAND_HZ) / truth(stage, BAND_HZ, TS)
    assert np.max(np.abs(shape / shape[0] - 1.0)) < 1e-3
    # The lag that the stage does not have is out of sight, which is told.
    assert 1.0 / fit.values['time_constant_s'] > 100.0 * 2.0 * np.pi * BAND_HZ[-1]
    assert fit.standard_errors['time_constant_s'] == np.inf
    assert 'too fast for the points to determine: rate_1' in str(fit.validation.verdict)


@pytest.mark.parametrize('seed', [
    0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 8))])
def test_d4_a_first_order_stage_is_of_first_order(seed):
    frequency = np.geomspace(5.0, 2000.0, 30)
    points = measured(STAGES['first order'], frequency, TS, 2e-3, seed)
    fit = fit_dynamics(points, structure='auto')
    assert fit.orders == (0, 1)
    assert fit.values['rate_1_rad_per_s'] == pytest.approx(300.0 * np.pi, rel=0.02)
    verdict = fit_dynamics(points, structure='liu').validation.verdict
    assert verdict.is_poor
    assert 'parameters of (6) are not determined by the points' in str(verdict)
    assert 'orders 0 1 explain them as well' in str(verdict)


@pytest.mark.slow
def test_d4_a_resonance_that_one_point_alone_asks_for_is_refused():
    points = measured(STAGES['one mode'], BAND_HZ, TS, 1e-3)
    response = points.response.copy()
    response[10] *= 1.05
    fit = fit_dynamics(dataclasses.replace(points, response=response), structure='auto')
    assert fit.orders == (0, 2)


def test_d5_the_facts_of_a_fit_stand_in_the_file():
    stage = STAGES['antiresonance']
    fit = fit_dynamics(measured(stage, BAND_HZ, TS, 1e-3), **orders_of('antiresonance'))
    facts = yaml.safe_load(fit.to_parameter_yaml('a bag', {'points_file': 'points.csv'}))[
        '/**/identified_dynamics']['ros__parameters']
    assert facts['verdict'] == 'good'
    assert facts['points_file'] == 'points.csv'
    assert facts['usable_to_hz'] == fit.validation.usable_to_hz == BAND_HZ[-1]
    assert facts['fit_percent'] > 99.0
    assert facts['reduced_chi_squared'] == fit.reduced_chi_squared
    assert facts['model_error'] == 0.0
    assert facts['delay_s'] == 0.0
    assert facts['damping_ratio_1_standard_error'] == fit.standard_errors['damping_ratio_1']


def test_d5_a_model_that_misses_its_points_is_not_to_be_trusted():
    fit = fit_dynamics(
        measured(STAGES['four modes'], BAND_HZ, TS, 1e-3), structure='rational',
        numerator_order=0, denominator_order=2)
    verdict = fit.validation.verdict
    assert verdict.is_poor
    assert 'the model misses the points by' in str(verdict)
    assert fit.validation.usable_to_hz < 700.0


def test_a_resonance_between_two_points_limits_what_the_model_is_usable_for():
    stage = STAGES['two close modes']
    few = measured(stage, np.geomspace(17.0, 2600.0, 25), TS, 2e-3)
    fit = fit_dynamics(few, **orders_of('two close modes'))
    assert fit.validation.usable_to_hz < 880.0
    assert_usable_as_far_as_it_says(fit, stage, TS)


def test_d5_a_displacement_that_is_ahead_of_its_command_is_told():
    points = measured(STAGES['one mode'], BAND_HZ, TS, 1e-3)
    early = points.response * np.exp(2j * np.pi * BAND_HZ * 1.5 * TS)
    fit = fit_dynamics(
        dataclasses.replace(points, response=early), **orders_of('mode and delay'))
    assert fit.delay_s == 0.0
    assert fit.validation.verdict.is_poor
    assert 'the phase asks for a delay of -0.00015 s, which no stage has' in str(
        fit.validation.verdict)


def test_d6_standard_errors_of_a_high_order_are_the_scatter_of_its_parameters():
    stage, frequency = STAGES['four modes'], np.geomspace(20.0, 3000.0, 80)
    deviations = []
    reference = None
    for seed in range(10):
        fit = fit_dynamics(measured(stage, frequency, TS, 1e-3, seed), **orders_of('four modes'))
        # A fit to points without noise has the true values.
        reference = reference or fit_dynamics(
            measured(stage, frequency, TS, 1e-9), **orders_of('four modes')).values
        deviations.append([
            (fit.values[name] - reference[name]) / fit.standard_errors[name]
            for name in fit.values if name.startswith('numerator')])
    assert 0.6 < np.sqrt(np.mean(np.square(deviations))) < 1.5


@pytest.mark.slow
def test_d6_what_the_points_do_not_determine_has_no_small_standard_error():
    fit = fit_dynamics(
        measured(STAGES['one mode'], BAND_HZ, TS, 1e-3), structure='rational',
        numerator_order=4, denominator_order=7)
    relative = np.array([
        fit.standard_errors[name] / value for name, value in fit.values.items()
        if name.startswith('natural_frequency')])
    assert np.sum(relative > 0.1) >= 2
    assert fit.validation.verdict.is_poor


def test_the_bootstrap_agrees_with_the_linearised_errors():
    points = measured(STAGES['antiresonance'], BAND_HZ, TS, 3e-3)
    linear = fit_dynamics(points, **orders_of('antiresonance'))
    drawn = fit_dynamics(points, **orders_of('antiresonance'), bootstrap=40)
    assert drawn.values == linear.values
    for name, error in linear.standard_errors.items():
        assert drawn.standard_errors[name] == pytest.approx(error, rel=0.4), name


def coverage(name, seeds):
    stage, frequency = STAGES[name], np.geomspace(20.0, 3000.0, 60)
    checked = np.geomspace(20.0, 3000.0, 37)
    exact = truth(stage, checked, TS)
    inside = []
    for seed in range(seeds):
        fit = fit_dynamics(measured(stage, frequency, TS, 3e-3, seed), **orders_of(name))
        inside.append(
            np.abs(fit.sampled_response(checked) - exact)
            <= fit.response_confidence_radius(checked))
    return np.mean(inside)


def test_d7_the_95_percent_band_covers_95_percent():
    assert 0.92 < coverage('one mode', 40) < 0.98


@pytest.mark.slow
@pytest.mark.parametrize('name', ['one mode', 'antiresonance', 'mode and delay', 'lag before'])
def test_d7_the_band_of_every_stage_covers_95_percent(name):
    assert 0.93 <= coverage(name, 200) <= 0.97


@pytest.mark.slow
@pytest.mark.parametrize('name', ['one mode', 'antiresonance', 'mode and delay', 'lag before'])
def test_95_percent_intervals_hold_the_parameters_in_93_to_97_percent_of_200_seeds(name):
    frequency = np.geomspace(20.0, 3000.0, 60)
    # A fit to points without noise has the true values.
    true = fit_dynamics(measured(STAGES[name], frequency, TS, 1e-9), **orders_of(name)).values
    inside = []
    for seed in range(200):
        fit = fit_dynamics(measured(STAGES[name], frequency, TS, 3e-3, seed), **orders_of(name))
        inside += [
            abs(fit.values[parameter] - true[parameter]) <= 1.96 * error
            for parameter, error in fit.standard_errors.items()]
    assert 0.93 <= np.mean(inside) <= 0.97


@pytest.mark.slow
def test_a_wrong_structure_is_told_in_95_percent_of_cases():
    stage = parallel(mode(500.0, 0.02, 0.9), lag(1500.0)), 0.0
    told = []
    for seed in range(200):
        fit = fit_dynamics(
            measured(stage, BAND_HZ, TS, 2e-3, seed), structure='rational',
            numerator_order=0, denominator_order=2)
        told.append(str(fit.validation.verdict) != 'good')
    assert np.mean(told) >= 0.95


def test_a_bootstrap_of_one_is_refused():
    points = measured(STAGES['one mode'], BAND_HZ, TS, 1e-3)
    with pytest.raises(ValueError, match='bootstrap is 1, allowed is 0 or at least 2'):
        fit_dynamics(points, bootstrap=1)
