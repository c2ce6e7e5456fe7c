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

from piezo_ros import paper
from piezo_ros.identification.tuning.loop_evidence import LoopEvidence
from piezo_ros.identification.tuning.loop_shape import loop_shape
from piezo_ros.identification.tuning.pi_tuning import PiTuning
from piezo_ros.model import LinearDynamics
from piezo_ros.report.analysis.panel_figure import panel_figure
from piezo_ros.report.analysis.replay_page import write_replay_page
from piezo_ros.report.analysis.replayed_run import ReplayedRun
from piezo_ros.report.analysis.sweep_page import SweptRun, WorstDraw, write_sweep_page
from piezo_ros.report.analysis.tuning_page import TunedLoop, write_tuning_page
from piezo_ros.report.page.chart import Line, Panel, Trace


def records(count, seed=1):
    generator = np.random.default_rng(seed)
    gains = generator.uniform(-0.1, 0.1, count)
    return [
        {'number': k, 'draw': k, 'run': 0, 'name': f'{k:03d}_fb', 'plant.gain_mismatch': gain,
         'nrmse_percent': 1.0 + abs(gain), 'max_error_um': 0.1, 'error': ''}
        for k, gain in enumerate(gains.tolist())]


def sweep_page(directory, drawn, **options):
    return write_sweep_page(
        directory, title='Sweep', runs=[SweptRun('fb <1>', drawn)] if drawn else [],
        parameters=['plant.gain_mismatch'], failed=[], software={'piezo_ros': '1'},
        worst=[WorstDraw(drawn[0], 'worst/000000.yaml', 'piezo simulate it')] if drawn else [],
        **options)


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
    page = sweep_page(tmp_path, records(5)).read_text()
    assert 'Nothing is said of what the error depends on' in page
    assert 'piezo simulate it' in page
    assert 'fb &lt;1&gt;' in page
    data = json.loads((tmp_path / 'report.json').read_text())
    assert data['runs'][0]['draws'] == 5
    assert data['runs'][0]['nrmse_depends_on'] == []


def test_many_draws_have_sensitivities(tmp_path):
    page = sweep_page(tmp_path, records(200)).read_text()
    assert 'rank correlation' in page
    assert (tmp_path / 'figures' / 'tornado-0.svg').is_file()


def test_a_sweep_without_a_score_has_no_page(tmp_path):
    with pytest.raises(ValueError, match='no run of the sweep succeeded'):
        sweep_page(tmp_path, [])


def tuned_loop(gain, **changes):
    model = LinearDynamics()
    shape = loop_shape(model, gain, 3000.0, sample_period_s=1e-5, measurement_delay_samples=1)
    tuning = PiTuning('itae_step', shape, shape, 1.0, 1.0, 2.0, 1.0, (), None, None)
    frequency_hz = np.array([100.0, 1000.0, 5000.0])
    evidence = LoopEvidence(
        frequency_hz, shape.loop.plant_response(frequency_hz), model_error=0.05)
    return TunedLoop(**{
        'tuning': tuning, 'published': shape, 'evidence': evidence,
        'bound': paper.uncertainty_magnitude, 'reference_um': np.sin(np.arange(500) / 50.0),
        'scan': 'a sine', 'points': (), 'remarks': ['far'], **changes})


def test_tuned_gains_are_drawn_with_measured_points(tmp_path):
    page = write_tuning_page(
        tmp_path, title='Gains', tuned=tuned_loop(0.3), software={}).read_text()
    assert sorted(path.stem for path in (tmp_path / 'figures').glob('*.svg')) == [
        'bode', 'nyquist', 'scan', 'sensitivity', 'step']
    assert 'measured points' in page


@pytest.mark.slow
def test_an_unstable_loop_is_drawn_without_a_response(tmp_path):
    page = write_tuning_page(
        tmp_path, title='Gains', tuned=tuned_loop(500.0, bound=None), software={}).read_text()
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
    time_s = np.arange(500) * 1e-5
    wave = np.sin(2e3 * time_s)
    run = ReplayedRun(time_s, wave, (wave, 0.9 * wave), (wave, wave), slice(250, 500))
    page = write_replay_page(
        tmp_path, title='Replay', run=run, remarks=['Replaced: scheme.'], software={}).read_text()
    assert 'Replaced: scheme.' in page
    assert (tmp_path / 'figures' / 'difference.png').is_file()
