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

import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from piezo_ros.cli.main import main
from piezo_ros.experiment.plan import read_plan
from piezo_ros.experiment.plan.packaged_plans import PLAN_HELP, packaged_plans, plan_path
from piezo_ros.parameters.bounded_yaml import yaml_content

CONFIG = Path(__file__).resolve().parents[2] / 'config'


@pytest.fixture
def init(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        code = main(['init', *arguments])
        out, err = capsys.readouterr()
        return code, out, err

    return run


def test_without_a_name_every_example_is_listed(init):
    code, out, _ = init()
    assert code == 0
    names = [line.split()[0] for line in out.splitlines()]
    assert {'measured_stage', 'slow_stage', 'demo', 'paper'} <= {*names}


def test_a_plan_comes_with_its_files_and_can_be_read(init, tmp_path):
    code, out, _ = init('demo')
    assert code == 0
    assert 'next: piezo simulate demo/demo.yaml -o demo/out' in out
    copied, original = (
        read_plan(path) for path in (tmp_path / 'demo/demo.yaml', CONFIG / 'experiments/demo.yaml'))
    assert copied.runs == original.runs
    assert all('/' not in file for file in yaml_content(
        (tmp_path / 'demo/demo.yaml').read_text(encoding='utf-8'))['parameter_files'])


def test_a_folder_is_copied_as_it_is(init, tmp_path):
    assert init('slow_stage', '-o', 'mine')[0] == 0
    source = CONFIG / 'examples' / 'slow_stage'
    assert {path.name: path.read_bytes() for path in (tmp_path / 'mine').iterdir()} == {
        path.name: path.read_bytes() for path in source.iterdir()}


@pytest.mark.parametrize(('arguments', 'words'), [
    (('slow_stge',), "did you mean 'slow_stage'?"),
    (('demo', '-o', '.'), '. exists; -o DIR takes another'),
])
def test_what_cannot_be_copied_is_told(init, tmp_path, arguments, words):
    (tmp_path / 'mine.txt').touch()
    code, _, err = init(*arguments)
    assert code == 2
    assert words in err


def test_every_packaged_plan_goes_by_its_bare_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert {*packaged_plans()} == {path.stem for path in (CONFIG / 'experiments').glob('*.yaml')}
    assert all(re.search(rf'\b{name}\b', PLAN_HELP) for name in packaged_plans())
    for name, path in packaged_plans().items():
        assert plan_path(name) == path
    (tmp_path / 'demo').touch()
    assert plan_path('demo') == Path('demo')


def test_a_misspelt_bare_name_is_told(capsys):
    with pytest.raises(SystemExit) as left:
        main(['simulate', 'dmo', '-o', 'x'])
    assert left.value.code == 2
    assert "did you mean 'demo'?" in capsys.readouterr().err


def test_the_version_is_that_of_the_package(capsys):
    with pytest.raises(SystemExit) as left:
        main(['--version'])
    assert left.value.code == 0
    try:
        version = metadata.version('piezo_ros')
    except metadata.PackageNotFoundError:
        version = '(not installed, from its sources)'
    assert capsys.readouterr().out == f'piezo_ros {version}\n'


def test_the_package_runs_as_a_module():
    run = subprocess.run(
        [sys.executable, '-m', 'piezo_ros', '--help'], capture_output=True, text=True, check=True)
    assert run.stdout.startswith('usage: piezo ')
