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

"""A scan that is learned while it runs, and its run once more from the list of changes."""

import json

import numpy as np
import pytest
from running_scan import LAW, RIG, known_scan, run_with, trajectory_of

from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.experiment.planned_scan import read_planned_scan, write_planned_scan
from piezo_ros.experiment.running_learning import RunningLearning
from piezo_ros.model import ParameterError
from piezo_ros.parameters.parameter_file import read_parameter_set

FF = LAW.replaced(scheme='ff')


def learn(directory, law, *, periods=130.0, cell=(1.0, 500.0), runs=3, refusal=''):
    path, trajectory = trajectory_of(directory, *cell, periods=periods)
    learning = RunningLearning(
        path, directory / 'out', trajectory, law, runs=runs, settling_s=0.004)

    def after_block(blocks, run, start, stop):
        learning.take(
            start, run.reference_um[start:stop], run.displacement_um[start:stop])
        if learning.is_measured:
            learning.improve()
        if learning.wanted_file:
            change = learning.change_from(stop)
            if refusal:
                learning.refuse(refusal)
            else:
                blocks.add(*change)
                learning.accept(change)

    run = run_with(trajectory, law, after_block)
    learning.end()
    return learning, run, json.loads((directory / 'out' / 'learning.json').read_text())


@pytest.mark.parametrize('law', [FF, LAW], ids=['ff', 'fbff'])
def test_a_scan_improves_while_it_runs_and_its_changes_give_the_run_again(tmp_path, law):
    learning, run, record = learn(tmp_path, law)
    percent = [table['nrmse_percent'] for table in record['tables']]
    assert percent[0] > 1.5 * min(percent)
    assert learning.is_done
    # The last periods are as good as the best table was.
    error_um = (run.reference_um - run.displacement_um[:-1])[-1600:]
    final = 100.0 * np.sqrt(np.mean(error_um.reshape(-1, 200).mean(axis=0)**2)) / 2.0
    assert final == pytest.approx(min(percent), abs=0.01)
    again = simulate(
        RIG, known_scan(1.0, 500.0)[0].hysteresis, law, read_parameter_set(
            tmp_path / 'out' / 'changes.yaml', 'trajectory', TrajectoryParameters))
    for stream, other in zip(run, again, strict=True):
        assert stream.tobytes() == other.tobytes()
    # The best one is a scan that can be planned with and learned from.
    best = read_planned_scan(tmp_path / 'out' / 'best.yaml')[1]
    assert best.limit_use <= 1.0 + 1e-5


@pytest.mark.slow
def test_where_slew_binds_feedback_begins_with_the_planned_output(tmp_path):
    learning, _, record = learn(tmp_path, LAW, cell=(2.5, 800.0), periods=250.0)
    first, *_ = record['tables']
    assert first['from_sample'] > 0  # it was handed over before anything was measured
    assert learning.status()['best_nrmse_percent'] < 1.25


def test_a_refused_table_ends_learning_and_the_old_one_stays(tmp_path):
    learning, run, record = learn(tmp_path, FF, refusal='it jumps')
    assert learning.is_done
    assert record['why_done'] == 'the table was refused: it jumps'
    assert record['changes'] == []
    assert len(record['tables']) == 1
    assert 'file_changes' not in (tmp_path / 'out' / 'changes.yaml').read_text()
    assert np.isfinite(run.displacement_um).all()


def test_a_run_that_is_too_short_keeps_its_scan(tmp_path):
    learning, _, record = learn(tmp_path, FF, periods=20.0)
    assert learning.why_done == 'the run is too short for one more table'
    assert record['changes'] == []


def test_joining_later_measures_whole_repetitions(tmp_path):
    path, trajectory = trajectory_of(tmp_path, periods=130.0)
    learning = RunningLearning(
        path, tmp_path / 'out', trajectory, FF, runs=3, settling_s=0.0)
    _, plan = known_scan(1.0, 500.0)
    reference_um = np.resize(plan.reference_um, 5000)
    learning.take(1357, reference_um[1357:], reference_um[1357:] + 0.01)
    assert learning.is_measured
    learning.improve()
    assert learning.status()['nrmse_percent'] == pytest.approx(0.5, abs=1e-9)


def test_another_scan_than_the_one_that_runs_is_named(tmp_path):
    path, trajectory = trajectory_of(tmp_path, periods=130.0)
    other = tmp_path / 'other'
    other.mkdir()
    write_planned_scan(other / 'scan.yaml', *known_scan(1.0, 500.0, wrong=False))
    with pytest.raises(ParameterError, match='which is not the scan of'):
        RunningLearning(
            other / 'scan.yaml', tmp_path / 'a', trajectory, FF, runs=3, settling_s=0.0)
    with pytest.raises(ParameterError, match="waveform is 'triangle': only a planned scan"):
        RunningLearning(
            path, tmp_path / 'b', TrajectoryParameters(), FF, runs=3, settling_s=0.0)
    learning = RunningLearning(path, tmp_path / 'c', trajectory, FF, runs=3, settling_s=0.0)
    with pytest.raises(ValueError, match=r'reference is 0.5 um at sample 2000, the scan has'):
        learning.take(2000, np.full(10, 0.5), np.zeros(10))


@pytest.mark.parametrize(('law', 'culprit'), [
    (ControllerParameters(scheme='fb'), "scheme is 'fb', beside a planned scan allowed is ff"),
    (ControllerParameters(scheme='fbff'), 'reference_delay_samples is 0, beside a planned scan'),
])
def test_a_controller_that_works_against_the_scan_is_refused(tmp_path, law, culprit):
    path, trajectory = trajectory_of(tmp_path, periods=130.0)
    with pytest.raises(ParameterError, match=culprit):
        RunningLearning(path, tmp_path / 'out', trajectory, law, runs=3, settling_s=0.0)
