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
from piezo_ros.experiment.campaign import run_campaign
from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.output_directory import keep_plan, prepare_directory
from piezo_ros.experiment.plan import read_plan
from piezo_ros.parameters.errors import PlanError


def test_an_absent_or_empty_directory_is_taken(tmp_path):
    for directory in (tmp_path / 'deep' / 'new', tmp_path / 'empty'):
        if directory.name == 'empty':
            directory.mkdir()
        prepare_directory(directory, force=False)
        assert directory.is_dir()


def test_an_earlier_output_is_replaced_by_force_only(write_plan, tmp_path):
    output = tmp_path / 'out'
    prepare_directory(output, force=False)
    run_campaign(read_plan(write_plan()), output, simulate_run)
    with pytest.raises(PlanError, match='out exists; --force replaces it'):
        prepare_directory(output, force=False)
    assert (output / 'report.html').exists()
    prepare_directory(output, force=True)
    assert not (output / 'report.html').exists()
    assert not (output / 'bags').exists()


@pytest.mark.parametrize('name', ['thesis.tex', 'plan.yaml', 'report.html', 'bags/run/run.mcap'])
@pytest.mark.parametrize('force', [False, True])
def test_a_directory_of_somebody_else_is_never_deleted(tmp_path, name, force):
    precious = tmp_path / 'mine' / name
    precious.parent.mkdir(parents=True)
    precious.write_text('years of work')
    with pytest.raises(PlanError, match='exists'):
        prepare_directory(tmp_path / 'mine', force=force)
    assert precious.read_text() == 'years of work'


@pytest.mark.parametrize('force', [False, True])
def test_a_file_is_not_taken_for_a_directory(tmp_path, force):
    path = tmp_path / 'mine'
    path.write_text('years of work')
    with pytest.raises(PlanError, match='mine exists'):
        prepare_directory(path, force=force)
    assert path.read_text() == 'years of work'


def bags_of(directory):
    return {
        str(path.relative_to(directory)): path.read_bytes()
        for path in (directory / 'bags').rglob('*') if path.is_file()}


def test_an_output_is_done_again_from_its_own_plan_with_the_same_bytes(write_plan, tmp_path):
    rig = tmp_path / 'elsewhere' / 'rig.yaml'
    rig.parent.mkdir()
    rig.write_text('/**/plant:\n  ros__parameters: {noise_rms_um: 0.002}\n')
    other = tmp_path / 'rig.yaml'
    other.write_text('/**/compensator:\n  ros__parameters: {compiled: true}\n')
    plan = write_plan(parameter_files=['elsewhere/rig.yaml', 'rig.yaml'])
    run_campaign(read_plan(plan), tmp_path / 'out', simulate_run)
    rig.unlink()
    other.unlink()
    (tmp_path / 'out').rename(tmp_path / 'moved')
    run_campaign(read_plan(tmp_path / 'moved' / 'plan.yaml'), tmp_path / 'again', simulate_run)
    assert bags_of(tmp_path / 'again') == bags_of(tmp_path / 'moved')
    assert (tmp_path / 'again' / 'plan.yaml').read_bytes() == (
        tmp_path / 'moved' / 'plan.yaml').read_bytes()
    assert read_plan(tmp_path / 'again' / 'plan.yaml').title == read_plan(
        tmp_path / 'moved' / 'plan.yaml').title


@pytest.mark.slow
def test_an_output_with_motions_out_of_files_is_done_again_from_itself(
        write_plan, tmp_path, monkeypatch):
    here = tmp_path / 'here'
    here.mkdir()
    monkeypatch.chdir(here)
    wave_um = np.sin(np.linspace(0.0, 2.0 * np.pi, 1000, endpoint=False))
    folders = {tmp_path / 'beside': 0.5, tmp_path: 0.4, here: 0.3}
    (tmp_path / 'beside').mkdir()
    for name, (folder, amplitude_um) in zip(
            ('wave.csv', 'wave.csv', 'of_here.csv'), folders.items(), strict=True):
        (folder / name).write_text('# repeat_from: 0\nreference_um\n' + '\n'.join(
            map(repr, (amplitude_um * wave_um).tolist())))
    played = {
        'scheme': 'fb', 'waveform': 'file', 'frequency_hz': 100.0, 'periods': 5, 'ramp_periods': 1,
        'harmonics': 0}
    plan = write_plan(runs=[
        {**played, 'file': ['beside/wave.csv', 'of_here.csv']},
        {**played, 'file': 'beside/wave.csv',
         'changes': [{'at_sample': 2000, 'file': 'wave.csv'}]}])
    prepare_directory(tmp_path / 'out', force=False)
    run_campaign(read_plan(plan), tmp_path / 'out', simulate_run)
    (tmp_path / 'out').rename(tmp_path / 'moved')
    for folder in folders:
        for file in folder.glob('*.csv'):
            file.unlink()
    prepare_directory(tmp_path / 'again', force=False)
    run_campaign(read_plan(tmp_path / 'moved' / 'plan.yaml'), tmp_path / 'again', simulate_run)
    for part in 'plan.yaml', *(f'plan_files/{name}.csv' for name in ('wave', 'wave_2', 'of_here')):
        assert (tmp_path / 'again' / part).read_bytes() == (tmp_path / 'moved' / part).read_bytes()
    bags = sorted((tmp_path / 'moved' / 'bags').iterdir())
    assert len(bags) == 3
    assert bags_of(tmp_path / 'again') == bags_of(tmp_path / 'moved')
    trajectory = read(bags[2]).parameters['/trajectory']
    files = [trajectory['file'], json.loads(trajectory['file_changes'])[0]['file']]
    assert [(bags[2] / file).resolve() for file in files] == [
        tmp_path / 'moved' / 'plan_files' / name for name in ('wave.csv', 'wave_2.csv')]


def test_a_motion_that_a_parameter_file_names_is_copied_and_played_too(
        write_plan, tmp_path, monkeypatch):
    elsewhere = tmp_path / 'elsewhere'
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    wave_um = 0.3 * np.sin(np.linspace(0.0, 2.0 * np.pi, 100, endpoint=False))
    planned = tmp_path / 'planned'
    planned.mkdir()
    (planned / 'wave.csv').write_text(
        '# repeat_from: 0\nreference_um\n' + '\n'.join(map(repr, wave_um.tolist())))
    for name in 'scan', 'same_scan':
        (planned / f'{name}.yaml').write_text(
            '# planned\n/**/trajectory:\n  ros__parameters: {waveform: file, file: wave.csv, '
            'frequency_hz: 1000.0, harmonics: 0, ramp_periods: 0.0}\n')
    plan = write_plan(
        parameter_files=['planned/scan.yaml', 'planned/same_scan.yaml'],
        runs=[{'scheme': 'fb', 'periods': 5}])
    assert read_plan(plan).runs[0].trajectory.file == str(planned / 'wave.csv')
    prepare_directory(tmp_path / 'out', force=False)
    run_campaign(read_plan(plan), tmp_path / 'out', simulate_run)
    copies = tmp_path / 'moved' / 'plan_files'
    (tmp_path / 'out').rename(tmp_path / 'moved')
    assert sorted(each.name for each in copies.iterdir()) == [
        'same_scan.yaml', 'scan.yaml', 'wave.csv']
    assert (copies / 'scan.yaml').read_bytes() == (planned / 'scan.yaml').read_bytes()
    for file in planned.iterdir():
        file.unlink()
    prepare_directory(tmp_path / 'again', force=False)
    run_campaign(read_plan(tmp_path / 'moved' / 'plan.yaml'), tmp_path / 'again', simulate_run)
    assert bags_of(tmp_path / 'again') == bags_of(tmp_path / 'moved')
    (bag,) = (tmp_path / 'moved' / 'bags').iterdir()
    assert (bag / read(bag).parameters['/trajectory']['file']).resolve() == copies / 'wave.csv'


def test_a_parameter_file_names_the_copy_of_its_motion(tmp_path):
    for folder in 'one', 'two':
        (tmp_path / folder).mkdir()
        (tmp_path / folder / 'wave.csv').write_text(folder)
        (tmp_path / folder / f'{folder}.yaml').write_text(
            f'# of {folder}\ntrajectory: {{ros__parameters: {{file: "wave.csv"}}}}  # a wave\n')
    plan = tmp_path / 'plan.yaml'
    plan.write_text('parameter_files: [one/one.yaml, two/two.yaml, one/one.yaml]\n')
    kept = keep_plan(plan, tmp_path / 'out')
    copies = tmp_path / 'out' / 'plan_files'
    assert kept.files[str(tmp_path / 'two' / 'wave.csv')] == copies / 'wave_2.csv'
    assert (copies / 'wave_2.csv').read_text() == 'two'
    assert (copies / 'one.yaml').read_text() == (tmp_path / 'one' / 'one.yaml').read_text().replace(
        '"wave.csv"', 'wave.csv')
    assert (copies / 'two.yaml').read_text() == (
        '# of two\ntrajectory: {ros__parameters: {file: wave_2.csv}}  # a wave\n')


def test_the_copy_of_a_plan_keeps_its_comments_and_gets_its_title(tmp_path):
    (tmp_path / 'a b.yaml').write_text('{}\n')
    plan = tmp_path / 'mine.yaml'
    plan.write_text(
        '# why µ\nformat_version: 1\nparameter_files: ["a b.yaml"]  # the rig\nruns:\n'
        '  - {scheme: ff}')
    text = keep_plan(plan, tmp_path / 'out').text
    assert text == (
        '# why µ\nformat_version: 1\nparameter_files: [plan_files/a b.yaml]  # the rig\nruns:\n'
        '  - {scheme: ff}\ntitle: mine\n')
    assert (tmp_path / 'out' / 'plan_files' / 'a b.yaml').read_text() == '{}\n'
