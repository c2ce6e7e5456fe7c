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

"""Style, types and the direction of imports, each by the tool that `make lint` calls."""

import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
# Not strict, and without the types of other packages, which cost most of the time.
OLDEST_PYTHON = """\
[mypy]
files = piezo_ros, benchmarks
python_version = 3.10
cache_dir = .mypy_cache/oldest
ignore_missing_imports = true
[mypy-control.*,matplotlib.*,mpl_toolkits.*,numba.*,numpy.*,pyarrow.*,rclpy.*,scipy.*]
follow_imports = skip
follow_imports_for_stubs = true
"""


def run(tool, *arguments):
    executable = Path(sys.executable).with_name(tool)
    if not executable.exists():
        pytest.skip(f'{tool} is not installed beside {sys.executable}')
    return subprocess.run(
        [executable, *arguments], cwd=REPOSITORY, capture_output=True, text=True, check=False)


def check_with(tool, *arguments):
    done = run(tool, *arguments)
    if done.returncode:
        pytest.fail(done.stdout + done.stderr, pytrace=False)


def test_the_style_is_that_of_the_project():
    check_with('ruff', 'check', '--output-format=concise')


@pytest.mark.timeout(1200)  # half a minute of one processor, of which others may want most
def test_the_types_hold():
    try:
        stubs = metadata.version('scipy-stubs')
    except metadata.PackageNotFoundError:
        stubs = '0.0'
    if [*map(int, stubs.split('.')[:2])] < [1, 17]:
        # 1.15, the last that Python 3.10 gets, refuses calls that SciPy takes.
        pytest.skip(f'the types are held against scipy-stubs 1.17 and later, not {stubs}')
    check_with('mypy')


def newer_names(tmp_path, *paths):
    """Return what mypy tells of names that the oldest Python's standard library lacks."""
    configuration = tmp_path / 'mypy.ini'
    configuration.write_text(OLDEST_PYTHON, encoding='utf-8')
    done = run('mypy', '--config-file', configuration, *paths)
    assert 'checked' in done.stdout, done.stdout + done.stderr
    return [
        line for line in done.stdout.splitlines() if re.search(r'Module.* no attribute', line)]


@pytest.mark.timeout(1200)
def test_nothing_newer_than_the_oldest_python_is_used(tmp_path):
    # New syntax is refused by ruff, new names of the standard library only by mypy.
    newer = newer_names(tmp_path)
    assert not newer, '\n'.join(newer)


def test_a_name_that_is_newer_would_be_found(tmp_path):
    module = tmp_path / 'newer.py'
    module.write_text('import enum\nfrom datetime import UTC\n\nnew = enum.StrEnum, UTC\n')
    assert len(newer_names(tmp_path, module)) == 2


def test_imports_point_downwards_and_ros_stays_at_the_top():
    check_with('lint-imports')
