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

"""B10: what a shell, a service or a container gives a command ends in a line, no traceback."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from python_path import python_path

from piezo_ros.cli.main import main

ROOT = Path(__file__).parents[2]


def piezo(*words, **environment):
    return subprocess.run(
        [sys.executable, '-m', 'piezo_ros.cli.main', *map(str, words)], capture_output=True,
        check=False, env={**os.environ, 'PYTHONPATH': python_path(ROOT), **environment})


@pytest.mark.parametrize('command', ['simulate', 'run', 'sweep'])
def test_b10_an_output_that_is_a_circle_of_links_is_refused(tmp_path, plan, capsys, command):
    circle = tmp_path / 'circle'
    circle.symlink_to('circle')
    assert main([command, str(plan), '-o', str(circle)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f'piezo: {circle}: ')


def test_b10_a_name_that_is_no_text_is_refused_before_anything_runs(tmp_path, plan, capsys):
    output = os.fsdecode(os.fsencode(tmp_path) + b'/\xff')
    assert main(['simulate', str(plan), '-o', output]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert r'\udcff' in line
    assert 'is no text in the encoding' in line
    assert not os.path.exists(output)


def test_b10_paths_in_lists_are_checked_too(tmp_path, capsys):
    long = tmp_path / ('x' * 300)
    assert main(['report', str(tmp_path), str(long), '-o', str(tmp_path / 'out')]) == 2
    assert f'piezo: {long}: File name too long' in capsys.readouterr().err


def test_b10_a_locale_of_ascii_alone_escapes_what_it_has_no_character_for(tmp_path, plan):
    done = piezo(
        'simulate', plan, '-o', tmp_path / 'out', PYTHONIOENCODING='ascii:strict')
    assert done.returncode == 0, done.stderr
    assert rb'\xb5m' in done.stdout


@pytest.mark.slow  # It compiles everything anew.
def test_b10_a_home_that_cannot_be_written_is_no_obstacle(tmp_path, plan):
    (tmp_path / 'file').touch()
    done = piezo(
        'simulate', plan, '-o', tmp_path / 'out', HOME=str(tmp_path / 'file' / 'home'),
        TMPDIR=str(tmp_path), XDG_CACHE_HOME='')
    assert done.returncode == 0, done.stderr
    assert (tmp_path / f'piezo_ros-{os.getuid()}' / 'piezo_ros').is_dir()


def test_b10_a_reader_of_the_output_that_goes_is_no_error(tmp_path, plan):
    assert main(['simulate', str(plan), '-o', str(tmp_path / 'out')]) == 0
    (bag, *_) = sorted((tmp_path / 'out' / 'bags').iterdir())
    reading, writing = os.pipe()
    os.close(reading)
    try:
        done = subprocess.run(
            [sys.executable, '-m', 'piezo_ros.cli.main', 'bag', 'info', str(bag)], stdout=writing,
            stderr=subprocess.PIPE, check=False,
            env={**os.environ, 'PYTHONPATH': python_path(ROOT)})
    finally:
        os.close(writing)
    assert done.stderr == b''
