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

"""What the live view knows of a rig: the error by index, estimates that hold, and refusals."""

import json
import math

import numpy as np
import pytest
from live_feed import planned_runs, show_run, status_of

from piezo_ros.experiment.offline import simulated_streams
from piezo_ros.live.view.campaign_record import CampaignRecord
from piezo_ros.live.view.rig_record import RigRecord
from piezo_ros.report.metrics import nrmse


@pytest.fixture(scope='module')
def planned(tmp_path_factory):
    directory = tmp_path_factory.mktemp('plan')
    triangle, slow, decreasing, bare = planned_runs(
        directory, {'scheme': 'fbff', 'periods': 200},
        {'scheme': 'fbff', 'periods': 3, 'frequency_hz': 50},
        {'scheme': 'ff', 'waveform': 'decreasing_triangle', 'periods': 20, 'harmonics': 0},
        {'output': 'voltage', 'waveform': 'triangle', 'amplitude_v': 1.0, 'periods': 60})
    return {'triangle': triangle, 'slow': slow, 'decreasing': decreasing, 'bare': bare}


class _View:
    """Takes what a supervisor hands on, into one record."""

    def __init__(self, planned):
        self.record = CampaignRecord('title', 1)
        self.record.add_rig('')
        self.record.begin_run({'': planned})
        self.take_sample, self.take_status = self.record.take_sample, self.record.take_status
        self.show = self.record.show

    def rig(self, known=(0, 0)):
        (rig,) = self.record.snapshot({'': known})['rigs']
        return rig


def test_the_estimates_are_those_of_all_samples_within_their_doubt(planned):
    run = planned['triangle']
    streams = simulated_streams(run)
    view = _View(run)
    show_run(view, run)
    analysis = view.rig()['analysis']
    tail = slice(run.trajectory.samples // 2, None)
    percent = 100.0 * nrmse(streams['reference'][tail], streams['displacement'][:-1][tail])
    doubt = analysis['nrmse_percent'] * analysis['relative_doubt']
    assert 0.0 < doubt < 0.3 * percent
    assert abs(analysis['nrmse_percent'] - percent) < 1.5 * doubt
    spectrum = analysis['spectrum']
    # The error of a triangle: odd harmonics, the first one largest.
    amplitudes, errors = (np.array(spectrum[name]) for name in (
        'amplitudes_nm', 'standard_errors_nm'))
    assert amplitudes.argmax() == 0
    assert (amplitudes[1:9:2] < 4.0 * errors[1:9:2]).all()
    assert (amplitudes[0:9:2] > 4.0 * errors[0:9:2]).all()


def test_each_displacement_is_compared_with_the_reference_of_its_own_index(planned):
    run = planned['triangle']
    streams = simulated_streams(run)
    view = _View(run)
    show_run(view, run, most=50)
    indices, displacements_um, references_um = view.rig()['tracking']
    np.testing.assert_array_equal(displacements_um, streams['displacement'][indices])
    np.testing.assert_array_equal(references_um, streams['reference'][indices])


def test_the_last_displacement_has_no_reference(planned):
    run = planned['slow']
    view = _View(run)
    view.take_sample('', 'displacement', run.trajectory.samples, 0.5)
    assert view.rig()['tracking'] == [[run.trajectory.samples], [0.5], [None]]


def test_another_reference_than_that_of_the_plan_ends_the_estimates(planned):
    run = planned['triangle']
    view = _View(run)
    show_run(view, run, most=200)
    view.take_sample('', 'reference', run.trajectory.samples - 1, 0.1)
    analysis = view.rig()['analysis']
    assert 'another reference than the plan says' in analysis['refused']
    assert not {'rms_nm', 'nrmse_percent', 'spectrum'} & analysis.keys()


def test_few_samples_are_no_estimate(planned):
    view = _View(planned['triangle'])
    show_run(view, planned['triangle'], most=8)
    analysis = view.rig()['analysis']
    assert '10 are needed' in analysis['refused']
    assert not {'rms_nm', 'nrmse_percent', 'spectrum'} & analysis.keys()


def test_samples_of_a_part_of_the_period_give_no_nrmse(planned):
    run = planned['triangle']
    view = _View(run)
    for number in range(3, 60):
        # Near the zero crossing always: the turns, where the error is, are not seen.
        view.take_sample('', 'displacement', int(number * 1000 / 3) + number % 9, 0.0)
    analysis = view.rig()['analysis']
    assert 'rms_nm' in analysis
    assert 'nrmse_percent' not in analysis
    assert 'of the period' in analysis['refused_spectrum']


def test_a_run_without_repetition_has_no_spectrum(planned):
    run = planned['decreasing']
    view = _View(run)
    show_run(view, run, step=60)
    rig = view.rig()
    assert rig['facts']['period_samples'] is None
    assert rig['analysis']['refused_spectrum'] == 'nothing in this run is repeated'
    assert rig['analysis']['rms_nm'] > 0.0


def test_a_bare_run_shows_its_displacement_by_harmonic(planned):
    view = _View(planned['bare'])
    for index in range(0, 19_000, 61):
        view.take_sample('', 'displacement', index, math.sin(2.0 * math.pi * 0.003 * index))
    rig = view.rig()
    assert not rig['facts']['follows_reference']
    assert rig['analysis']['signal'] == 'displacement'
    assert rig['analysis']['spectrum']['amplitudes_nm'][0] == pytest.approx(1000.0)
    assert not {'rms_nm', 'nrmse_percent'} & rig['analysis'].keys()


def test_a_page_gets_only_what_is_new_to_it(planned):
    run = planned['triangle']
    view = _View(run)
    show_run(view, run, most=30)
    first = view.rig()
    assert len(first['tracking'][0]) == 30
    known = first['run'], first['sequence']
    assert view.rig(known)['tracking'] == [[], [], []]
    assert view.rig(known)['facts'] is None
    view.take_sample('', 'displacement', run.trajectory.samples - 1, 0.25)
    assert view.rig(known)['tracking'][1] == [0.25]
    view.record.begin_run({'': run})
    assert view.rig(known)['tracking'] == [[], [], []]
    assert view.rig(known)['facts'] is not None


def test_what_is_kept_is_bounded(planned):
    run = planned['triangle']
    rig = RigRecord('')
    rig.begin(run)
    for index in range(20_000):
        rig.take_sample('displacement', index, 0.0)
        rig.take_sample('voltage', index, 0.0)
    rig.take_status(status_of('plant', 1, reason='x' * 10_000))
    assert len(json.dumps(rig.snapshot(0, 0))) < 200_000


def test_repeated_and_late_samples_are_not_taken_twice(planned):
    view = _View(planned['triangle'])
    for index in (700, 700, 900):
        view.take_sample('', 'voltage', index, 0.5)
    view.take_sample('', 'voltage', 10**9, 0.5)  # beyond the run
    view.take_sample('', 'voltage', 901, math.nan)
    assert view.rig()['voltage'][0] == [700, 900]
    view.take_sample('', 'voltage', 5, 0.1)  # those before were of an earlier run
    assert view.rig()['voltage'][0] == [5]


def test_a_stranger_of_another_rig_is_ignored(planned):
    view = _View(planned['triangle'])
    view.take_sample('elsewhere', 'voltage', 1, 0.5)
    view.take_status('elsewhere', status_of('plant', 1))
    assert view.rig()['voltage'] == [[], []]


def test_the_campaign_tells_its_runs_and_its_end(planned):
    record = CampaignRecord('title', 3)
    record.add_rig('')
    for _ in range(150):
        record.begin_run({'': planned['slow']})
        record.end_run(wall_seconds=1.25)
    record.begin_run({'': planned['slow']})
    record.end_run(problem='plant failed: why')
    record.end(1)
    told = record.snapshot({})
    assert told['runs_begun'] == 151
    assert len(told['runs']) == 100
    assert (told['runs'][-2]['state'], told['runs'][-2]['detail']) == ('done', '1.2 s')
    assert (told['runs'][-1]['state'], told['runs'][-1]['detail']) == (
        'failed', 'plant failed: why')
    assert told['ended'] == {'exit_code': 1}
