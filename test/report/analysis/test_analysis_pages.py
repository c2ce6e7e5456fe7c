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
import math

import numpy as np
import pytest
from analysis_pages import replay_page, sweep_page, swept_records, tuning_page

from piezo_ros.report.analysis.panel_figure import panel_figure
from piezo_ros.report.analysis.replayed_run import ReplayedRun
from piezo_ros.report.page.chart import Line, Panel, Trace


def test_a_chart_and_its_figure_show_the_same_traces():
    time = np.linspace(0.0, 1.0, 50)
    figure = panel_figure([
        Panel('time (s)', 'y (um)', [Trace('one', time, time), Trace(
            'two', time, -time, style='none', marker='open')], lines=[Line(0.5, 'limit')]),
        Panel('frequency (Hz)', 'size', [Trace('three', time[1:], time[1:])], log_x=True)])
    above, below = figure.axes
    assert [text.get_text() for text in above.get_legend().get_texts()] == ['one', 'two']
    assert below.get_xscale() == 'log'


def test_few_draws_are_drawn_and_nothing_is_said_of_what_they_depend_on(tmp_path):
    page = sweep_page(tmp_path, swept_records(5)).read_text()
    assert 'Nothing is said of what the error depends on' in page
    assert 'piezo simulate it' in page
    assert 'fb &lt;1&gt;' in page
    data = json.loads((tmp_path / 'report.json').read_text())
    assert data['runs'][0]['draws'] == 5
    assert data['runs'][0]['nrmse_depends_on'] == []


def test_many_draws_have_sensitivities(tmp_path):
    page = sweep_page(tmp_path, swept_records(200)).read_text()
    assert 'rank correlation' in page
    assert (tmp_path / 'figures' / 'tornado-0.svg').is_file()


def test_a_sweep_without_a_score_has_no_page(tmp_path):
    with pytest.raises(ValueError, match='no run of the sweep succeeded'):
        sweep_page(tmp_path, [])


def test_tuned_gains_are_drawn_with_measured_points(tmp_path):
    page = tuning_page(tmp_path, 0.3).read_text()
    assert sorted(path.stem for path in (tmp_path / 'figures').glob('*.svg')) == [
        'bode', 'nyquist', 'scan', 'sensitivity', 'step']
    assert 'measured points' in page


@pytest.mark.slow
def test_an_unstable_loop_is_drawn_without_a_response(tmp_path):
    page = tuning_page(tmp_path, 500.0, bound=None).read_text()
    assert 'Step and scan' not in page
    loops = json.loads((tmp_path / 'report.json').read_text())['loops']
    assert loops['tuned']['stable'] is False


def test_the_errors_of_a_replay_are_those_of_the_part_that_is_scored():
    reference = np.array([0.0, 1.0, 0.0, -1.0])
    run = ReplayedRun(
        np.arange(4) * 0.1, reference,
        (reference + 0.1, reference + np.array([9.0, 9.0, 0.0, 0.2])),
        (reference, 2.0 * reference), slice(2, 4))
    assert run.max_error_um() == pytest.approx((0.1, 0.2))
    assert run.nrmse_percent() == pytest.approx((10.0, 100.0 * 0.2 / math.sqrt(2.0)))
    assert run.max_voltage_v() == (1.0, 2.0)


def test_a_replay_is_drawn_with_its_difference(tmp_path):
    page = replay_page(tmp_path).read_text()
    assert 'Replaced: scheme.' in page
    assert (tmp_path / 'figures' / 'difference.png').is_file()
