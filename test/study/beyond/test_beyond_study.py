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

"""Planned and learned scans of Table 4 offline: what they must reach, on the calibrated rig."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from browser import browser, needs_browser, open_page
from screenshots import settle

from piezo_ros.bag import read
from piezo_ros.cli.main import main
from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.scan_learning import ScanLearning
from piezo_ros.model import DynamicsParameters, HysteresisParameters, RigParameters
from piezo_ros.parameters.parameter_file import read_parameter_set
from piezo_ros.planning.scan import ScanRequest, limits_of, planned_scan
from piezo_ros.study.beyond.best_known import read_best_known
from piezo_ros.study.beyond.run_beyond import RUNS
from piezo_ros.study.experiments import run_error_percent

CONFIG = Path(__file__).parents[3] / 'config'
RIG = read_parameter_set(CONFIG / 'rig.yaml', 'plant', RigParameters)
LEARNED_PERCENT = {300.0: 0.15, 400.0: 0.28, 500.0: 0.50, 600.0: 0.72, 700.0: 1.0, 800.0: 1.35}
PLANNED_PERCENT = {300.0: 0.18, 400.0: 0.32, 500.0: 0.55, 600.0: 0.80, 700.0: 1.05, 800.0: 1.40}


def test_one_cell_is_learned_by_identified_models_as_predicted(tmp_path):
    # Identified from runs of this rig, see the file.
    (run,) = yaml.safe_load((CONFIG / 'experiments' / 'automatic.yaml').read_text())['runs']
    request = ScanRequest(
        waveform='triangle', amplitude_um=1.0, frequency_hz=500.0, sample_period_s=1e-5,
        dynamics=DynamicsParameters.among(run['trajectory']),
        hysteresis=HysteresisParameters.among(run['compensator']), limits=limits_of(RIG),
        uncertainty=0.02, noise_rms_um=RIG.noise_rms_um)
    plan = planned_scan(request)
    assert plan.certificate.holds
    learning = ScanLearning(request, plan, tmp_path, {
        'plant': RIG.to_mapping(), 'compensator': {}, 'controller': {}, 'trajectory': {}})
    for _ in range(3):
        learning.next_run(simulate_run)
    bags = [read(tmp_path / 'bags' / one.name) for one in learning.runs]
    measured = [run_error_percent(bag) for bag in bags]
    assert measured[0] == pytest.approx(plan.measured_nrmse_percent, abs=0.07)
    assert measured[learning.best_run] < 2.18 / 7.0
    # Noise is no part of the error that counts here: 1 nm rms of 2 um are 0.05 %.
    true_percent = np.sqrt(measured[learning.best_run]**2 - 0.05**2)
    assert true_percent < 1.5 * read_best_known(RIG)[1.0, 500.0]
    for bag in bags:
        assert np.abs(np.diff(bag.voltage_v, prepend=0.0)).max() <= (
            1.0001 * RIG.slew_limit_v_per_s * 1e-5)
    at_rest = {bag.displacement_um[:5].tobytes() for bag in bags}
    assert len(at_rest) == 3, 'the noise of some runs is the same'


@pytest.fixture(scope='module')
def directory(tmp_path_factory):
    directory = tmp_path_factory.mktemp('beyond') / 'out'
    assert main([
        'simulate', str(CONFIG / 'experiments' / 'beyond.yaml'), '-o', str(directory)]) == 0
    return directory


@pytest.fixture(scope='module')
def report(directory):
    return json.loads((directory / 'report.json').read_text())


@pytest.mark.slow
def test_every_cell_is_learned_within_its_limit(report):
    assert len(report['cells']) == 30
    factors = []
    for cell in report['cells']:
        learned, frequency_hz = cell['runs'][cell['best']], cell['frequency_hz']
        assert len(cell['runs']) <= 3
        assert learned['measured_percent'] <= LEARNED_PERCENT[frequency_hz]
        assert cell['runs'][0]['true_percent'] <= PLANNED_PERCENT[frequency_hz]
        assert learned['true_percent'] <= 1.5 * cell['best_known_percent']
        factors.append(cell['paper_percent'] / learned['measured_percent'])
    assert np.median(factors) >= 7.0
    assert min(factors) >= 3.0


@pytest.mark.slow
def test_it_has_as_many_runs_as_its_progress_tells(directory):
    # How many are learned may differ by a few where numbers differ in the last bit.
    assert sum(1 for _ in directory.rglob('metadata.yaml')) == pytest.approx(RUNS, abs=5)


@pytest.mark.slow
@needs_browser
def test_axe_finds_nothing_on_its_page(directory):
    axe = pytest.importorskip('axe_playwright_python.sync_playwright', reason='no axe-core')
    with browser() as chromium, open_page(chromium, directory / 'report.html') as page:
        settle(page)
        found = axe.Axe().run(page).response['violations']
        assert [(each['id'], [node['html'] for node in each['nodes']]) for each in found] == []
        assert page.errors == []


@pytest.mark.slow
def test_every_first_run_is_as_predicted_and_certified(report):
    for cell in report['cells']:
        measured = cell['runs'][0]['measured_percent']
        assert cell['predicted_percent'] == pytest.approx(measured, abs=0.07)
        assert measured < 1.1 * cell['predicted_at_most_percent']
        assert cell['gamma'] < 1.0
    below = sum(cell['true_gamma'] <= cell['gamma'] for cell in report['cells'])
    assert below >= 28


@pytest.mark.slow
def test_no_sample_is_beyond_a_limit(report):
    for cell in report['cells'] + report['robustness']:
        for run in cell['runs']:
            assert run['slew_v_per_s'] <= 1.0001 * RIG.slew_limit_v_per_s
            assert run['minimum_v'] >= RIG.voltage_minimum_v - RIG.operating_point_v
            assert run['maximum_v'] <= RIG.voltage_maximum_v - RIG.operating_point_v
    assert len(report['average_current']) >= 5
    for row in report['average_current']:
        assert row['average_slew_v_per_s'] <= 1.0001 * 0.5 * RIG.slew_limit_v_per_s
        assert row['measured_percent'] == pytest.approx(row['predicted_percent'], abs=0.07)


@pytest.mark.slow
def test_faults_of_model_and_stage_are_learned_away_or_do_no_harm(report):
    for row in report['robustness']:
        assert len(row['runs']) <= 5
        assert row['end_percent'] <= 1.01 * row['begin_percent']
        if row['fault'].startswith(('u_S', 'kappa', 'creep')):
            assert row['end_percent'] <= row['nominal_percent'] + 0.02
        if row['fault'].startswith('noise'):
            assert row['end_percent'] <= row['nominal_percent'] + 0.03
        if row['fault'].startswith('gain'):
            assert row['best'] > 0
        if row['fault'].startswith('omega_2'):
            assert row['gamma'] >= 1.0
    assert all(target['holds'] for target in report['merit'])


@pytest.mark.slow
def test_the_page_has_its_pictures(directory):
    page = (directory / 'report.html').read_text(encoding='utf-8')
    for anchor in ('table-4', 'learning', 'prediction', 'certificate', 'robustness',
                   'average-current', 'merit'):
        assert f'id="{anchor}"' in page
    for name in ('bars', 'learning', 'prediction', 'certificate'):
        assert (directory / 'figures' / f'{name}.svg').stat().st_size > 5000
