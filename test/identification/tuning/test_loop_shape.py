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

from piezo_ros import paper
from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.identification.tuning.linear_plant import LinearPlant
from piezo_ros.identification.tuning.loop_shape import loop_shape
from piezo_ros.identification.tuning.pi_loop import PiLoop
from piezo_ros.model import HysteresisParameters, LinearDynamics, RigParameters

TS = 1e-5
PUBLISHED = (paper.TABLE_2['proportional_gain'], paper.TABLE_2['integral_gain_per_s'])


def published_bound():
    w = paper.UNCERTAINTY_BOUND
    zero, pole_1, pole_2 = w['zero_rad_per_s'], w['pole_1_rad_per_s'], w['pole_2_rad_per_s']
    return control.tf(
        w['gain'] * np.polymul([1.0, zero], [1.0, zero]),
        np.polymul([1.0, pole_1], [1.0, pole_2]))


def test_the_published_loop_has_the_published_shape():
    shape = loop_shape(LinearDynamics(), *PUBLISHED, bound=published_bound())
    assert shape.stable
    assert shape.feedback_acceptable_frequency_hz == pytest.approx(425.3, abs=0.3)
    assert shape.bandwidth_hz == pytest.approx(705.0, abs=0.5)
    assert shape.max_sensitivity == pytest.approx(1.393, abs=5e-4)
    assert shape.gain_margin == pytest.approx(5.22, abs=5e-3)
    assert shape.phase_margin_deg == pytest.approx(64.2, abs=0.05)
    assert shape.weighted_peak == pytest.approx(0.207, abs=5e-4)


def test_the_free_optimum_has_the_shape_that_was_found_before():
    shape = loop_shape(LinearDynamics(), 0.658, 3.92e3, bound=published_bound())
    assert shape.feedback_acceptable_frequency_hz == pytest.approx(677.0, abs=0.5)
    assert shape.weighted_peak == pytest.approx(0.426, abs=5e-4)


def test_the_margins_are_those_of_python_control():
    model = LinearDynamics().transfer_function
    shape = loop_shape(model, 0.5, 3000.0)
    expected = control.stability_margins(control.tf([0.5, 3000.0], [1.0, 0.0]) * model)
    assert shape.gain_margin == pytest.approx(expected[0], rel=1e-6)
    assert shape.phase_margin_deg == pytest.approx(expected[1], rel=1e-6)
    assert shape.crossover_frequency_hz == pytest.approx(expected[4] / (2 * np.pi), rel=1e-6)
    assert shape.delay_margin_s == pytest.approx(
        math.radians(expected[1]) / expected[4], rel=1e-6)


def test_a_gain_raised_by_the_margin_or_a_delay_of_the_margin_ends_the_stability():
    shape = loop_shape(
        LinearDynamics(), *PUBLISHED, sample_period_s=TS, measurement_delay_samples=1)
    for factor, stable in ((0.999, True), (1.001, False)):
        gains = [gain * shape.gain_margin * factor for gain in PUBLISHED]
        assert PiLoop.of(LinearDynamics(), *gains, TS, 1).is_stable is stable
        delayed = LinearPlant(
            *LinearDynamics().polynomials, delay_s=shape.delay_margin_s * factor)
        assert PiLoop.of(delayed, *PUBLISHED, TS, 1).is_stable is stable


@pytest.mark.parametrize('delay', [0, 1, 3])
def test_the_sampled_loop_is_what_controller_and_rig_do_step_by_step(delay):
    rig = RigParameters(
        order='lumped', noise_rms_um=0.0, dac_bits=0, adc_bits=0, voltage_minimum_v=-100.0,
        voltage_maximum_v=100.0, adc_span_v=1000.0)
    law = ControllerParameters(scheme='fb', measurement_delay_samples=delay)
    run = simulate(rig, HysteresisParameters(), law, TrajectoryParameters(periods=2.0))
    a, b, c, d = PiLoop.of(LinearDynamics(), *PUBLISHED, TS, delay).error_system(TS)
    state, error = np.zeros((a.shape[0], 1)), []
    for reference in run.reference_um:
        error.append(float((c @ state + d * reference)[0, 0]))
        state = a @ state + b * reference
    np.testing.assert_allclose(error, run.reference_um - run.displacement_um[:-1], atol=1e-10)


def test_sampling_and_delay_cost_some_of_every_margin():
    ideal = loop_shape(LinearDynamics(), *PUBLISHED)
    sampled = loop_shape(LinearDynamics(), *PUBLISHED, sample_period_s=TS)
    late = loop_shape(
        LinearDynamics(), *PUBLISHED, sample_period_s=TS, measurement_delay_samples=1)
    for better, worse in ((ideal, sampled), (sampled, late)):
        assert worse.gain_margin < better.gain_margin
        assert worse.phase_margin_deg < better.phase_margin_deg
        assert worse.max_sensitivity > better.max_sensitivity
    # A measurement one sample older leaves one sample less of delay margin.
    assert sampled.delay_margin_s - late.delay_margin_s == pytest.approx(TS, rel=1e-6)
    assert late.feedback_acceptable_frequency_hz == pytest.approx(415.0, abs=0.1)


def test_the_peak_of_a_sharp_resonance_is_found():
    w, zeta = 2 * np.pi * 300.0, 0.002
    shape = loop_shape(control.tf([w**2], [1.0, 2 * zeta * w, w**2]), 0.0, 4.0)
    # At resonance |G| is 1/(2 zeta), its phase -90 degrees, that of K another -90.
    loop_at_peak = 4.0 / w / (2 * zeta)
    assert shape.max_sensitivity == pytest.approx(1.0 / (1.0 - loop_at_peak), rel=1e-2)
    assert shape.gain_margin == pytest.approx(1.0 / loop_at_peak, rel=1e-6)


def test_a_first_order_loop_has_no_end():
    shape = loop_shape(control.tf([1000.0], [1.0, 1000.0]), 2.0, 2000.0)
    assert shape.gain_margin == math.inf
    assert shape.feedback_acceptable_frequency_hz == math.inf
    assert shape.bandwidth_hz == pytest.approx(2000.0 / (2 * np.pi), rel=1e-6)
    assert shape.phase_margin_deg == pytest.approx(90.0, abs=1e-6)
    assert shape.record()['gain_margin'] is None


def test_an_unstable_loop_is_called_so():
    assert not loop_shape(LinearDynamics(), 3.0, 2.63e3).stable


def test_a_proportional_loop_may_be_stable():
    assert loop_shape(LinearDynamics(), 0.3, 0.0).stable
    assert loop_shape(LinearDynamics(), 0.3, 0.0, sample_period_s=TS).stable


@pytest.mark.parametrize(('arguments', 'words'), [
    ({'proportional_gain': -0.1}, 'proportional_gain is -0.1'),
    ({'integral_gain_per_s': math.nan}, 'integral_gain_per_s is nan'),
    ({'proportional_gain': 0.0, 'integral_gain_per_s': 0.0}, 'both gains are 0'),
    ({'sample_period_s': 0.0}, 'sample_period_s is 0.0'),
    ({'measurement_delay_samples': -1}, 'measurement_delay_samples is -1'),
    ({'measurement_delay_samples': 1}, 'needs its sample_period_s'),
])
def test_what_makes_no_loop_is_refused_by_name(arguments, words):
    gains = {'proportional_gain': 0.2, 'integral_gain_per_s': 2e3}
    with pytest.raises(ValueError, match=words):
        loop_shape(LinearDynamics(), **{**gains, **arguments})
