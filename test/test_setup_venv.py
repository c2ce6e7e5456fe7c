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

"""The environments of make: which ROS they get, and when they are made anew."""

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
import setuptools

REPOSITORY = Path(__file__).resolve().parents[1]

# `FAKE -m venv` makes an environment; its python notes what pip is to install. ROS is not sourced.
FAKE_PYTHON = f"""\
case "$*" in
    *'-m venv'*)
        for venv; do :; done
        mkdir -p "$venv/bin"
        cp "$0" "$venv/bin/python" ;;
    *'-m pip --version'*) ;;
    *'-m pip install'*)
        for what; do :; done
        echo "$what" >> "$(dirname "$0")/../installed" ;;
    *_base_executable*) echo "$0" ;;
    -) exit 1 ;;
    *) exec '{sys.executable}' "$@" ;;
esac
"""


@pytest.fixture(scope='module')
def metadata():
    handed = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(REPOSITORY)
        patch.setattr(sys, 'argv', ['setup.py', 'build'])
        patch.setattr(setuptools, 'setup', lambda **arguments: handed.update(arguments))
        runpy.run_path('setup.py', run_name='__main__')
    return handed


def requirements(topic):
    return subprocess.run(
        [sys.executable, REPOSITORY / '.ci' / 'requirements', topic],
        capture_output=True, text=True, check=True).stdout.splitlines()


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    """Put a shell script of that name first in the PATH."""
    folder = tmp_path / 'stand_ins'
    folder.mkdir()
    for variable in ('DISTRO', 'ROS_DISTRO'):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv('PATH', f'{folder}{os.pathsep}{os.environ["PATH"]}')

    def put(name, text):
        (folder / name).write_text(f'#!/bin/sh\n{text}\n', encoding='utf-8')
        (folder / name).chmod(0o755)
    return put


@pytest.fixture
def set_up(stand_in, tmp_path):
    stand_in('fake-python', FAKE_PYTHON)
    stand_in('uname', 'echo Linux x86_64')

    def call(*arguments, **environment):
        return subprocess.run(
            ['bash', REPOSITORY / '.ci' / 'setup-venv', 'fake-python', tmp_path / 'venv',
             *arguments],
            env={**os.environ, **environment}, capture_output=True, text=True, check=False)
    return call


def installed(tmp_path):
    return (tmp_path / 'venv' / 'installed').read_text(encoding='utf-8').split()


def test_the_oldest_versions_are_tested_as_setup_allows_them(metadata):
    floors = dict(requirement.split('>=') for requirement in metadata['install_requires'])
    assert requirements('oldest') == [f'{name}=={floor}' for name, floor in floors.items()]


def test_setup_allows_what_ubuntu_24_04_brings(metadata):
    def numbers(version):
        return [*map(int, version.split('.'))]

    floors = dict(requirement.split('>=') for requirement in metadata['install_requires'])
    text = (REPOSITORY / '.ci' / 'noble.txt').read_text(encoding='utf-8')
    noble = dict(re.findall(r'^([\w-]+)==([\d.]+)$', text, re.MULTILINE))
    assert {'matplotlib', 'numba', 'numpy', 'scipy'} <= noble.keys()
    for name, version in noble.items():
        assert numbers(version) >= numbers(floors[name]), name


def test_the_default_distribution_is_that_of_setup(metadata):
    (default,) = requirements('default')
    (distributions,) = requirements('distributions')
    extras = metadata['extras_require']
    assert distributions.split() == ['jazzy', 'kilted']
    assert extras['ros'] == extras[default]
    # No wheel suits both, so that two of them in one environment are refused by pip.
    assert not {*extras['jazzy']} & {*extras['kilted']}


def test_another_distribution_renews_the_environment_and_the_same_does_not(set_up, tmp_path):
    assert set_up(DISTRO='kilted').returncode == 0
    assert set_up('test', DISTRO='kilted').returncode == 0
    assert installed(tmp_path) == ['.[kilted]', '.[kilted,test]']
    done = set_up()
    assert done.returncode == 0, done.stderr
    assert 'was made for another ROS (wheels of kilted): renewing it' in done.stdout
    assert installed(tmp_path) == [f'.[{requirements("default")[0]}]']


def test_an_environment_that_does_not_tell_its_ros_is_renewed(set_up, tmp_path):
    assert set_up().returncode == 0
    (tmp_path / 'venv' / '.made-for').unlink()
    assert set_up('test').returncode == 0
    assert installed(tmp_path) == [f'.[{requirements("default")[0]},test]']


def test_a_distribution_without_wheels_is_refused_by_name(set_up, tmp_path):
    done = set_up(DISTRO='humble')
    assert done.returncode == 1
    assert 'DISTRO=humble: there are wheels of jazzy kilted' in done.stderr
    assert not (tmp_path / 'venv').exists()


def test_another_distribution_than_the_sourced_one_is_refused(set_up, stand_in, tmp_path):
    stand_in('fake-python', FAKE_PYTHON.replace('-) exit 1', '-) exit 0'))
    done = set_up(ROS_DISTRO='jazzy', DISTRO='kilted')
    assert done.returncode == 1
    assert 'DISTRO=kilted, and the sourced ROS is jazzy' in done.stderr
    assert not (tmp_path / 'venv').exists()
    assert set_up('test', ROS_DISTRO='jazzy').returncode == 0
    assert installed(tmp_path) == ['.[test]']


def test_where_no_wheels_run_the_offline_half_is_installed_and_told(set_up, stand_in, tmp_path):
    stand_in('uname', 'echo Linux aarch64')
    done = set_up('test')
    assert done.returncode == 0, done.stderr
    told = (tmp_path / 'venv' / '.no-ros').read_text(encoding='utf-8')
    assert 'its wheels are for Linux on x86_64, not for Linux aarch64' in told
    assert installed(tmp_path) == ['.[test]']


def test_a_shim_of_an_absent_version_is_no_python(stand_in):
    found = ['bash', REPOSITORY / '.ci' / 'find-python']
    version = '{}.{}'.format(*sys.version_info)
    stand_in('id', 'echo 1000')
    stand_in('python3.9999', 'exit 127')
    assert subprocess.run([*found, '3.9999'], check=False).returncode == 1
    stand_in(f'python{version}', f'exec "{sys.executable}" "$@"')
    path = subprocess.run([*found, version], capture_output=True, text=True, check=True).stdout
    assert Path(path.strip()).name == f'python{version}'


@pytest.mark.parametrize(('told', 'command'), [(None, 'run'), ('No ROS 2 here.', 'simulate')])
def test_make_demo_simulates_where_there_is_no_ros_and_says_so(tmp_path, told, command):
    venv = tmp_path / 'venv'
    (venv / 'bin').mkdir(parents=True)
    (venv / 'bin' / 'piezo').write_text('#!/bin/sh\necho "piezo $1"\n', encoding='utf-8')
    (venv / 'bin' / 'piezo').chmod(0o755)
    (venv / '.stamp-demo-default-wheels').touch()
    if told:
        (venv / '.no-ros').write_text(f'{told}\n', encoding='utf-8')
    done = subprocess.run(
        ['make', '--silent', 'demo', f'VENV={venv}', 'DISTRO=', 'ROS_DISTRO='], cwd=REPOSITORY,
        capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [*filter(None, [told]), f'piezo {command}']
