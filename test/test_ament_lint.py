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

"""The linters of ROS, where they are installed, as CONTRIBUTING.md says to call them."""

import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
SOURCES = ('piezo_ros', 'benchmarks', 'launch', 'test', 'docs', 'setup.py')


def check_with(linter, *arguments):
    pytest.importorskip(linter)
    done = subprocess.run(
        [sys.executable, '-c', f'import sys; from {linter}.main import main; sys.exit(main())',
         *arguments],
        cwd=REPOSITORY, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.fail(done.stdout + done.stderr, pytrace=False)


def test_every_file_has_a_notice_and_the_licence_is_one_that_is_known():
    check_with('ament_copyright', *SOURCES)


def test_flake8_finds_nothing_by_our_settings():
    check_with('ament_flake8', '--config', '.flake8', *SOURCES)


def test_docstrings_are_those_of_pep_257():
    check_with('ament_pep257', '--add-ignore', 'D401', '--', *SOURCES)


def test_docstrings_of_the_package_are_those_of_numpy():
    check_with(
        'ament_pep257', '--convention', 'numpy', '--add-ignore', 'D104', 'D105', 'D401', '--',
        'piezo_ros')
