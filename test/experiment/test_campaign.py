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

import json

import numpy as np
import pytest

from piezo_ros.bag import read
from piezo_ros.control import simulate
from piezo_ros.experiment.campaign import run_campaign
from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.output_directory import prepare_directory
from piezo_ros.experiment.plan import read_plan
from piezo_ros.paper import TABLE_4
from piezo_ros.parameters.errors import CampaignError
from piezo_ros.parameters.run_and_result import RunResult

KEYS = {
    'scheme': str, 'waveform': str, 'amplitude_um': float, 'frequency_hz': float,
    'harmonics': int, 'nrmse_percent': float, 'max_error_um': float, 'bag': str, 'samples': int,
    'wall_seconds': float, 'condition': str,
    'slewing_percent': float, 'rail_percent': float, 'change_percent': float}
STREAMS = ('reference', 'feedforward', 'command', 'voltage', 'displacement')


@pytest.fixture
def plan(write_plan):
    return read_plan(write_plan(runs=[
        {'scheme': ['fb', 'ff', 'fbff'], 'periods': 6},
        {'scheme': 'ff', 'waveform': 'sine', 'amplitude_um': 0.7, 'periods': 6}]))


@pytest.fixture
def output(tmp_path):
    directory = tmp_path / 'out'
    prepare_directory(directory, force=False)
    return directory


def test_a_campaign_offline_ends_in_a_report_of_every_run(plan, output):
    announced = []
    campaign = run_campaign(plan, output, simulate_run, announced.append)
    assert campaign.report == output / 'report.html'
    assert campaign.report.is_file()
    assert len(campaign.runs) == len(announced) == 4
    assert announced[1] == '[2/4] ff: triangle 1 um, 300 Hz, m = 9, 2000 samples'
    report = json.loads((output / 'report.json').read_text())
    assert 'piezo_ros' in report['software']
    assert report['software']['numpy'] == np.__version__
    for run, planned in zip(report['runs'], plan.runs, strict=True):
        paper = {'paper_nrmse_percent'} & set(run)
        assert set(run) - paper == set(KEYS)
        assert all(type(run[key]) is kind for key, kind in KEYS.items())
        assert run['scheme'] == planned.controller.scheme
        assert run['samples'] == planned.trajectory.samples == 2000
        assert run['bag'] == f'bags/{planned.name}'
        assert read(output / run['bag']).samples == run['samples']
        assert run['wall_seconds'] > 0.0
        # The paper tabulates FF and FBFF of triangles only.
        published = {'ff': TABLE_4[1.0][300.0].ff, 'fbff': TABLE_4[1.0][300.0].fbff}
        expected = published.get(run['scheme']) if run['waveform'] == 'triangle' else None
        assert run.get('paper_nrmse_percent') == expected
    # The plan beside its parameter files, to be run again from there.
    again = read_plan(output / 'plan.yaml')
    assert [run.parameters for run in again.runs] == [run.parameters for run in plan.runs]


def test_changes_during_a_run_are_told(write_plan, output):
    plan = read_plan(write_plan(runs=[{'scheme': 'ff', 'periods': 6, 'changes': [
        {'at_sample': 500, 'scheme': 'fbff'}, {'at_sample': 900, 'proportional_gain': 0.3}]}]))
    announced = []
    campaign = run_campaign(plan, output, simulate_run, announced.append)
    told = (
        'ff, fbff from sample 500 on, other gains from sample 900 on: triangle 1 um, 300 Hz, '
        'm = 9, 2000 samples')
    assert announced == [f'[1/1] {told}']
    assert f'changes during the run: {told}' in campaign.report.read_text(encoding='utf-8')


def test_the_bag_holds_the_samples_of_the_simulation_for_a_foreign_reader_too(plan, output):
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore
    planned = plan.runs[2]
    simulate_run(planned, output / 'bag')
    run = simulate(planned.plant, planned.compensator, planned.controller, planned.trajectory)
    samples = {stream: [] for stream in STREAMS}
    store = get_typestore(Stores.ROS2_JAZZY)
    with AnyReader([output / 'bag'], default_typestore=store) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            stream = connection.topic.lstrip('/')
            index, period_s, *values = message.data.tolist()
            assert period_s == 1e-5
            assert index == len(samples[stream])
            samples[stream] += values
    ours = read(output / 'bag')
    for stream, expected in zip(STREAMS, run, strict=True):
        assert np.array(samples[stream]).tobytes() == expected.tobytes()
        assert ours.whole(stream)[1].tobytes() == expected.tobytes()


def test_the_bag_says_how_it_came_about(plan, output):
    planned = plan.runs[0]
    simulate_run(planned, output / 'bag')
    run = read(output / 'bag')
    assert run.metadata['scheme'] == 'fb'
    assert run.metadata['seed'] == '1'
    (plant,) = (values for node, values in run.parameters.items() if node.endswith('plant'))
    assert plant == planned.parameters['plant']


def test_the_same_plan_gives_the_same_bytes(plan, output):
    for name in ('one', 'two'):
        simulate_run(plan.runs[1], output / name / 'bag')
    one, two = (sorted((output / name).rglob('*.mcap')) for name in ('one', 'two'))
    assert one
    assert [path.read_bytes() for path in one] == [path.read_bytes() for path in two]


def test_a_campaign_with_automatic_harmonics_shows_them_predicted_and_measured(
        write_plan, output):
    plan = read_plan(write_plan(runs=[
        {'scheme': 'ff', 'harmonics': [3, 'auto'], 'amplitude_um': 2.0, 'periods': 6},
        {'scheme': 'ff', 'harmonics': 5, 'amplitude_um': 1.0, 'periods': 6}]))
    campaign = run_campaign(plan, output, simulate_run)
    three, automatic, other = json.loads((output / 'report.json').read_text())['runs']
    assert 'prediction' not in three
    assert 'prediction' not in other
    predicted = automatic['prediction']
    assert predicted['harmonics'] == automatic['harmonics']
    assert len(predicted['by_harmonics']) > 10
    assert 'id="harmonics"' in campaign.report.read_text(encoding='utf-8')
    figure = (output / 'figures' / 'harmonics.svg').read_text(encoding='utf-8')
    assert 'FF, 2 µm, 300 Hz' in figure
    assert 'FF, 1 µm, 300 Hz' not in figure


def test_a_campaign_that_breaks_off_reports_what_it_has(plan, output):
    def run(planned, bag):
        if planned is plan.runs[2]:
            raise CampaignError('the plant is gone')
        simulate_run(planned, bag)
        return RunResult(0.5, ('one remark',))

    with pytest.raises(CampaignError, match='the plant is gone'):
        run_campaign(plan, output, run)
    report = json.loads((output / 'report.json').read_text())
    assert [entry['scheme'] for entry in report['runs']] == ['fb', 'ff']
    page = (output / 'report.html').read_text()
    assert 'the plant is gone' in page
    assert 'one remark' in page


def test_a_campaign_that_breaks_off_at_once_writes_no_report(plan, output):
    def run(planned, bag):
        raise CampaignError('no node there')

    with pytest.raises(CampaignError, match='no node there'):
        run_campaign(plan, output, run)
    assert not (output / 'report.html').exists()
    prepare_directory(output, force=True)  # and it may be replaced
