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

"""``piezo learn``: runs that improve a planned scan, interrupted and resumed, offline and live."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from piezo_ros.cli.main import main
from piezo_ros.experiment.planned_scan import read_planned_scan
from piezo_ros.experiment.scan_learning import ScanLearning
from piezo_ros.model import HysteresisParameters
from piezo_ros.parameters.parameter_file import parameters_yaml

RIG_FILE = Path(__file__).parents[2] / 'config' / 'rig.yaml'


@pytest.fixture
def scan(models, calibrated):
    """Plan a scan by models that are somewhat wrong."""
    wrong = HysteresisParameters(
        kappa_um_per_v=tuple(1.05 * np.array(calibrated.kappa_um_per_v)),
        saturation_v=calibrated.saturation_v)
    (models / 'compensator.yaml').write_text(parameters_yaml(
        '/**', {'compensator': wrong.to_mapping()}))
    assert main([
        'plan', 'trajectory.yaml', '--compensator', 'compensator.yaml', '--plant', str(RIG_FILE),
        '--amplitude-um', '1', '--frequency-hz', '500', '-o', 'scan.yaml']) == 0
    return models / 'scan.yaml'


def learn(*further, directory='learned', offline=True):
    return main([
        'learn', 'scan.yaml', '--parameters', str(RIG_FILE), '-o', directory,
        *(['--offline'] if offline else []), *further])


def errors(directory='learned'):
    record = json.loads((Path(directory) / 'learning.json').read_text())
    return [run['nrmse_percent'] for run in record['runs']]


def test_few_runs_improve_a_scan_and_the_best_is_kept(scan, capsys):
    assert learn() == 0
    percent = errors()
    assert min(percent) < 0.16 < 0.3 * percent[0]
    assert 'the best scan: learned/best.yaml' in capsys.readouterr().out
    _, best = read_planned_scan(Path('learned/best.yaml'))
    assert best.limit_use < 1.0 + 1e-5
    # The best scan is one more scan to learn from, and begins as good as it ended.
    shutil.copy('learned/best.yaml', scan)
    assert learn('--runs', '1', directory='again') == 0
    assert errors('again')[0] == pytest.approx(min(percent), abs=0.02)


def test_the_factor_over_the_best_feedforward_is_that_of_the_two_bags(scan, capsys):
    assert learn('--runs', '2', '--compare') == 0
    found = re.search(
        r'm = (\d+), .* NRMSE ([\d.]+) % over 4 periods, ([\d.]+) times that of run 001',
        capsys.readouterr().out)
    percent, factor = float(found[2]), float(found[3])
    assert factor == pytest.approx(percent / errors()[1], rel=0.1)
    assert factor > 2.0
    assert (Path('learned') / 'bags' / 'feedforward').is_dir()


def test_an_interrupted_learning_goes_on_where_it_was(scan, capsys):
    assert learn(directory='whole') == 0
    assert learn('--runs', '2') == 0
    capsys.readouterr()
    assert learn('--resume') == 0
    assert '2 runs are there already' in capsys.readouterr().out
    assert errors() == errors('whole')
    for name in ('best.npz', 'learning.json'):
        assert (Path('learned') / name).read_bytes() == (Path('whole') / name).read_bytes()


def test_learning_goes_on_after_a_run_that_was_killed(scan, capsys):
    assert learn('--runs', '1') == 0
    killed = Path('learned/bags/001/001_0.mcap')
    killed.parent.mkdir()
    killed.write_bytes(b'the beginning of a bag')
    assert learn('--resume', '--runs', '2') == 0
    assert '1 runs are there already' in capsys.readouterr().out
    assert killed.read_bytes() == b'the beginning of a bag'
    assert len(errors()) == 2
    assert learn('--resume', '--runs', '3') == 0
    assert '2 runs are there already' in capsys.readouterr().out


def test_a_run_that_fails_leaves_what_was_learned(scan, calibrated):
    request, plan = read_planned_scan(scan)
    learning = ScanLearning(
        request, plan, Path('learned'), {
            'plant': calibrated.to_mapping(), 'trajectory': {}, 'compensator': {},
            'controller': {}})
    from piezo_ros.experiment.offline import simulate_run
    learning.next_run(simulate_run)

    def interrupted(planned, bag):
        simulate_run(planned, bag)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        learning.next_run(interrupted)
    assert len(errors()) == 1
    assert Path('learned/best.yaml').exists()


def test_parameters_that_are_not_there_are_named(scan, capsys):
    assert learn('--parameters', 'none.yaml') == 2
    assert 'none.yaml: No such file' in capsys.readouterr().err


def test_an_output_is_replaced_only_by_force(scan, capsys):
    assert learn('--runs', '1') == 0
    assert learn('--runs', '1') != 0
    assert 'learned exists; --force replaces it' in capsys.readouterr().err
    assert learn('--runs', '1', '--force') == 0


def test_live_runs_have_the_bits_of_the_offline_ones(scan):
    pytest.importorskip('rclpy')
    assert learn('--runs', '2', directory='offline') == 0
    assert learn('--runs', '2', '--composed', directory='live', offline=False) == 0
    for name in ('best.npz', 'learning.json'):
        assert (Path('live') / name).read_bytes() == (Path('offline') / name).read_bytes()


def test_learning_beside_feedback_needs_delays_that_agree(scan, capsys):
    assert learn('--scheme', 'fbff') == 1
    assert 'reference_delay_samples is 0, beside a planned scan it must equal' in (
        capsys.readouterr().err)
    assert not Path('learned').exists()
    Path('feedback.yaml').write_text(parameters_yaml(
        '/**', {'controller': {'reference_delay_samples': 1}}))
    assert learn('--scheme', 'fbff', '--parameters', 'feedback.yaml', '--runs', '3') == 0
    percent = errors()
    assert min(percent) < 0.16
    assert learn('--resume') == 1
    assert 'its runs are under the scheme fbff, not ff' in capsys.readouterr().err
