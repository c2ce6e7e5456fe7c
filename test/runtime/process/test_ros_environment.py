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

"""B10: domain, log directory and namespace are checked before rclpy is initialised."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from python_path import python_path

from piezo_ros.cli.main import main
from piezo_ros.parameters.errors import PlanError
from piezo_ros.runtime.process.ros_environment import (
    check_ros_environment,
    checked_arguments,
    checked_namespace,
)

ROOT = Path(__file__).parents[3]
PLAN = 'format_version: 1\nruns: [{scheme: ff}]\n'


@pytest.fixture
def no_log_directory(tmp_path):
    (tmp_path / 'file').touch()
    return str(tmp_path / 'file' / 'log')


@pytest.mark.parametrize('domain', ['', '0', ' 7 ', '232'])
def test_domains_that_ros_knows(monkeypatch, domain):
    monkeypatch.setenv('ROS_DOMAIN_ID', domain)
    check_ros_environment()


@pytest.mark.parametrize('domain', ['abc', '233', '-1', '1.5'])
def test_b10_other_domains_are_refused(monkeypatch, domain):
    monkeypatch.setenv('ROS_DOMAIN_ID', domain)
    with pytest.raises(PlanError, match=f"ROS_DOMAIN_ID is '{domain}'.*0 … 232"):
        check_ros_environment()


@pytest.mark.parametrize('variable', ['ROS_LOG_DIR', 'ROS_HOME'])
def test_b10_a_log_directory_that_cannot_be_written_is_named(
        monkeypatch, no_log_directory, variable):
    monkeypatch.delenv('ROS_LOG_DIR', raising=False)
    monkeypatch.setenv(variable, no_log_directory)
    with pytest.raises(PlanError, match=f"{variable} is '{no_log_directory}'"):
        check_ros_environment()


@pytest.mark.parametrize('home', [None, 'unwritable'])
def test_b10_without_a_home_the_logs_are_temporary_files(monkeypatch, no_log_directory, home):
    for variable in ('HOME', 'ROS_HOME'):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv('ROS_LOG_DIR', '')
    if home:
        monkeypatch.setenv('HOME', no_log_directory)
    check_ros_environment()
    assert os.access(os.environ['ROS_LOG_DIR'], os.W_OK)


@pytest.mark.parametrize(('given', 'namespace'), [
    ('a', '/a'), ('/a/', '/a'), ('a/b_1', '/a/b_1'), ('/', '/'), ('', '/')])
def test_a_namespace_is_written_as_ros_wants_it(given, namespace):
    assert checked_namespace(given) == namespace
    if given:
        assert checked_arguments(['--ros-args', '-r', f'plant:__ns:={given}']) == [
            '--ros-args', '-r', f'plant:__ns:={namespace}']


@pytest.mark.parametrize('given', ['a b', '/a//b', '1a', 'a-b', 'ä', 240 * 'a'])
def test_b10_other_namespaces_are_refused(given):
    with pytest.raises(PlanError, match=f"the namespace is '{given}'.*allowed are"):
        checked_namespace(given)


@pytest.mark.parametrize(('variable', 'value', 'words'), [
    ('ROS_DOMAIN_ID', 'abc', []), ('ROS_LOG_DIR', '/proc/x', []),
    ('', '', ['--namespace', 240 * 'a'])])
def test_b10_a_live_run_refuses_before_it_touches_its_output(
        tmp_path, monkeypatch, capsys, variable, value, words):
    if variable:
        monkeypatch.setenv(variable, value)
    (tmp_path / 'plan.yaml').write_text(PLAN)
    output = tmp_path / 'out'
    assert main(['run', str(tmp_path / 'plan.yaml'), '-o', str(output), *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f'piezo: {variable or "the namespace"} is ')
    assert not output.exists()


@pytest.mark.parametrize('words', [['--namespace', 'a b'], []])
def test_b10_a_check_refuses_alike(monkeypatch, capsys, words):
    if not words:
        monkeypatch.setenv('ROS_DOMAIN_ID', '240')
    assert main(['check', 'plant', *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith('piezo: ')


@pytest.mark.parametrize('name', ['plant', 'stamped'])
def test_b10_a_node_refuses_in_one_line(name):
    done = subprocess.run(
        [sys.executable, '-m', 'piezo_ros.nodes.executables', name, '--ros-args', '-r',
         f'__ns:=/{240 * "a"}'],
        capture_output=True, text=True, check=False,
        env={**os.environ, 'PYTHONPATH': python_path(ROOT)})
    assert done.returncode == 1
    assert 'Traceback' not in done.stderr
    assert 'the namespace is' in done.stderr.splitlines()[-1]


def test_b10_a_node_without_a_home_starts(tmp_path):
    environment = {**os.environ, 'PYTHONPATH': python_path(ROOT), 'TMPDIR': str(tmp_path)}
    for variable in ('HOME', 'ROS_HOME', 'ROS_LOG_DIR', 'XDG_CACHE_HOME'):
        environment.pop(variable, None)
    done = subprocess.run(
        [sys.executable, '-m', 'piezo_ros.nodes.executables', 'trajectory', '--ros-args', '-p',
         'handshake_timeout_s:=0.1'], capture_output=True, text=True, check=False, env=environment)
    assert 'reliable readers' in done.stderr
    assert (tmp_path / f'piezo_ros-{os.getuid()}' / 'log').is_dir()
