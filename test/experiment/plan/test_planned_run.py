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

"""Scheme and harmonics auto: a planned scan where the error of the models is known."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from piezo_ros.control import simulate
from piezo_ros.experiment.plan import Known, plan_run
from piezo_ros.identification.prediction.accuracy import ModelAccuracy
from piezo_ros.model import RigParameters
from piezo_ros.parameters.parameter_file import read_parameter_set
from piezo_ros.report.metrics import nrmse, tail

CONFIG = Path(__file__).parents[3] / 'config'
RIG = read_parameter_set(CONFIG / 'rig.yaml', 'plant', RigParameters)
(IDENTIFIED,) = yaml.safe_load((CONFIG / 'experiments' / 'automatic.yaml').read_text())['runs']


@pytest.fixture
def decided(tmp_path, monkeypatch):
    """Return a function that decides a run of 1 um and 500 Hz."""
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))

    def decide(known, place=True, **entry):
        base = {
            'plant': RIG.to_mapping(), 'controller': {}, 'compensator': IDENTIFIED['compensator'],
            'trajectory': {
                **IDENTIFIED['trajectory'], 'amplitude_um': 1.0, 'frequency_hz': 500.0,
                'periods': 15.0, **({'pairs_before_hysteresis': 1} if place else {})}}
        return plan_run(base, entry, where='here', number=0, known=known)
    return decide


def small(frequency_hz):
    return np.full_like(np.asarray(frequency_hz, dtype=np.float64), 0.004)


def large(frequency_hz):
    return np.full_like(np.asarray(frequency_hz, dtype=np.float64), 0.7)


@pytest.mark.parametrize('known', [Known(bound=small), Known(accuracy=ModelAccuracy(
    hysteresis_rms_um=0.001, noise_rms_um=0.001, model_error=0.003))])
def test_a_planned_scan_is_chosen_and_runs_as_predicted(decided, known):
    run = decided(known, scheme='ff', harmonics='auto')
    assert run.prediction.scheme == 'planned'
    assert (run.controller.scheme, run.trajectory.waveform) == ('ff', 'file')
    assert 'planned is predicted to err least: ff' in run.prediction.reason
    streams = simulate(run.plant, run.compensator, run.controller, run.trajectory)
    window = tail(run.trajectory.samples, 500.0, 1e-5, 4.0)
    measured = 100.0 * nrmse(streams.reference_um[window], streams.displacement_um[:-1][window])
    assert measured < 0.2
    interval = run.prediction.interval
    assert interval.low_percent - 0.02 < measured
    # Of a residual of the hysteresis the bound alone tells nothing.
    assert (interval.high_percent is None) == (known.accuracy is None)
    assert interval.high_percent is None or measured < interval.high_percent
    # The same plan is the same file.
    again = decided(known, scheme='ff', harmonics='auto')
    assert again.trajectory.file == run.trajectory.file


@pytest.mark.parametrize('shape', [
    {'offset_um': 1.5}, {'turn_fraction': 0.2}, {'offset_um': -1.0, 'turn_fraction': 0.1}])
def test_a_scan_of_another_shape_is_planned_as_well(decided, shape):
    run = decided(Known(bound=small), scheme='ff', harmonics='auto', **shape)
    assert run.prediction.scheme == 'planned'
    streams = simulate(run.plant, run.compensator, run.controller, run.trajectory)
    window = tail(run.trajectory.samples, 500.0, 1e-5, 4.0)
    reference_um = streams.reference_um[window]
    assert reference_um.mean() == pytest.approx(shape.get('offset_um', 0.0), abs=1e-9)
    measured = 100.0 * nrmse(reference_um, streams.displacement_um[:-1][window])
    interval = run.prediction.predictions['planned'].interval
    assert interval.low_percent - 0.02 < measured < 0.2


def test_it_must_be_good_wherever_the_hysteresis_may_stand(decided):
    run = decided(Known(bound=small), place=False, scheme='ff', harmonics='auto')
    planned = run.prediction.predictions
    assert run.prediction.scheme == 'ff'
    assert 'planned' not in planned


@pytest.mark.parametrize(('known', 'entry'), [
    (Known(), {'scheme': 'ff', 'harmonics': 'auto'}),  # how good the model is was not told
    (Known(bound=large), {'scheme': 'ff', 'harmonics': 'auto'}),
    (Known(bound=small), {'scheme': 'fbff', 'harmonics': 'auto'}),
    (Known(bound=small), {'scheme': 'ff', 'harmonics': 'auto', 'frequency_hz': 501.234567}),
    (Known(bound=small), {'scheme': 'ff', 'harmonics': 'auto', 'periods': 6.0}),
])
def test_it_is_no_candidate_where_it_cannot_be_trusted_or_played(decided, known, entry):
    run = decided(known, **entry)
    assert run.prediction.scheme == entry['scheme']
    assert run.trajectory.waveform == 'triangle'
    assert run.trajectory.harmonics > 0
