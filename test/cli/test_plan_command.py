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

"""``piezo plan``: from model files to a scan that a plan of runs plays as predicted."""

import json

import numpy as np
import pytest
import yaml

from piezo_ros.bag import read
from piezo_ros.cli.main import main
from piezo_ros.control.tables.motion_table import read_motion_table
from piezo_ros.experiment.planned_scan import read_planned_scan
from piezo_ros.model import RigParameters
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.parameter_file import read_parameter_set

RUNS = """\
format_version: 1
parameter_files: [{rig}, scan.yaml]
score_periods: 4
runs:
  - scheme: ff
    periods: 20
    plant: {{noise_rms_um: 0.0, dac_bits: 0, adc_bits: 0}}
  - scheme: fbff
    periods: 20
    controller: {{reference_delay_samples: 1}}
    plant: {{noise_rms_um: 0.0, dac_bits: 0, adc_bits: 0}}
"""


def plan(*further, amplitude_um='2.0', frequency_hz='600'):
    return main([
        'plan', 'trajectory.yaml', '--compensator', 'compensator.yaml', '--plant', 'rig.yaml',
        '--amplitude-um', amplitude_um, '--frequency-hz', frequency_hz, '-o', 'scan.yaml',
        *further])


def test_a_planned_scan_runs_as_predicted(models, rig_file, capsys):
    assert plan() == 0
    printed = capsys.readouterr().out
    _, planned = read_planned_scan(models / 'scan.yaml')
    assert f'predicted NRMSE {planned.predicted_nrmse_percent:.3f} %' in printed
    assert 'amplifier: 100.0 % of its limits' in printed
    (models / 'runs.yaml').write_text(RUNS.format(rig=rig_file))
    assert main(['simulate', 'runs.yaml', '-o', 'out']) == 0
    report = json.loads((models / 'out' / 'report.json').read_text())
    ff, fbff = (run['nrmse_percent'] for run in report['runs'])
    assert ff == pytest.approx(planned.predicted_nrmse_percent, abs=0.005)
    assert fbff < planned.predicted_nrmse_percent + 0.02


@pytest.mark.parametrize('shape', [
    ('--offset-um', '2'),
    ('--waveform', 'sawtooth', '--flyback-fraction', '0.3', '--free-turn', '0.1'),
    ('--offset-um', '-2.5', '--turn-fraction', '0.3'),
])
def test_a_scan_of_any_shape_runs_as_predicted(models, rig_file, shape):
    assert plan(*shape, amplitude_um='1.2', frequency_hz='300') == 0
    request, planned = read_planned_scan(models / 'scan.yaml')
    (models / 'runs.yaml').write_text(RUNS.format(rig=rig_file))
    assert main(['simulate', 'runs.yaml', '-o', 'out']) == 0
    ff, fbff = json.loads((models / 'out' / 'report.json').read_text())['runs']
    assert ff['nrmse_percent'] == pytest.approx(planned.predicted_nrmse_percent, abs=0.01)
    assert fbff['nrmse_percent'] < planned.predicted_nrmse_percent + 0.02
    run = read(models / 'out' / ff['bag'])
    assert np.mean(run.reference_um[-request.reference_um.size:]) == pytest.approx(
        request.offset_um, abs=1e-9)
    # From rest on, the start and the way to the mean as well.
    rig = read_parameter_set(models / 'rig.yaml', 'plant', RigParameters)
    steps_v = np.abs(np.diff(run.voltage_v, prepend=0.0))
    assert steps_v.max() <= 1.001 * rig.slew_limit_v_per_s * 1e-5


def test_a_planned_scan_is_read_back_as_it_was_made(models):
    assert plan('--free-turn', '0.2', '--average-slew-v-per-s', '8000') == 0
    request, planned = read_planned_scan(models / 'scan.yaml')
    assert request.free_turn == 0.2
    assert request.limits.average_slew_v_per_s == 8000.0
    content = yaml.safe_load((models / 'scan.yaml').read_text())
    facts = content['/**/planned_scan']['ros__parameters']
    np.testing.assert_array_equal(planned.coefficients_v, facts['coefficients_v'])
    motion = read_motion_table(models / 'scan.npz', 1e-5)
    assert motion.reference_um.size - motion.repeat_from == planned.reference_um.size
    np.testing.assert_array_equal(
        motion.reference_um[motion.repeat_from:], planned.reference_um)


def test_nothing_is_replaced_unasked(models, capsys):
    assert plan() == 0
    assert plan() == 2
    assert 'scan.yaml exists; --force replaces it' in capsys.readouterr().err
    assert plan('--force') == 0


@pytest.mark.parametrize(('given', 'problem'), [
    ({'amplitude_um': '7'}, '--amplitude-um is 7, allowed is above 0 … 6 um (the reach'),
    ({'frequency_hz': '301.2345678'}, '--frequency-hz is 301.2345678: at a sample period of 1e-05'),
    ({'frequency_hz': '30000'}, '--frequency-hz is 30000.0, allowed is above 0 … 25000'),
])
def test_what_cannot_be_planned_is_refused_by_name(models, capsys, given, problem):
    assert plan(**given) == 2
    assert problem in capsys.readouterr().err
    assert not (models / 'scan.yaml').exists()


def test_a_wish_far_beyond_the_amplifier_is_refused(models, capsys):
    assert plan('--average-slew-v-per-s', '100') == 2
    assert 'the amplifier leaves an error of' in capsys.readouterr().err
    assert not (models / 'scan.yaml').exists()


def test_another_file_is_no_planned_scan(models):
    with pytest.raises(PlanError, match='no planned scan: it has no section planned_scan'):
        read_planned_scan(models / 'trajectory.yaml')
    assert plan() == 0
    text = (models / 'scan.yaml').read_text()
    (models / 'scan.yaml').write_text(text.replace('format_version: 1', 'format_version: 9'))
    with pytest.raises(PlanError, match='format_version of planned_scan is 9'):
        read_planned_scan(models / 'scan.yaml')


def plan_motion(reference_um, *further):
    np.savez('motion.npz', reference_um=reference_um)
    return main([
        'plan', 'trajectory.yaml', '--compensator', 'compensator.yaml', '--plant', 'rig.yaml',
        '--motion', 'motion.npz', '-o', 'played.yaml', *further])


def smooth(share):
    share = np.clip(share, 0.0, 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def test_any_motion_runs_as_predicted(models, rig_file, capsys):
    time_s = np.arange(2000) * 1e-5
    assert plan_motion(2.0 * smooth((time_s - 0.004) / 0.001)) == 0
    printed = capsys.readouterr().out
    predicted_nm = float(printed.partition('predicted error ')[2].partition(' nm')[0])
    assert predicted_nm < 2.0
    (models / 'runs.yaml').write_text(
        RUNS.format(rig=rig_file).replace('scan.yaml', 'played.yaml')
        .replace('periods: 20', 'periods: 1').replace('score_periods: 4', 'score_periods: 1'))
    assert main(['simulate', 'runs.yaml', '-o', 'out']) == 0
    report = json.loads((models / 'out' / 'report.json').read_text())
    rms_nm = report['runs'][0]['nrmse_percent'] / 100.0 * 2.0 * 1e3
    assert rms_nm == pytest.approx(predicted_nm, abs=0.3)


@pytest.mark.parametrize(('reference_um', 'problem'), [
    (np.linspace(0.5, 1.0, 100), 'reference_um is 0.5 um at sample 0: a run begins at rest'),
    (8.0 * smooth(np.arange(2000) / 1500), 'motion.npz: it reaches 8 um, the stage travels 6 um'),
    (2.0 * smooth(np.arange(400) / 5), 'the slope of the voltage is'),
])
def test_a_motion_that_the_stage_cannot_make_is_refused(models, capsys, reference_um, problem):
    assert plan_motion(reference_um) == 1
    assert problem in capsys.readouterr().err
    assert not (models / 'played.yaml').exists()


def test_a_motion_beyond_the_average_current_is_refused(models, capsys):
    step = 2.0 * smooth((np.arange(2000) * 1e-5 - 0.004) / 0.001)
    rig = yaml.safe_load((models / 'rig.yaml').read_text())
    rig['/**/plant']['ros__parameters'] |= {
        'average_slew_limit_v_per_s': 1000.0, 'average_slew_time_s': 5e-4}
    (models / 'rig.yaml').write_text(yaml.safe_dump(rig))
    assert plan_motion(step) == 1
    assert 'the slope of the voltage, averaged over 0.0005 s, is ' in capsys.readouterr().err
    assert not (models / 'played.yaml').exists()
    # Slowly enough, the same way is within it.
    assert plan_motion(2.0 * smooth((np.arange(3000) * 1e-5 - 0.004) / 0.02)) == 0


def test_either_a_scan_or_a_motion_is_planned(models, capsys):
    assert plan('--motion', 'x.csv') == 2
    assert main([
        'plan', 'trajectory.yaml', '--compensator', 'compensator.yaml', '--plant', 'rig.yaml',
        '--amplitude-um', '1', '-o', 'scan.yaml']) == 2
    assert 'either --amplitude-um and --frequency-hz, or --motion' in capsys.readouterr().err
