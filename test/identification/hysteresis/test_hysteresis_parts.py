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

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from piezo_ros.identification.estimation.least_squares import NormalEquations, minimise
from piezo_ros.identification.hysteresis.hysteresis_validation import cross_validate
from piezo_ros.identification.hysteresis.models.bouc_wen import BoucWenModel
from piezo_ros.identification.hysteresis.mrc_fit import (
    PlayModel,
    elements_of_plays,
)
from piezo_ros.identification.hysteresis.mrc_start import plays_of_rising_curve
from piezo_ros.identification.hysteresis.records import (
    accumulate,
    make_records,
    predict,
    reversals_of,
)
from piezo_ros.model import MaxwellResistiveCapacitor

PLAYS = np.array([0.7, 0.2, 0.1, 0.25, 0.1, 0.5, 1.1, 0.0, 0.03])
VOLTAGE = 2.0 * np.sin(np.linspace(0.0, 30.0, 9000)) * np.linspace(1.0, 0.2, 9000)


@pytest.mark.parametrize('delay', [0.0, 0.37, 2.0, 5.9, -1.6])
def test_plays_and_the_mrc_elements_they_stand_for_are_the_same_operator(delay):
    theta = PLAYS.copy()
    theta[-2] = delay
    prediction = predict(PlayModel(3), make_records(VOLTAGE, VOLTAGE), theta)[0]
    kappa, saturation, _ = elements_of_plays(theta)
    operator = MaxwellResistiveCapacitor(tuple(kappa), tuple(saturation))
    undelayed = operator.forward(VOLTAGE)[0] + 0.03
    at = np.arange(20, VOLTAGE.size - 20)
    expected = np.interp(at - delay, np.arange(VOLTAGE.size), undelayed)
    np.testing.assert_allclose(prediction[at], expected, atol=1e-12)


def test_the_derivatives_of_the_elements_are_those_of_differences():
    _, _, jacobian = elements_of_plays(PLAYS)
    for i in range(PLAYS.size):
        step = np.zeros(PLAYS.size)
        step[i] = 1e-6
        high = np.concatenate(elements_of_plays(PLAYS + step)[:2])
        low = np.concatenate(elements_of_plays(PLAYS - step)[:2])
        np.testing.assert_allclose(jacobian[:, i], (high - low) / 2e-6, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(('model', 'theta'), [
    (PlayModel(3), np.array([0.7, 0.2, 0.1, 0.25, 0.1, 0.5, 1.1, 0.4, 0.03])),
    (BoucWenModel(), np.array([1.3, 0.5, 0.8, 0.3, 0.03])),
    (BoucWenModel(), np.array([1.3, 0.5, 0.4, -0.9, 0.03])),
])
def test_the_gradient_is_that_of_differences(model, theta):
    rng = np.random.default_rng(1)
    displacement = VOLTAGE + 0.1 * rng.normal(size=VOLTAGE.size)
    displacement[rng.integers(0, VOLTAGE.size, 500)] = np.nan
    records = make_records([VOLTAGE, -VOLTAGE], [displacement, -displacement])
    normal = accumulate(model, records, theta)
    assert normal.samples == 2 * int(np.isfinite(displacement).sum())
    for i in range(theta.size):
        step = np.zeros(theta.size)
        step[i] = 1e-6
        slope = (accumulate(model, records, theta + step).cost
                 - accumulate(model, records, theta - step).cost) / 2e-6
        assert -2.0 * normal.gradient[i] == pytest.approx(slope, rel=1e-5, abs=1e-3)


def test_the_rising_curve_gives_the_bends_of_the_mrc_model():
    voltage = np.linspace(0.0, 3.0, 2500)
    displacement = MaxwellResistiveCapacitor().forward(voltage)[0]
    theta = plays_of_rising_curve(voltage, displacement, 10)
    predicted = predict(PlayModel(10), make_records(voltage, displacement), theta)[0]
    assert np.abs(predicted - displacement).max() < 2e-3
    assert theta[:11].min() > 0.0


def test_bounded_least_squares_agree_with_another_solver():
    rng = np.random.default_rng(3)
    for _ in range(20):
        matrix, wanted = rng.normal(size=(40, 6)), rng.normal(size=40)

        def evaluate(theta, matrix=matrix, wanted=wanted):
            residual = wanted - matrix @ theta
            return NormalEquations(
                float(residual @ residual), matrix.T @ residual, matrix.T @ matrix, 40)

        lower, upper = np.full(6, -0.1), np.full(6, 0.05)
        theta, _ = minimise(evaluate, np.zeros(6), lower, upper)
        np.testing.assert_allclose(
            theta, lsq_linear(matrix, wanted, (lower, upper), tol=1e-14).x, atol=1e-6)


def test_a_parameter_between_equal_bounds_stays():
    def evaluate(theta):
        residual = np.array([1.0, 2.0]) - theta
        return NormalEquations(float(residual @ residual), residual, np.eye(2), 2)

    fixed = np.array([-np.inf, 0.5]), np.array([np.inf, 0.5])
    theta, _ = minimise(evaluate, np.zeros(2), *fixed)
    np.testing.assert_allclose(theta, [1.0, 0.5], atol=1e-6)


def test_reversals_are_where_the_voltage_turns_and_not_where_it_trembles():
    turns = np.cumsum([0, 300, 500, 400, 200])
    voltage = np.interp(np.arange(1401), turns, [0.0, 3.0, -2.0, 2.0, 0.0])
    assert reversals_of(voltage).tolist() == [300, 800, 1200]
    trembling = voltage + 0.01 * np.random.default_rng(0).uniform(-1.0, 1.0, voltage.size)
    np.testing.assert_allclose(reversals_of(trembling), [300, 800, 1200], atol=3)


def test_no_fold_is_predicted_from_itself():
    records = make_records(VOLTAGE, VOLTAGE)
    seen = np.zeros(VOLTAGE.size)

    def forgetful(part):
        seen[:] += part[0].weight
        # Correct on the training samples, wrong on the others.
        return [np.where(part[0].weight > 0.0, VOLTAGE, VOLTAGE + 7.0)]

    np.testing.assert_allclose(cross_validate(records, forgetful)[0], 49.0)
    assert set(seen) == {4.0}
