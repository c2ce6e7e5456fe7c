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

"""Creep out of records: found, told how well, and refused where there is none."""

import numpy as np
import pytest
import yaml

from piezo_ros.identification.creep.creep_fit import fit_creep
from piezo_ros.identification.hysteresis.records import make_records
from piezo_ros.model import CompensatorParameters, HysteresisParameters, Rig, RigParameters

PERIOD_S = 0.05
SAMPLES = 2000
STEP_V = np.concatenate([np.zeros(100), np.full(SAMPLES - 100, 2.0)])
STAIRS_V = np.repeat([0.0, 1.0, 2.0, 0.5, -1.0], SAMPLES // 5)
LINES_V = np.arcsin(np.sin(np.pi * np.arange(SAMPLES) * PERIOD_S)) + np.minimum(
    np.arange(SAMPLES) * PERIOD_S, 1.0)
CREEP = {'creep_per_decade': 0.02}


def fit_of(voltage_v, hysteresis=None, **rig):
    stage = Rig(RigParameters(**{'noise_rms_um': 1e-3, **rig}), PERIOD_S, compiled=False)
    measured_um = np.append(stage.measure(), stage.run(voltage_v))
    answered_v = np.append(0.0, voltage_v)
    return fit_creep(
        make_records(answered_v, measured_um)[0], PERIOD_S, hysteresis=hysteresis)


@pytest.mark.parametrize(('voltage_v', 'more'), [
    (STEP_V, {}), (STAIRS_V, {}), (STEP_V, {'drift_um_per_s': -5e-4}),
    (LINES_V, {'hysteresis': HysteresisParameters()})])
def test_the_share_is_found_within_its_error(voltage_v, more):
    fit = fit_of(voltage_v, **more, **CREEP)
    assert abs(fit.parameters.creep_per_decade - 0.02) < 3.0 * fit.standard_error
    assert fit.standard_error < 0.002
    # What goes on for longer than the record is told to be known as far as the record.
    assert fit.verdict.word == 'usable up to', fit.verdict
    drift = more.get('drift_um_per_s', 0.0)
    assert fit.drift_um_per_s == pytest.approx(drift, abs=3e-5 + 0.01 * abs(drift))


def test_creep_that_has_ended_is_known_to_its_end():
    fit = fit_of(STEP_V, creep_per_decade=0.03, creep_end_s=3.16)
    assert fit.verdict.word == 'good', (fit.verdict, fit.parameters)
    assert fit.parameters.creep_end_s == pytest.approx(10.0**0.5)
    assert fit.parameters.creep_per_decade == pytest.approx(0.03, abs=3.0 * fit.standard_error)


@pytest.mark.parametrize('rig', [{}, {'drift_um_per_s': 1e-3}])
def test_where_there_is_no_creep_none_is_told(rig):
    fit = fit_of(STEP_V, **rig)
    assert fit.verdict.is_poor
    assert 'no creep is seen' in str(fit.verdict)


def test_a_wrong_hysteresis_is_not_taken_for_creep():
    wrong = HysteresisParameters(kappa_um_per_v=(1.0,), saturation_v=())
    fit = fit_of(LINES_V, hysteresis=wrong, **CREEP)
    assert fit.verdict.is_poor


def test_noise_widens_the_error_and_hides_nothing():
    fit = fit_of(STEP_V, noise_rms_um=0.03, **CREEP)
    assert abs(fit.parameters.creep_per_decade - 0.02) < 3.0 * fit.standard_error
    assert fit.standard_error > fit_of(STEP_V, **CREEP).standard_error


@pytest.mark.slow
def test_a_stage_that_had_rested_at_its_first_voltage():
    voltage_v = np.concatenate([np.full(100, 1.0), np.full(SAMPLES - 100, -1.0)])
    stage = Rig(RigParameters(**CREEP, noise_rms_um=1e-3), PERIOD_S, compiled=False)
    stage.run(np.full(20_000, 1.0))
    measured_um = stage.run(voltage_v)
    fit = fit_creep(make_records(voltage_v, measured_um)[0], PERIOD_S, is_settled=True)
    assert fit.parameters.creep_per_decade == pytest.approx(
        0.02, abs=3.0 * fit.standard_error + 2e-4)


@pytest.mark.parametrize(('voltage_v', 'problem'), [
    (LINES_V, 'the voltage is held for 0 % of the record'),
    (STEP_V[:104], 'a longer one is needed'),
])
def test_a_record_that_cannot_tell_is_refused(voltage_v, problem):
    with pytest.raises(ValueError, match=problem):
        fit_of(voltage_v, **CREEP)


def test_its_file_is_one_of_the_compensator():
    fit = fit_of(STEP_V, **CREEP)
    text = fit.to_parameter_yaml(source='a bag')
    nodes = yaml.safe_load(text)
    values = nodes['/**/compensator']['ros__parameters']
    loaded = CompensatorParameters.from_mapping(values)
    assert loaded.creep_per_decade == fit.parameters.creep_per_decade
    assert nodes['/**/identified_creep']['ros__parameters']['verdict'] == str(fit.verdict)
    assert 'feedback' in text
