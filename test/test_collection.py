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

"""
Whether the tests can be collected where other pytest plug-ins import them by bare name.

launch_testing's plug-in, which every ROS installation brings, does so with every test module,
whatever import mode is set here: two of one name stop the collection.
"""

import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent
# Imports each module as that plug-in does; the rest of the collection is left to pytest.
BARE_NAMES = """\
import inspect

from _pytest.pathlib import import_path


def pytest_pycollect_makemodule(module_path):
    newer = {'consider_namespace_packages': False}
    known = inspect.signature(import_path).parameters
    import_path(module_path, root=None, **{
        name: value for name, value in newer.items() if name in known})
"""


@pytest.fixture
def collect(tmp_path):
    """Collect the tests below a folder, every module imported by its bare name beforehand."""
    plugin = tmp_path / 'plugin'
    plugin.mkdir()
    (plugin / 'bare_names.py').write_text(BARE_NAMES, encoding='utf-8')
    program = (
        f'import sys; sys.path.insert(0, {str(plugin)!r}); import pytest; '
        'sys.exit(pytest.main(sys.argv[1:]))')

    def run(folder):
        return subprocess.run(
            [sys.executable, '-c', program, '-p', 'bare_names', '-p', 'no:cacheprovider', '-q',
             '-m', '', '--collect-only', '--import-mode=importlib', str(folder)],
            cwd=folder, capture_output=True, text=True, check=False)

    return run


def test_no_two_modules_of_the_tests_have_one_name():
    counts = Counter(path.stem for path in TESTS.rglob('*.py') if path.stem != 'conftest')
    assert not {name for name, count in counts.items() if count > 1}


def test_no_module_of_the_tests_hides_another():
    # The folder of each test module comes first on the path once it is imported by its bare name.
    names = {path.stem for path in TESTS.rglob('*.py')}
    others = {'benchmarks', 'piezo_ros', 'rclpy', 'launch', 'launch_ros'}
    hidden = names & (sys.stdlib_module_names | others)
    assert not hidden


@pytest.mark.slow  # Collects everything once more; the tests above hold the rules for every file.
def test_all_tests_are_collected_where_modules_are_imported_by_bare_name(collect):
    pytest.importorskip('rclpy', reason='tests of the nodes are collected where ROS is')
    collected = collect(TESTS)
    assert collected.returncode == 0, collected.stdout + collected.stderr
    assert not {
        path.name for path in TESTS.rglob('test_*.py') if f'{path.name}::' not in collected.stdout}


def test_two_modules_of_one_name_would_be_found(collect, tmp_path):
    for folder in ('one', 'other'):
        module = tmp_path / 'tests' / folder / 'test_same.py'
        module.parent.mkdir(parents=True)
        module.write_text('def test_it():\n    pass\n', encoding='utf-8')
    collected = collect(tmp_path / 'tests')
    assert collected.returncode != 0
    assert 'ImportPathMismatchError' in collected.stdout
