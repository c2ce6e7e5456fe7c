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

"""The whole paper offline: what the issue of it must show, on the calibrated rig."""

import json
from pathlib import Path

import numpy as np
import pytest

from piezo_ros.cli.main import main
from piezo_ros.parameters.parameter_file import read_parameter_file
from piezo_ros.study.results import Crossing
from piezo_ros.study.run_study import RUNS
from piezo_ros.study.table_4 import agreement, published_errors, table_cells

PLAN = Path(__file__).parents[2] / 'config' / 'experiments' / 'paper.yaml'


@pytest.fixture(scope='module')
def directory(tmp_path_factory):
    directory = tmp_path_factory.mktemp('paper') / 'out'
    assert main(['simulate', str(PLAN), '-o', str(directory)]) == 0
    return directory


@pytest.fixture(scope='module')
def report(directory):
    return json.loads((directory / 'report.json').read_text())


def errors(report, table):
    return np.array([[row['ff'], row['fbff']] for row in report[table]])


@pytest.mark.slow
def test_table_4_as_published_is_met_also_on_rows_that_the_calibration_never_saw(report):
    assert len(report['table4']) == 30
    assert report['agreement']['all']['median_deviation'] <= 0.08
    assert report['agreement']['held_out_rows']['median_deviation'] <= 0.10
    assert report['agreement']['all']['verdicts'] >= 27


@pytest.mark.slow
def test_a_stage_that_warms_spreads_table_3_and_keeps_table_4(report):
    warming = report['rig_that_warms']
    assert sum(row['within_50_hz'] for row in warming['table3']) >= 4
    assert warming['agreement']['all']['median_deviation'] <= 0.075
    assert warming['agreement']['all']['verdicts'] >= 27


@pytest.mark.slow
def test_it_has_as_many_runs_as_its_progress_tells(directory):
    assert sum(1 for _ in directory.rglob('metadata.yaml')) == RUNS


@pytest.mark.slow
def test_programs_find_every_table_under_its_name(report):
    assert report.keys() >= {
        'runs', 'table3', 'table4', 'nonlinearity', 'margins', 'identified', 'software'}
    for row, (amplitude_um, frequency_hz) in zip(report['table4'], table_cells(), strict=True):
        assert row.keys() == {
            'amplitude_um', 'frequency_hz', 'ff', 'fbff', 'paper_ff', 'paper_fbff'}
        assert (row['amplitude_um'], row['frequency_hz']) == (amplitude_um, frequency_hz)
        assert [row['paper_ff'], row['paper_fbff']] == list(
            published_errors([(amplitude_um, frequency_hz)])[0])
    assert [row['amplitude_um'] for row in report['table3']] == [0.5, 1.0, 1.5, 2.0, 2.5]
    for loop in ('uncompensated', 'compensated'):
        assert report['nonlinearity'][loop].keys() == {'input', 'output'}
    assert report['margins']['published']['feedback_acceptable_frequency_hz'] == pytest.approx(
        425.0, abs=1.0)
    assert report['margins']['published']['weighted_peak'] == pytest.approx(0.207, abs=0.001)
    assert report['identified'].keys() >= {'hysteresis', 'dynamics', 'uncertainty', 'controller'}
    assert [run['scheme'] for run in report['runs']] == ['fb', 'ff', 'fbff']


@pytest.mark.slow
def test_identified_models_halve_the_published_errors(report):
    published = published_errors(table_cells())
    assert np.median(errors(report, 'table4_identified') / published) <= 0.5


@pytest.mark.slow
def test_automatic_harmonics_beat_the_better_published_scheme(report):
    published = published_errors(table_cells())
    better = errors(report, 'table4_automatic').min(axis=1) < published.min(axis=1)
    assert np.count_nonzero(better) >= 28


@pytest.mark.slow
def test_hysteresis_is_there_without_compensation_and_gone_with_it(report):
    bare, published, identified = (report['nonlinearity'][key] for key in (
        'uncompensated', 'compensated', 'compensated_identified'))
    assert bare['input'] == pytest.approx(11.8, abs=0.5)
    assert bare['output'] == pytest.approx(12.7, abs=0.8)
    for loop in (published, identified):
        assert loop['input'] <= 0.40
        assert loop['output'] <= 0.38


@pytest.mark.slow
def test_scheme_and_harmonics_are_predicted_as_they_are_measured(report):
    assert report['recommended_schemes_right'] >= 27
    for row in report['table4_automatic']:
        for scheme in ('ff', 'fbff'):
            assert row['predicted'][scheme] == pytest.approx(row[scheme], rel=0.2)
    assert len(report['harmonics']) == 6
    for trial in report['harmonics']:
        measured = dict(zip(trial['harmonics'], trial['measured'], strict=True))
        assert measured[trial['chosen']] <= 1.05 * min(measured.values())
        np.testing.assert_allclose(trial['predicted'], trial['measured'], rtol=0.2)
    for row in report['table3']:
        assert row['predicted_hz'] == pytest.approx(row['crossing_hz'], rel=0.05)


@pytest.mark.slow
def test_points_at_which_the_amplifier_slews_are_left_out_and_listed(report):
    bound = report['identified']['uncertainty']
    left_out = bound['left_out']
    assert len(left_out) + bound['points'] == 500
    assert left_out
    assert all('slews' in point['reason'] for point in left_out)
    assert min(point['frequency_hz'] for point in left_out) > 900.0


@pytest.mark.slow
def test_creep_is_in_figure_6_and_would_not_suit_figure_5(report):
    creeping = report['nonlinearity']['compensated_creeping']
    assert min(creeping.values()) > 1.0


@pytest.mark.slow
def test_the_identified_models_are_parameter_files(directory):
    for node in ('compensator', 'trajectory', 'controller'):
        assert read_parameter_file(directory / 'models' / f'{node}.yaml', (node,))[node]


@pytest.mark.slow
def test_the_page_gives_its_reasons(report, directory):
    page = (directory / 'report.html').read_text(encoding='utf-8')
    for anchor in ('table-4', 'beyond', 'harmonics', 'table-3', 'warming', 'static',
                   'table-1', 'table-2', 'uncertainty', 'loop', 'fig-11', 'deviations'):
        assert f'id="{anchor}"' in page
    outside = [row['amplitude_um'] for row in report['table3'] if not row['within_50_hz']]
    assert ('Outside: ' in page) == bool(outside)
    assert 'The rig is simulated.' in page


@pytest.mark.slow
def test_table_3_bound_and_tuned_loop_are_as_they_must_be(report):
    assert sum(row['within_50_hz'] for row in report['table3']) >= 3
    bound = report['identified']['uncertainty']
    assert bound['smallest_margin'] >= 1.0
    assert bound['mean_excess_db'] <= 3.0
    assert report['margins']['tuned']['weighted_peak'] < 1.0


def test_a_crossing_is_where_feedback_begins_to_do_harm():
    frequency_hz = np.array([300.0, 400.0, 500.0])
    crossing = Crossing(1.0, frequency_hz, np.array([2.0, 2.0, 2.0]), np.array([1.0, 1.0, 4.0]))
    assert crossing.crossing_hz == pytest.approx(450.0)
    never = Crossing(1.0, frequency_hz, np.array([2.0, 2.0, 2.0]), np.array([1.0, 1.0, 1.0]))
    assert np.isnan(never.crossing_hz)


def test_a_table_agrees_with_itself_and_not_with_its_mirror():
    published = published_errors(table_cells())
    same = agreement(published, published)
    assert (same.median_deviation, same.verdicts, same.conditions) == (0.0, 30, 30)
    assert agreement(published[:, ::-1], published).verdicts < 5
