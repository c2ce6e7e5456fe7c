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

from piezo_ros.report.error_harmonics import error_harmonics


@pytest.mark.parametrize('samples', [4000, 1333])  # 12 periods, and 3.999
def test_the_amplitudes_and_the_rest_of_a_known_error_are_found(samples):
    cycles = 300.0 * 1e-5
    k = np.arange(samples)
    noise = 0.002 * np.random.default_rng(1).standard_normal(samples)
    error_um = (0.01 + 0.5 * np.sin(2 * np.pi * cycles * k + 0.3)
                + 0.02 * np.cos(2 * np.pi * 7 * cycles * k) + noise)
    found = error_harmonics(error_um, 300.0, 1e-5)
    assert found.harmonics[-1] == 40
    assert found.amplitude_um[0] == pytest.approx(0.5, abs=5e-4)
    assert found.amplitude_um[6] == pytest.approx(0.02, abs=5e-4)
    assert found.mean_um == pytest.approx(0.01, abs=5e-4)
    assert found.rest_rms_um == pytest.approx(0.002, rel=0.1)
    assert np.delete(found.amplitude_um, [0, 6]).max() < 5e-4


def test_what_is_above_the_last_harmonic_is_a_part_of_the_rest():
    k = np.arange(400)
    found = error_harmonics(np.cos(2 * np.pi * 0.47 * k), 0.1, 1.0)
    assert found.harmonics.tolist() == [1, 2, 3, 4]
    assert found.rest_rms_um == pytest.approx(np.sqrt(0.5), rel=0.02)


def test_less_than_a_period_has_no_harmonics():
    found = error_harmonics(np.linspace(0.0, 1.0, 50), 1.0, 1e-2)
    assert found.harmonics.size == 0
    assert found.mean_um == pytest.approx(0.5)
