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

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from python_path import python_path

import piezo_ros
from piezo_ros.model.step import marked_steps

PACKAGE = Path(piezo_ros.__file__).parent
INVERSE = (
    'import numba; numba.config.CACHE_DIR = "others";'
    'from piezo_ros.model import MaxwellResistiveCapacitor as Operator;'
    'print(Operator([1.0], []).inverse([2.0])[0][0]);'
    'assert numba.config.CACHE_DIR == "others"')


@pytest.fixture
def package(tmp_path):
    """A copy of the package that a test may change."""
    copied = tmp_path / 'copy' / 'piezo_ros'
    shutil.copytree(PACKAGE, copied, ignore=shutil.ignore_patterns('__pycache__'))
    return copied


def cache_directory(package):
    """The directory that a copy of the package would use, in this process."""
    spec = importlib.util.spec_from_file_location(
        'compiled_of_a_copy', package / 'model' / 'compiled.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module._cache_directory()


def test_compiled_code_is_kept_by_the_content_of_the_sources(package):
    before = cache_directory(package)
    assert cache_directory(package) == before
    for changed in ('model/step.py', 'model/converter.py', 'control/controller_step.py'):
        with (package / changed).open('a') as source:
            source.write('# changed\n')
        after = cache_directory(package)
        assert after != before
        before = after
    with (package / 'report' / 'html.py').open('a') as source:
        source.write('# changed\n')
    assert cache_directory(package) == before


def test_the_cache_is_where_the_user_keeps_caches(package, monkeypatch, tmp_path):
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'mine'))
    assert cache_directory(package).parent == tmp_path / 'mine' / 'piezo_ros'
    monkeypatch.delenv('XDG_CACHE_HOME')
    monkeypatch.setenv('HOME', str(tmp_path / 'home'))
    assert cache_directory(package).parent == tmp_path / 'home' / '.cache' / 'piezo_ros'


def test_a_changed_step_is_compiled_anew_even_under_the_old_time_stamp(package, tmp_path):
    environment = {
        **os.environ, 'PYTHONPATH': python_path(package.parent),
        'XDG_CACHE_HOME': str(tmp_path / 'cache'), 'PYTHONDONTWRITEBYTECODE': '1'}

    def voltage():
        done = subprocess.run(
            [sys.executable, '-c', INVERSE], env=environment, cwd=tmp_path, text=True,
            capture_output=True, check=False)
        assert done.returncode == 0, done.stderr
        return float(done.stdout)

    assert voltage() == 2.0
    compiled = list((tmp_path / 'cache' / 'piezo_ros').rglob('*.nbc'))
    assert compiled
    step = package / 'model' / 'hysteresis.py'
    stamp = step.stat()
    text = step.read_text()
    line = 'return state[line + _STIFFNESS] * displacement_um - state[line + _HELD_V]'
    assert text.count(line) == 2
    step.write_text(text.replace(line, f'{line} + 1.0'))
    os.utime(step, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    assert voltage() == 3.0


def test_every_marked_step_is_still_an_ordinary_function():
    assert {'inverse_step', 'forward_step', 'rig_step'} <= {
        step.__name__ for step in marked_steps()}
    assert all(type(step).__name__ == 'function' for step in marked_steps())
