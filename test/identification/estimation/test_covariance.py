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

"""Covariances by singular values, and the circle that contains a complex number."""

import numpy as np
import pytest

from piezo_ros.identification.estimation.covariance import Covariance, radius_95


def test_d6_a_covariance_keeps_its_digits_where_the_normal_equations_lose_them():
    # Columns of sizes 1 and 1e-9, nearly parallel.
    x = np.linspace(0.0, 1.0, 50)
    jacobian = np.stack([np.ones(50), 1e-9 * (1.0 + 1e-6 * x)], axis=1)
    found = Covariance.of(jacobian).standard_errors(np.eye(2))
    slope = 1.0 / np.linalg.norm(x - x.mean())  # of a line, in closed form
    assert found[1] == pytest.approx(slope / 1e-15, rel=1e-4)


def test_a_direction_without_effect_is_not_determined():
    jacobian = np.stack([np.ones(5), np.ones(5), np.arange(5.0), np.zeros(5)], axis=1)
    covariance = Covariance.of(jacobian)
    errors = covariance.standard_errors(np.eye(4))
    assert np.isinf(errors[[0, 1, 3]]).all()
    assert errors[2] == pytest.approx(1.0 / np.sqrt(10.0))
    # The sum of the first two is determined.
    assert np.isfinite(covariance.standard_errors(np.array([[1.0, 1.0, 0.0, 0.0]]))).all()


@pytest.mark.parametrize('ratio', [0.0, 0.01, 0.2, 1.0])
def test_the_circle_contains_95_percent_of_normal_errors(ratio):
    turned = np.array([[0.8, -0.6], [0.6, 0.8]])
    covariance = turned @ np.diag([2.0, 2.0 * ratio]) @ turned.T
    radius = radius_95(covariance[None])[0]
    factor = turned @ np.diag(np.sqrt([2.0, 2.0 * ratio]))
    drawn = np.random.default_rng(1).normal(size=(200000, 2)) @ factor.T
    assert np.mean(np.linalg.norm(drawn, axis=1) <= radius) == pytest.approx(0.95, abs=2e-3)
