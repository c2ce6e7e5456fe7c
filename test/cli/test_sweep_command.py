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

import sys

import pytest

from piezo_ros.cli.main import main

PLAN = """\
format_version: 1
runs: [{periods: 5}]
sweep:
  draws: 6
  parameters: {plant.gain_mismatch: {uniform: [-0.05, 0.05]}}
"""


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / 'plan.yaml'
    path.write_text(PLAN)
    return path


def test_a_sweep_is_done_and_resumed(plan, tmp_path, capsys):
    arguments = ['sweep', str(plan), '-o', str(tmp_path / 'out'), '--workers', '1']
    assert main(arguments) == 0
    output = capsys.readouterr()
    assert 'fbff triangle 1 um 300 Hz m = 9' in output.out
    assert '6 runs in ' in output.out
    assert '6 of 6 runs' in output.err
    assert (tmp_path / 'out' / 'runs' / '000005' / 'run.json').is_file()
    plan.write_text(PLAN.replace('draws: 6', 'draws: 8'))
    assert main([*arguments, '--bags']) == 0
    assert '6 runs had been done before' in capsys.readouterr().out
    assert (tmp_path / 'out' / 'runs' / '000007' / 'bag' / 'metadata.yaml').is_file()


def test_failed_runs_are_told_at_the_end(plan, tmp_path, capsys):
    plan.write_text(PLAN.replace(
        'plant.gain_mismatch: {uniform: [-0.05, 0.05]}',
        'plant.operating_point_v: {choice: [5.0, 11.0]}'))
    assert main(['sweep', str(plan), '-o', str(tmp_path / 'out'), '--workers', '1']) == 1
    assert 'operating_point_v is 11.0' in capsys.readouterr().err


@pytest.mark.parametrize(('arguments', 'message'), [
    (['--scheduler', 'tcp://localhost:1', '--engine', 'dask', '--workers', '2'], (
        '--workers has no effect beside --scheduler')),
    (['--scheduler', 'tcp://localhost:1'], '--scheduler needs --engine dask'),
])
def test_wrong_options_are_refused(plan, tmp_path, arguments, message, capsys):
    assert main(['sweep', str(plan), '-o', str(tmp_path / 'out'), *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()


def test_a_directory_with_something_else_is_left_alone(plan, tmp_path, capsys):
    (tmp_path / 'out').mkdir()
    (tmp_path / 'out' / 'mine').touch()
    assert main(['sweep', str(plan), '-o', str(tmp_path / 'out'), '--force']) == 2
    assert 'is no earlier output' in capsys.readouterr().err
    assert (tmp_path / 'out' / 'mine').exists()


def test_without_dask_the_other_engine_is_named(plan, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'distributed', None)
    assert main(['sweep', str(plan), '-o', str(tmp_path / 'out'), '--engine', 'dask']) == 1
    assert 'pip install piezo_ros[dask]' in capsys.readouterr().err


def test_a_sweep_is_not_simulated_as_a_plan_by_mistake(plan, tmp_path, capsys):
    assert main(['simulate', str(plan), '-o', str(tmp_path / 'out')]) == 2
    assert 'piezo sweep does it' in capsys.readouterr().err
