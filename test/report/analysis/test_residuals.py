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

from piezo_ros.report.analysis.residuals import autocorrelation


@pytest.mark.parametrize('is_complex', [False, True])
def test_about_one_lag_in_twenty_of_white_noise_is_outside(is_complex):
    generator = np.random.default_rng(2)
    outside = []
    for _ in range(60):
        noise = generator.standard_normal(400)
        if is_complex:
            noise = noise + 1j * generator.standard_normal(400)
        outside.append(autocorrelation(noise).outside_percent)
    assert 3.0 < np.mean(outside) < 7.0


def test_a_slow_residual_is_not_white():
    found = autocorrelation(np.sin(np.arange(1000) / 60.0))
    assert found.outside_percent > 80.0
    assert found.value[0] > 0.95


def test_of_nothing_nothing_is_said():
    assert autocorrelation(np.ones(9)) is None
    assert autocorrelation(np.zeros(100)) is None
