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

from piezo_ros.identification.hysteresis.models.bouc_wen import BoucWenModel, fit_bouc_wen
from piezo_ros.identification.hysteresis.models.model_comparison import compare_hysteresis_models
from piezo_ros.identification.hysteresis.mrc_fit import PlayModel, fit_prandtl_ishlinskii
from piezo_ros.identification.hysteresis.records import make_records, predict
from piezo_ros.model import MaxwellResistiveCapacitor


def excitation():
    """Return a triangle of decreasing amplitude."""
    amplitude = np.repeat(np.arange(3.0, 0.0, -0.3), 4) * np.tile([0.0, 1.0, 0.0, -1.0], 10)
    return np.interp(np.arange(8000) / 200.0, np.arange(41), np.append(amplitude, 0.0))


def test_the_mrc_model_describes_its_own_data_best():
    voltage = excitation()
    noise = 1e-3 * np.random.default_rng(0).normal(size=voltage.size)
    displacement = MaxwellResistiveCapacitor().forward(voltage)[0] + noise
    scores = compare_hysteresis_models(voltage, displacement)
    assert [score.name for score in scores] == [
        'MRC', 'Prandtl-Ishlinskii', 'Bouc-Wen', 'polynomial']
    assert [score.parameters_count for score in scores] == [21, 11, 4, 5]
    errors = [score.cross_validated_rms_um for score in scores]
    assert errors == sorted(errors)
    assert errors[0] == pytest.approx(1e-3, rel=0.05)
    assert errors[1] > 3e-3
    assert errors[-1] > 0.1  # no memory: half the width of the loop
    for score in scores:
        assert score.residual_um.shape == voltage.shape
        assert np.sqrt(np.nanmean(score.residual_um**2)) == pytest.approx(score.rms_um)


def test_a_delay_is_no_fault_of_any_model():
    voltage = excitation()
    displacement = MaxwellResistiveCapacitor().forward(voltage)[0]
    late = np.concatenate((np.zeros(4), displacement[:-4]))
    noise = 1e-3 * np.random.default_rng(0).normal(size=voltage.size)
    for prompt, delayed in zip(
            compare_hysteresis_models(voltage, displacement + noise),
            compare_hysteresis_models(voltage, late + noise), strict=True):
        # Not the same samples: some after the turns are left out.
        assert delayed.rms_um == pytest.approx(prompt.rms_um, rel=0.1)


def test_bouc_wen_recovers_its_own_parameters():
    voltage = excitation()
    truth = np.array([1.3, 0.6, 0.9, -0.2, 0.05])
    displacement = predict(BoucWenModel(), make_records(voltage, voltage), truth)[0]
    np.testing.assert_allclose(
        fit_bouc_wen(make_records(voltage, displacement)), truth, rtol=1e-4)


def test_prandtl_ishlinskii_recovers_its_own_weights():
    voltage = excitation()
    truth = np.concatenate((
        [0.6, 0.1, 0.2, 0.05, 0.3], np.abs(voltage).max() * np.arange(1, 5) / 5, [0.0, 0.02]))
    displacement = predict(PlayModel(4), make_records(voltage, voltage), truth)[0]
    fitted = fit_prandtl_ishlinskii(make_records(voltage, displacement), 4, 0.0)
    np.testing.assert_allclose(fitted, truth, atol=1e-6)
