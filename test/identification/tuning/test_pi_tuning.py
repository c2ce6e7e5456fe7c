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

import math

import control
import numpy as np
import pytest
import yaml

from piezo_ros import paper
from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.identification.tuning.itae import itae
from piezo_ros.identification.tuning.pi_loop import PiLoop
from piezo_ros.identification.tuning.pi_tuning import tune_pi
from piezo_ros.model import LinearDynamics

TS = 1e-5
PUBLISHED = (paper.TABLE_2['proportional_gain'], paper.TABLE_2['integral_gain_per_s'])
UNLIMITED = {'max_sensitivity': math.inf, 'uncertainty_limit': math.inf}


def published_bound(frequency_hz):
    s = 2j * np.pi * frequency_hz
    w = paper.UNCERTAINTY_BOUND
    return w['gain'] * (s + w['zero_rad_per_s'])**2 / (
        (s + w['pole_1_rad_per_s']) * (s + w['pole_2_rad_per_s']))


def test_the_free_optimum_of_the_printed_model_is_the_one_found_before():
    tuning = tune_pi(
        LinearDynamics(), bound=published_bound, sample_period_s=None, start=PUBLISHED, **UNLIMITED)
    assert tuning.proportional_gain == pytest.approx(0.658, rel=0.01)
    assert tuning.integral_gain_per_s == pytest.approx(3.92e3, rel=0.01)
    assert tuning.objective_before / tuning.objective_after == pytest.approx(2.6, abs=0.06)
    assert tuning.after.feedback_acceptable_frequency_hz == pytest.approx(677.0, rel=0.005)
    assert tuning.after.weighted_peak == pytest.approx(0.426, rel=0.01)
    assert tuning.active_limits == ()


def test_no_gains_nearby_are_better():
    tuning = tune_pi(LinearDynamics(), max_sensitivity=1.5)
    best = tuning.after
    kp, ki = tuning.proportional_gain, tuning.integral_gain_per_s
    steps = round(8e-3 / TS)
    least = itae(best.loop, None, TS, steps)
    compared = 0
    for angle in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False):
        other = best.loop.with_gains(
            kp * (1.0 + 0.05 * math.cos(angle)), ki * (1.0 + 0.05 * math.sin(angle)))
        if np.abs(other.sensitivity(best.frequency_hz)).max() <= 1.5:
            compared += 1
            assert itae(other, None, TS, steps) > least
    assert 6 < compared < 18  # the optimum lies on the limit, so a part of them is not allowed


@pytest.mark.parametrize(('limits', 'active', 'value'), [
    ({'max_sensitivity': 1.4}, 'max_sensitivity', 1.4),
    ({'uncertainty_limit': 0.3}, 'uncertainty_limit', 0.3),
])
def test_a_limit_that_matters_is_reached_and_never_exceeded(limits, active, value):
    tuning = tune_pi(LinearDynamics(), bound=published_bound, **limits)
    free = tune_pi(LinearDynamics(), bound=published_bound)
    reached = {
        'max_sensitivity': tuning.after.max_sensitivity,
        'uncertainty_limit': tuning.after.weighted_peak}[active]
    assert tuning.active_limits == (active,)
    assert 0.99 * value < reached <= value
    assert tuning.objective_after > free.objective_after


def test_delay_makes_the_gains_smaller():
    gains = [
        tune_pi(LinearDynamics(), measurement_delay_samples=delay).proportional_gain
        for delay in (0, 1, 10)]
    assert gains[0] > gains[1] > gains[2]


def test_the_gains_of_a_scan_are_better_for_it_than_those_of_a_step():
    scan = TrajectoryParameters(frequency_hz=500.0, periods=4.0)
    for_scan = tune_pi(LinearDynamics(), objective=scan)
    for_step = tune_pi(LinearDynamics())
    compared = tune_pi(
        LinearDynamics(), objective=scan,
        start=(for_step.proportional_gain, for_step.integral_gain_per_s))
    assert for_scan.objective_after < 0.99 * compared.objective_before
    assert for_scan.after.max_sensitivity <= 2.0
    assert '500 Hz' in for_scan.objective


def test_the_step_is_weighted_as_a_simulated_one():
    loop = PiLoop.of(LinearDynamics(), *PUBLISHED, TS, 2)
    a, b, c, d = loop.error_system(TS)
    state, total = np.zeros((a.shape[0], 1)), 0.0
    for k in range(600):
        error = float((c @ state + d)[0, 0])
        total += k * TS * abs(error) * TS
        state = a @ state + b
    assert itae(loop, None, TS, 600) == pytest.approx(total, rel=1e-4)
    assert itae(loop, np.ones(600), TS, 600) == pytest.approx(
        itae(loop, None, TS, 600), rel=1e-9)


def test_the_crossover_start_stands_at_0_45_of_the_ultimate_gain():
    before = tune_pi(LinearDynamics()).before.loop
    ultimate = before.with_gains(before.proportional_gain / 0.45, 0.0)
    assert ultimate.slowest_decay(TS) == pytest.approx(1.0, abs=2e-3)


def test_a_lightly_damped_stage_is_given_an_integral_controller_that_is_stable():
    w = 2 * np.pi * 300.0
    tuning = tune_pi(control.tf([w**2], [1.0, 0.04 * w, w**2]))
    assert tuning.objective_before == math.inf  # what the crossover method proposes is unstable
    assert tuning.after.stable
    assert tuning.after.max_sensitivity <= 2.0
    # Half the gain at which the resonance (|G| = 25) would start to ring.
    assert tuning.integral_gain_per_s == pytest.approx(0.5 * 0.04 * w, rel=0.02)


def test_the_parameter_file_gives_the_controller_its_gains_with_all_digits():
    tuning = tune_pi(LinearDynamics(), bound=published_bound, measurement_delay_samples=3)
    text = tuning.to_parameter_yaml(source='dynamics.yaml\nuncertainty.yaml')
    values = yaml.safe_load(text)['/**/controller']['ros__parameters']
    controller = ControllerParameters.from_mapping(values)
    assert controller.proportional_gain == tuning.proportional_gain
    assert controller.integral_gain_per_s == tuning.integral_gain_per_s
    assert controller.measurement_delay_samples == 3
    assert '# source: dynamics.yaml\n# source: uncertainty.yaml\n' in text


@pytest.mark.parametrize(('arguments', 'words'), [
    ({'max_sensitivity': 1.0}, 'max_sensitivity is 1.0'),
    ({'uncertainty_limit': 0.0}, 'uncertainty_limit is 0.0'),
    ({'objective': 'ise'}, "objective is 'ise', allowed are itae_step, itae_scan"),
    ({'start': 'zero'}, "start is 'zero'"),
    ({'bound': lambda f: 1.2 + 0.0 * f}, r'\|W\| is 1.2 at low frequencies'),
    ({'model': control.tf([1.0], [1.0, -1.0])}, 'all must be stable'),
    ({'model': control.tf([-1.0], [1.0, 1.0])}, 'dc gain -1'),
])
def test_what_cannot_be_tuned_is_refused_with_the_reason(arguments, words):
    with pytest.raises(ValueError, match=words):
        tune_pi(**{'model': LinearDynamics(), **arguments})
