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

"""What the residual of the hysteresis adds to a predicted error."""

import numpy as np
import pytest

from piezo_ros.experiment.model_file import read_accuracy
from piezo_ros.identification.prediction.accuracy import ModelAccuracy


def resonance(frequency_hz):
    """Return the gain of a mode at 300 Hz, over that at rest."""
    ratio = np.asarray(frequency_hz) / 300.0
    return 1.0 / np.abs(1.0 - ratio**2 + 0.04j * ratio)


def test_the_residual_passes_the_dynamics_order_by_order():
    third = ModelAccuracy(order_share=(0.0, 0.0, 1.0))
    first = ModelAccuracy(order_share=(1.0, 0.0, 0.0))
    assert third.residual_gain(100.0, 1e-4, resonance) == pytest.approx(25.0)
    assert first.residual_gain(100.0, 1e-4, resonance) == pytest.approx(resonance(100.0))
    # Of what is at orders that are not sampled nothing is left.
    assert third.residual_gain(100.0, 2e-3, resonance) == 0.0
    unknown = ModelAccuracy().residual_gain(100.0, 1e-4, resonance)
    assert first.residual_gain(100.0, 1e-4, resonance) < unknown < 25.0


def test_the_residual_of_a_loop_is_that_of_its_amplitude_whatever_the_order_of_the_levels():
    for turn in (slice(None), slice(None, None, -1)):
        known = ModelAccuracy(
            level_v=(1.0, 2.0, 4.0)[turn], level_percent=(1.0, 1.0, 1.0)[turn],
            level_rms_um=(0.01, 0.03, 0.02)[turn])
        assert known.residual_um(2.0, 0.0) == pytest.approx(0.03)
        assert known.residual_um(3.0, 0.0) == pytest.approx(0.025)
        assert known.residual_um(9.0, 0.0) == pytest.approx(0.02)
        assert known.residual_um(0.25, 0.0) == pytest.approx(0.005)


def test_the_facts_of_a_model_file_are_read(tmp_path):
    path = tmp_path / 'compensator.yaml'
    path.write_text(
        '/**/identified_hysteresis:\n  ros__parameters:\n    residual_rms_um: 0.04\n'
        '    amplitude_levels_v: [1.0, 4.0]\n    amplitude_residual_percent: [1.0, 1.0]\n'
        '    amplitude_residual_rms_um: [0.01, 0.02]\n    residual_order_shares: [0.25, 0.75]\n')
    accuracy = read_accuracy([path])
    assert accuracy.level_rms_um == (0.01, 0.02)
    assert accuracy.order_share == (0.25, 0.75)
    assert accuracy.residual_um(4.0, 0.0) == 0.02
