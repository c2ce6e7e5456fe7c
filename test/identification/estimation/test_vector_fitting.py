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

"""Poles by vector fitting."""

import numpy as np
import pytest
from independent_stages import STAGES

from piezo_ros.identification.estimation.vector_fitting import initial_poles, vector_fitting


@pytest.mark.parametrize('name', ['first order', 'two close modes', 'lag before', 'four modes'])
def test_the_poles_of_exact_points_are_found(name):
    (numerator, denominator), _ = STAGES[name]
    omega = 2.0 * np.pi * np.geomspace(20.0, 3000.0, 100)
    response = np.polyval(numerator, 1j * omega) / np.polyval(denominator, 1j * omega)
    s = 1j * omega / omega[-1]
    order = denominator.size - 1
    found = vector_fitting(s, response, np.ones(100), initial_poles(order, s))
    exact = np.roots(denominator) / omega[-1]
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(exact), rel=1e-5)


def test_poles_of_noise_are_stable():
    generator = np.random.default_rng(0)
    s = 1j * np.linspace(0.05, 1.0, 40)
    found = vector_fitting(
        s, generator.normal(size=40) + 1j * generator.normal(size=40), np.ones(40),
        initial_poles(7, s))
    assert found.size == 7
    assert np.all(found.real <= 0.0)
