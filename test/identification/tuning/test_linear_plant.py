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

import control
import numpy as np
import pytest

from piezo_ros.identification import FrequencyResponse, fit_dynamics
from piezo_ros.identification.tuning.linear_plant import LinearPlant, bound_magnitude
from piezo_ros.model import LinearDynamics

TS = 1e-5
FREQUENCY_HZ = np.array([1.0, 300.0, 2000.0, 7000.0, 30000.0, 49000.0])
LAG = control.tf([2000.0], [1.0, 1000.0])


def test_the_sampled_plant_is_that_of_the_state_space_of_the_model():
    exact = LinearDynamics().discrete(TS)
    z = np.exp(2j * np.pi * FREQUENCY_HZ * TS)
    expected = [(exact.c @ np.linalg.solve(one * np.eye(5) - exact.a, exact.b))[0, 0] for one in z]
    sampled = LinearPlant.of(LinearDynamics()).sampled(TS)
    np.testing.assert_allclose(sampled.response(FREQUENCY_HZ), expected, rtol=1e-10)


@pytest.mark.parametrize('delay_samples', [0.0, 1.0, 2.3, 7.999999])
def test_a_delay_of_any_length_is_sampled_exactly(delay_samples):
    plant = LinearPlant(np.array([2000.0]), np.array([1.0, 1000.0]), delay_samples * TS)
    sampled = plant.sampled(TS)
    # The step response of the lag with its delay, at the samples.
    time_s = TS * np.arange(40)
    expected = 2.0 * -np.expm1(-1000.0 * np.maximum(time_s - plant.delay_s, 0.0))
    a, b, c, _ = sampled.system
    state, output = np.zeros((a.shape[0], 1)), []
    for _ in time_s:
        output.append(float((c @ state)[0, 0]))
        state = a @ state + b
    whole = sampled.delay_samples
    output = [0.0] * whole + output[:len(output) - whole]
    np.testing.assert_allclose(output, expected, atol=1e-12)


def test_transfer_functions_of_python_control_are_models_too():
    ours, theirs = LinearPlant.of(LinearDynamics()), LinearPlant.of(
        LinearDynamics().transfer_function)
    np.testing.assert_allclose(
        ours.response(FREQUENCY_HZ), theirs.response(FREQUENCY_HZ), rtol=1e-12)
    assert ours.dc_gain == pytest.approx(LinearDynamics().parameters.dc_gain, rel=1e-12)


def test_an_identified_model_is_sampled_with_its_delay_as_it_was_fitted():
    frequency_hz = np.geomspace(20.0, 5000.0, 60)
    late = LinearPlant(*LinearDynamics().polynomials, delay_s=2.4 * TS)
    one = np.ones(frequency_hz.size)
    fit = fit_dynamics(
        FrequencyResponse(
            frequency_hz, late.sampled(TS).response(frequency_hz), 1e-12 * one, one, 0.0 * one,
            one, 0.0 * one, TS),
        delay_samples=2.4)
    assert LinearPlant.of(fit).delay_s == pytest.approx(2.4 * TS)
    np.testing.assert_allclose(
        LinearPlant.of(fit).sampled(TS).response(frequency_hz),
        fit.sampled_response(frequency_hz), rtol=1e-6)


def test_a_sampled_transfer_function_is_refused():
    with pytest.raises(ValueError, match='sample period 0.1, it must be of continuous time'):
        LinearPlant.of(control.tf([1.0], [1.0, 0.5], 0.1))


def test_several_inputs_are_refused():
    with pytest.raises(ValueError, match='2 inputs and 1 outputs'):
        LinearPlant.of(control.tf([[[1.0], [1.0]]], [[[1.0, 1.0], [1.0, 2.0]]]))


def test_a_plant_that_does_not_fall_off_cannot_be_sampled():
    with pytest.raises(ValueError, match='numerator order 1 and the denominator order 1'):
        LinearPlant.of(control.tf([1.0, 2.0], [1.0, 3.0])).sampled(TS)


def test_a_bound_is_an_object_a_transfer_function_or_a_function():
    class Bound:
        def magnitude(self, frequency_hz):
            return np.abs(2000.0 / (2j * np.pi * np.asarray(frequency_hz) + 1000.0))

    expected = Bound().magnitude(FREQUENCY_HZ)
    for bound in (Bound(), LAG, lambda f: 2000.0 / (2j * np.pi * f + 1000.0)):
        np.testing.assert_allclose(bound_magnitude(bound, FREQUENCY_HZ), expected, rtol=1e-12)
