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

"""What a model leaves of the loops of each amplitude, and at which orders of a scan."""

import numpy as np
import pytest

from piezo_ros.identification.hysteresis.levels import level_errors
from piezo_ros.identification.hysteresis.records import make_records

SAMPLES = 960  # of a loop


def triangle():
    """Return some periods of a triangle of 2 V, from its middle on, and their phase in turns."""
    turns = np.arange(4 * SAMPLES) / SAMPLES
    return 4.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * turns)), turns


def largest(voltage_v, residual_um, noise_rms_um=0.0):
    """Return what is left of the whole loops."""
    (record,) = make_records(voltage_v, voltage_v)
    return level_errors([record], residual_um, noise_rms_um)[-1]


@pytest.mark.parametrize('order', [1, 2, 3, 7, 12])
def test_what_is_left_is_told_at_its_order(order):
    voltage_v, turns = triangle()
    level = largest(voltage_v, 0.02 * np.sin(2.0 * np.pi * order * turns + 0.3))
    assert level.mean_square_um2.sum() == pytest.approx(0.5 * 0.02**2, rel=0.25)
    assert level.mean_square_um2[order - 1] > 0.9 * level.mean_square_um2.sum()


def test_noise_is_not_taken_for_what_is_left():
    voltage_v, _ = triangle()
    noise_um = 0.01 * np.random.default_rng(3).standard_normal(voltage_v.size)
    level = largest(voltage_v, noise_um, 0.01)
    assert np.sqrt(level.mean_square_um2.sum()) < 0.1 * 0.01


def test_a_loop_with_bins_that_are_empty_is_told_of_the_others():
    voltage_v, turns = triangle()
    residual_um = np.sin(2.0 * np.pi * turns)
    residual_um[np.abs(voltage_v - 0.5) < 0.1] = np.nan
    level = largest(voltage_v, residual_um)
    assert level.mean_square_um2.sum() == pytest.approx(0.5, rel=0.1)
    residual_um[np.arange(voltage_v.size) % 80 != 0] = np.nan
    assert not largest(voltage_v, residual_um).mean_square_um2.any()
