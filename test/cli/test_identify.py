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

"""``piezo identify``, and a stage that is not the paper's, by the commands of the README."""

import csv
import json
import re
import shlex
import shutil
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from piezo_ros.cli.main import main
from piezo_ros.experiment.plan import read_plan

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / 'config' / 'examples' / 'slow_stage'


def five_commands():
    """Return the commands of the README behind the copy, offline and with their wildcards."""
    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    section = text.partition('## Your own stage in five commands')[2].partition('\n## ')[0]
    section = section.replace('\\\n', ' ')
    lines = re.findall(r'^    piezo (?!init )(.*)$', section, re.MULTILINE)
    commands = [shlex.split(line) for line in lines]
    return [['simulate', *words[1:]] if words[0] == 'run' else words for words in commands]


def parameters(path, node):
    return yaml.safe_load(path.read_text())[f'/**/{node}']['ros__parameters']


def errors(directory):
    """Return NRMSE in percent by scheme."""
    report = json.loads((directory / 'report.json').read_text())
    return {run['scheme']: run['nrmse_percent'] for run in report['runs']}


@pytest.fixture(scope='module')
def stage(tmp_path_factory):
    """Copy the example, go through the five commands in it, then scan by the data sheet."""
    directory = tmp_path_factory.mktemp('own') / 'my_stage'
    shutil.copytree(EXAMPLE, directory)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(directory)
        for words in five_commands():
            found = [sorted(map(str, Path().glob(word))) if '*' in word else [word]
                     for word in words]
            assert main([word for words in found for word in words]) == 0, words
        assert main(['simulate', 'untuned.yaml', '-o', 'untuned']) == 0
    return directory


@pytest.fixture(scope='module')
def triangle(tmp_path_factory):
    """Record a short decreasing triangle of 3 V, too quick for a good fit."""
    directory = tmp_path_factory.mktemp('triangle')
    (directory / 'plan.yaml').write_text(
        'format_version: 1\nscore_periods: 1\nruns: [{output: voltage, harmonics: 0, periods: 5, '
        'waveform: decreasing_triangle, frequency_hz: 100.0}]')
    assert main(['simulate', str(directory / 'plan.yaml'), '-o', str(directory / 'out')]) == 0
    (bag,) = (directory / 'out' / 'bags').iterdir()
    return bag


@pytest.fixture
def identify(tmp_path, capsys):
    output = tmp_path / 'model.yaml'

    def run(*arguments):
        code = main(['identify', *map(str, arguments), '-o', str(output)])
        out, err = capsys.readouterr()
        assert 'Traceback' not in err
        return code, out, err

    return run


def test_there_are_five_commands():
    assert [words[0] for words in five_commands()] == [
        'simulate', 'identify', 'identify', 'tune', 'simulate']


def test_five_commands_make_another_stage_follow_its_scan(stage):
    by_data_sheet, identified = errors(stage / 'untuned'), errors(stage / 'scan')
    assert by_data_sheet.keys() == identified.keys() == {'fb', 'ff', 'fbff'}
    for scheme in identified:
        assert identified[scheme] <= 0.5 * by_data_sheet[scheme], scheme
    # What the README shows, and nothing that any feedforward would reach.
    assert identified['ff'] < 0.2
    assert identified['fbff'] < 0.4
    assert min(by_data_sheet.values()) > 3.0


def test_the_models_of_the_other_stage_are_its_own(stage):
    truth = read_plan(EXAMPLE / 'identify.yaml').runs[0].plant
    found = parameters(stage / 'trajectory.yaml', 'trajectory')
    # Where the record tells which pair stands before the hysteresis, that one comes first.
    mechanics = min((1, 2), key=lambda pair: found[f'natural_frequency_{pair}_rad_per_s'])
    assert found[f'natural_frequency_{mechanics}_rad_per_s'] == pytest.approx(
        truth.natural_frequency_2_rad_per_s, rel=0.01)
    assert found[f'damping_ratio_{mechanics}'] == pytest.approx(truth.damping_ratio_2, rel=0.05)
    gains = parameters(stage / 'controller.yaml', 'controller')
    assert gains['integral_gain_per_s'] < 500.0
    # Amplitudes of its own travel, not of the paper's.
    assert gains['feedback_acceptable_amplitude_um'][-1] > 15.0


def test_the_example_needs_no_file_but_its_own(stage):
    for plan in ('identify.yaml', 'scan.yaml', 'untuned.yaml'):
        names = yaml.safe_load((EXAMPLE / plan).read_text())['parameter_files']
        assert all((stage / name).is_file() and '/' not in name for name in names)


def test_beside_the_model_of_a_hysteresis_lies_a_picture_of_what_it_leaves(stage):
    picture = stage / 'compensator.svg'
    assert ElementTree.parse(picture).getroot().tag.endswith('svg')
    for words in ('residual (nm)', 'voltage (V)', 'MRC, 10 elements', 'nm rms'):
        assert words in picture.read_text(encoding='utf-8')


def test_beside_the_dynamics_lie_the_measured_points_and_a_picture(stage):
    ElementTree.fromstring((stage / 'trajectory.svg').read_text())
    rows = list(csv.DictReader((stage / 'trajectory.csv').read_text().splitlines()))
    excited = read_plan(EXAMPLE / 'identify.yaml').runs[1].trajectory.frequencies_hz
    assert [float(row['frequency_hz']) for row in rows] == pytest.approx(excited, rel=0.05)
    used = [row for row in rows if not row['left_out']]
    assert len(used) > 0.8 * len(rows)
    for row in used:
        assert 0.9 < float(row['coherence']) <= 1.0 + 1e-12
        assert 0.0 < float(row['standard_error_um_per_um']) < 0.04 * max(
            float(row['gain_um_per_um']), 0.1)
    for row in rows:
        if row['left_out']:
            assert row['gain_um_per_um'] == ''


def test_a_rational_model_of_other_orders_serves_to_tune(stage, identify, tmp_path, capsys):
    code, out, _ = identify(
        'dynamics', *sorted((stage / 'runs' / 'bags').glob('001_*')), '--compensator',
        stage / 'compensator.yaml', '--orders', 2, 5, '--report', tmp_path / 'page')
    assert code == 0
    assert re.search('^verdict: (good|usable up to)', out, re.M)
    assert (tmp_path / 'page' / 'figures' / 'pole-zero.svg').is_file()
    found = parameters(tmp_path / 'model.yaml', 'trajectory')
    assert found['dynamics'] == 'sections'
    assert len(found['pole_frequencies_rad_per_s']) == 2
    facts = parameters(tmp_path / 'model.yaml', 'identified_dynamics')
    assert facts['points_file'] == 'model.csv'
    assert facts['numerator_order'] == 2
    assert facts['samples_used'] > 30000
    gains = tmp_path / 'gains.yaml'
    assert main(['tune', str(tmp_path / 'model.yaml'), '--sample-period-s', '1e-4', '--bound',
                 'none', '--amplitudes-um', '5', '--frequencies-hz', '28', '-o', str(gains)]) == 0
    assert 'scheme to use' in capsys.readouterr().out
    # The same stage, so much the same gain.
    own, of_six = (parameters(path, 'controller')['integral_gain_per_s'] for path in (
        gains, stage / 'controller.yaml'))
    assert own == pytest.approx(of_six, rel=0.1)


def test_d5_a_model_that_does_not_explain_its_points_is_exit_4(stage, identify, tmp_path):
    arguments = (
        'dynamics', *sorted((stage / 'runs' / 'bags').glob('001_*')), '--compensator',
        stage / 'compensator.yaml', '--orders', 0, 1)
    code, out, _ = identify(*arguments)
    assert code == 4
    assert 'verdict: do not trust, because the model misses the points by' in out
    verdict = parameters(tmp_path / 'model.yaml', 'identified_dynamics')['verdict']
    assert verdict.startswith('do not trust')
    code, _, _ = identify(*arguments, '--force', '--accept-poor')
    assert code == 0


@pytest.mark.parametrize(('options', 'complaint'), [
    (('--structure', 'rational'), '--structure rational needs --orders NUM DEN'),
    (('--structure', 'liu', '--orders', 0, 1), '--orders belongs to --structure rational'),
])
def test_orders_and_structure_must_fit_each_other(stage, identify, options, complaint):
    code, _, err = identify(
        'dynamics', *sorted((stage / 'runs' / 'bags').glob('001_*')), '--compensator',
        stage / 'compensator.yaml', *options)
    assert code == 2
    assert complaint in err


def test_a_delay_is_fitted_with_other_orders_only(stage, identify):
    code, _, err = identify(
        'dynamics', *sorted((stage / 'runs' / 'bags').glob('001_*')), '--compensator',
        stage / 'compensator.yaml', '--fit-delay')
    assert code == 2
    assert '--fit-delay belongs to --orders' in err


def test_beside_a_bound_lies_a_picture_of_it(stage, identify, tmp_path):
    code, out, _ = identify(
        'uncertainty', *sorted((stage / 'runs' / 'bags').glob('001_*')), '--compensator',
        stage / 'compensator.yaml', '--model', stage / 'trajectory.yaml')
    assert code == 0
    assert '|W| is above every one of' in out
    ElementTree.fromstring((tmp_path / 'model.svg').read_text())


def test_without_matplotlib_the_model_is_written_alone(triangle, identify, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'piezo_ros.report.figures.export', None)
    code, out, _ = identify('hysteresis', triangle, '--elements', 1, '--accept-poor')
    assert code == 0
    assert (tmp_path / 'model.yaml').is_file()
    assert not (tmp_path / 'model.svg').exists()
    assert f'model: {tmp_path / "model.yaml"}' in out.splitlines()


def test_neither_model_nor_picture_is_overwritten_unasked(triangle, identify, tmp_path):
    for name in ('model.yaml', 'model.svg'):
        (tmp_path / name).write_text('years of work')
        code, _, err = identify('hysteresis', triangle, '--elements', 1)
        assert code == 2
        assert f'{tmp_path / name} exists; --force replaces it' in err
        assert (tmp_path / name).read_text() == 'years of work'
        (tmp_path / name).unlink()


def test_a_range_that_the_excitation_does_not_cover_is_warned_of(triangle, identify, tmp_path):
    code, _, err = identify(
        'hysteresis', triangle, '--elements', 1, '--range-v', -3.5, 2, '--accept-poor')
    assert code == 0
    assert 'warning: the excitation covers -3 … 3 V of the -3.5 … 2 V asked for' in err
    assert 'WARNING: the excitation covers' in (tmp_path / 'model.yaml').read_text()


def test_a_range_that_is_covered_is_not_warned_of(triangle, identify):
    code, _, err = identify(
        'hysteresis', triangle, '--elements', 1, '--range-v', -3, 2, '--accept-poor')
    assert (code, err) == (0, '')


def test_a_range_that_is_none_is_refused(triangle, identify):
    code, _, err = identify('hysteresis', triangle, '--range-v', 3, -3)
    assert code == 2
    assert err.startswith('piezo: --range-v is (3.0, -3.0)')


def test_other_models_are_compared_in_a_table(triangle, identify):
    code, out, _ = identify('hysteresis', triangle, '--elements', 3, '--compare', '--accept-poor')
    assert code == 0
    rows = {line[:28].strip(): line[28:].split() for line in out.splitlines()}
    assert rows.pop('model') == ['parameters', 'rms', 'nm', 'cross-validated', 'nm']
    names = ['MRC', 'Prandtl-Ishlinskii', 'Bouc-Wen', 'polynomial']
    assert [name for name in rows if name in names] == names
    assert rows['MRC'][0] == '7'
    assert float(rows['MRC'][2]) < float(rows['polynomial'][2])


def test_dynamics_of_the_bare_actuator_need_a_hysteresis(stage, identify):
    (bag,) = (stage / 'runs' / 'bags').glob('001_*')
    code, _, err = identify('dynamics', bag)
    assert code == 1
    assert "no samples of the stream 'command'" in err
    code, _, err = identify('dynamics', bag, '--compensator', stage / 'trajectory.yaml')
    assert code == 2
    assert 'has no section for compensator' in err


def test_a_triangle_is_no_excitation_of_the_dynamics(stage, triangle, identify):
    code, out, _ = identify(
        'dynamics', triangle, '--compensator', stage / 'compensator.yaml')
    assert code == 4
    assert 'verdict: do not trust' in out


def test_a_bag_that_is_none_fails_in_words(identify, tmp_path):
    code, _, err = identify('hysteresis', tmp_path / 'nothing')
    assert code == 1
    assert 'nothing' in err


def test_one_of_several_samples_and_a_part_of_the_run_will_do(triangle, identify):
    def element_of(*arguments):
        code, out, _ = identify(
            'hysteresis', triangle, '--elements', 3, '--force', '--accept-poor', *arguments)
        assert code == 0
        return float(out.partition('residual ')[2].split()[0])

    whole = element_of()
    assert element_of('--every', 3) < 2.0 * whole
    # The first period alone is an easier task.
    assert element_of('--to-s', 0.01) < whole
    element_of('--from-s', 0.01, '--used')


@pytest.mark.parametrize(('arguments', 'message'), [
    (('--from-s', 7.0), 'no sample from --from-s 7 to --to-s inf, it lasts from 0 s to 0.04999 s'),
    (('--from-s', 0.02, '--to-s', 0.01), 'no sample from'),
    (('--every', 10**6, '--from-s', 0.01), 'every is 1000000, allowed is 1 … 40 for 4000 samples'),
])
def test_a_part_without_samples_is_refused(triangle, identify, arguments, message):
    code, _, err = identify('hysteresis', triangle, *arguments)
    assert code == 1
    assert message in err


def test_d5_a_hysteresis_that_misses_its_data_exits_4_and_says_so_in_the_file(
        triangle, identify, tmp_path):
    code, out, _ = identify('hysteresis', triangle, '--elements', 1)
    assert code == 4
    assert 'verdict: do not trust, because' in out
    sections = yaml.safe_load((tmp_path / 'model.yaml').read_text())
    facts = sections['/**/identified_hysteresis']['ros__parameters']
    assert facts['verdict'].startswith('do not trust')
    assert facts['samples_used'] > 1000
    assert facts['samples_lost'] == 0
    assert facts['largest_residual_percent'] > 2.0
    assert len(facts['amplitude_levels_v']) == len(facts['amplitude_residual_percent']) >= 3
    assert facts['fit_percent'] < 99.0
    assert facts['residual_rms_um'] > 0.0


@pytest.mark.slow
def test_the_pages_of_models_show_what_is_left(triangle, stage, identify, tmp_path):
    code, out, err = identify('hysteresis', triangle, '--compare', '--report', tmp_path / 'loops')
    assert code in (0, 4), err
    assert 'report: ' in out
    page = (tmp_path / 'loops' / 'report.html').read_text()
    assert 'Other models of the same loops' in page
    (sine,) = (stage / 'runs' / 'bags').glob('001_*')
    code, out, err = identify(
        'dynamics', sine, '--compensator', stage / 'compensator.yaml', '--report',
        tmp_path / 'response', '--force')
    assert code in (0, 4), err
    assert {path.stem for path in (tmp_path / 'response' / 'figures').glob('*.svg')} >= {
        'response', 'residual', 'pole-zero'}


def test_a_directory_that_is_something_else_is_left_alone(triangle, identify, tmp_path):
    (tmp_path / 'mine').mkdir()
    (tmp_path / 'mine' / 'file').touch()
    code, _, err = identify('hysteresis', triangle, '--report', tmp_path / 'mine')
    assert code == 2
    assert '--force replaces it' in err
