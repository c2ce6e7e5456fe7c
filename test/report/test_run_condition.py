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

"""A run tells the truth about itself: simulated runs of which the fault is known."""

import numpy as np
import pytest

from piezo_ros.bag import read
from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.plan.run_entry import plan_run
from piezo_ros.parameters.node_parameters import LOOP_NODES
from piezo_ros.report import score
from piezo_ros.report.run_condition import RunCondition

# The slew limit of the calibrated rig.
BASE = {node: {} for node in LOOP_NODES} | {'plant': {'slew_limit_v_per_s': 1.8e4}}


@pytest.fixture
def scored(tmp_path):
    def score_of(entry, periods=4):
        planned = plan_run(BASE, entry, where='test', number=0, score_periods=periods)
        simulate_run(planned, tmp_path / 'bag')
        return score(read(tmp_path / 'bag'), periods=periods, bag='bag', wall_seconds=1.0)
    return score_of


@pytest.mark.parametrize(('entry', 'begin'), [
    ({'scheme': 'fbff'}, 'ok'),
    ({'scheme': 'fb', 'offset_um': 1.0}, 'ok'),
    ({'scheme': 'fb', 'periods': 4}, 'not settled'),
    ({'scheme': 'fbff', 'frequency_hz': 50, 'controller': {'proportional_gain': 3.0}}, 'unstable'),
    ({'scheme': 'ff', 'amplitude_um': 5, 'frequency_hz': 1000}, 'slewing 100 %, at the rails'),
    ({'scheme': 'fb', 'waveform': 'spiral'}, 'settling not known'),
])
def test_the_condition_of_a_simulated_run(scored, entry, begin):
    words = scored(entry).condition.words
    assert words.startswith(begin)
    assert (words == 'ok') == (begin == 'ok')


@pytest.mark.slow
@pytest.mark.parametrize(('entry', 'begin'), [
    ({'scheme': 'ff'}, 'ok'),
    # It has a large error, so that its loop is looked at.
    ({'scheme': 'fb', 'frequency_hz': 1000}, 'ok'),
    # They lock into the reference, so that they repeat: the loop in the bag tells.
    ({'scheme': 'fb', 'frequency_hz': 500, 'controller': {'proportional_gain': 2.7}}, 'unstable'),
    ({'scheme': 'fb', 'frequency_hz': 500, 'controller': {'proportional_gain': 30.0}}, 'unstable'),
    ({'scheme': 'fb', 'frequency_hz': 1000, 'controller': {'proportional_gain': 10.0}}, 'unstable'),
    ({'scheme': 'fb', 'controller': {'integral_gain_per_s': 5e4}}, 'unstable'),
])
def test_the_condition_of_further_runs(scored, entry, begin):
    test_the_condition_of_a_simulated_run(scored, entry, begin)


def test_the_loop_of_a_run_is_known_without_its_motion_file(scored, tmp_path):
    file = tmp_path / 'wave.csv'
    wave_um = 0.5 * np.sin(np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False))
    file.write_text('# repeat_from: 0\nreference_um\n' + '\n'.join(map(repr, wave_um.tolist())))
    entry = {
        'scheme': 'fbff', 'frequency_hz': 50, 'waveform': 'file', 'file': str(file), 'periods': 6,
        'harmonics': 0, 'ramp_periods': 1, 'controller': {'proportional_gain': 3.0}}
    assert scored(entry).condition.is_stable is False
    file.unlink()
    again = score(read(tmp_path / 'bag'), periods=4, bag='bag', wall_seconds=1.0)
    assert again.condition.is_stable is False


def test_one_period_is_not_called_settled(scored):
    run = scored({'scheme': 'fb', 'periods': 1}, periods=1)
    assert run.condition.is_settled is None
    assert run.condition.words == 'settling not known'


@pytest.mark.slow
def test_gains_that_change_during_the_run_count_as_they_are_at_its_end(scored):
    entry = {'scheme': 'fb', 'frequency_hz': 500, 'controller': {'proportional_gain': 0.1},
             'changes': [{'at_sample': 300, 'proportional_gain': 30.0}]}
    assert scored(entry).condition.is_stable is False


def test_an_offset_is_told_and_has_no_published_number(scored):
    run = scored({'scheme': 'ff', 'offset_um': 1.0})
    assert run.offset_um == 1.0
    assert run.record()['offset_um'] == 1.0
    assert run.paper_nrmse_percent is None
    assert np.mean(run.reference_um) == pytest.approx(1.0, abs=0.01)


def test_turns_have_no_published_number(scored):
    assert scored({'scheme': 'ff', 'turn_fraction': 0.3}).paper_nrmse_percent is None


def test_a_foreign_run_says_what_is_not_known(make_run):
    run = score(make_run(), bag='b', wall_seconds=1.0)
    assert run.condition.slewing_percent is None
    assert run.condition.words == 'limits not known'


@pytest.mark.parametrize(('percent', 'text'), [
    (0.0, 'ok'), (1e-3, 'slewing < 0.1 %'), (0.25, 'slewing 0.25 %'), (12.34, 'slewing 12 %'),
    (99.4, 'slewing 99 %'), (100.0, 'slewing 100 %')])
def test_shares_are_short(percent, text):
    assert RunCondition(percent, 0.0, 0.0, True, True).words == text
