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

"""package.xml and CHANGELOG.rst as the tools of ROS read them."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
TESTS = REPOSITORY / 'test'

# Name in an import statement -> rosdep key, where they differ.
KEYS = {
    'ament_copyright': 'ament_copyright',
    'ament_flake8': 'ament_flake8',
    'ament_pep257': 'ament_pep257',
    'catkin_pkg': 'python3-catkin-pkg-modules',
    'control': 'python-control-pip',
    'hypothesis': 'python3-hypothesis',
    'jinja2': 'python3-jinja2',
    'lz4': 'mcap-ros2-support',
    'markupsafe': 'python3-jinja2',
    'matplotlib': 'python3-matplotlib',
    'mcap': 'mcap-ros2-support',
    'mcap_ros2': 'mcap-ros2-support',
    'numba': 'python3-numba',
    'numpy': 'python3-numpy',
    'pytest': 'python3-pytest',
    'rosbags': 'python3-rosbags-pip',
    'scipy': 'python3-scipy',
    'setuptools': 'python3-setuptools',
    'yaml': 'python3-yaml',
    'zstandard': 'mcap-ros2-support',
}


@pytest.fixture(scope='module')
def package():
    """Return the manifest as colcon and bloom have it; a warning is an error here."""
    parser = pytest.importorskip('catkin_pkg.package')
    warnings = []
    manifest = parser.parse_package(str(REPOSITORY), warnings=warnings)
    manifest.validate(warnings=warnings)
    assert not warnings
    return manifest


def imported_by_tests():
    """Return what the tests import in any case: not below an if, nor within a function."""
    names = set()
    # The emulators are imported within the tests that have the libraries of the vendors.
    for path in set(TESTS.rglob('*.py')) - set((TESTS / 'emulators').rglob('*.py')):
        for statement in ast.parse(path.read_text(encoding='utf-8')).body:
            if isinstance(statement, ast.Import):
                names |= {alias.name.split('.')[0] for alias in statement.names}
            elif isinstance(statement, ast.ImportFrom) and not statement.level:
                names.add(statement.module.split('.')[0])
    own = {path.stem for path in (TESTS / 'support').glob('*.py')}
    return names - own - sys.stdlib_module_names - {'_pytest', 'benchmarks', 'piezo_ros'}


def test_the_manifest_is_valid_and_builds_with_ament_python(package):
    assert package.get_build_type() == 'ament_python'
    assert package.package_format == 3


def test_the_manifest_names_what_the_tests_import(package):
    named = {
        dependency.name for dependency in [*package.exec_depends, *package.test_depends]}
    assert {KEYS.get(name, name) for name in imported_by_tests()} <= named


def test_nothing_is_named_twice_or_for_no_use(package):
    named = [
        dependency.name for dependency in [*package.exec_depends, *package.test_depends]]
    assert len(named) == len(set(named))
    # The plug-in keeps the promise of `timeout` in pyproject.toml, the linters are called by name.
    used = {KEYS.get(name, name) for name in imported_by_tests()} | {
        'python3-pytest-timeout', *(name for name in KEYS if name.startswith('ament_')),
        KEYS['catkin_pkg']}
    assert {dependency.name for dependency in package.test_depends} <= used


def test_the_changelog_is_one_of_catkin_once_what_is_to_come_has_a_version(package):
    read = pytest.importorskip('catkin_pkg.changelog')
    text = (REPOSITORY / 'CHANGELOG.rst').read_text(encoding='utf-8')
    # What catkin_prepare_release makes of the heading; before, catkin_pkg passes over the section.
    coming = '99.0.0 (2026-01-31)'
    heading = f'\n{coming}\n{"-" * len(coming)}\n'
    released, count = re.subn(r'\nForthcoming\n-+\n', heading, text)
    assert count == 1
    changelog = read.Changelog(package.name)
    read.populate_changelog_from_rst(changelog, released)
    sections = {version: content for version, _, content in changelog.foreach_version()}
    (entries,) = sections.pop('99.0.0')
    assert len(entries.bullets) > 3
    as_numbers = {tuple(map(int, version.split('.'))) for version in sections}
    assert all(number <= tuple(map(int, package.version.split('.'))) for number in as_numbers)


def test_the_changelog_reads_as_text_without_a_markup_error():
    docutils = pytest.importorskip('docutils.core')
    with (REPOSITORY / 'CHANGELOG.rst').open(encoding='utf-8') as file:
        text = file.read()
    docutils.publish_doctree(text, settings_overrides={'halt_level': 2, 'report_level': 2})
    # One backtick is no code in reStructuredText.
    assert not re.search(r'(?<!`)`(?!`)', text)


def test_catkin_generates_on_from_the_changelog_as_it_is(tmp_path):
    pytest.importorskip('catkin_pkg.changelog_generator')
    work = tmp_path / 'piezo_ros'
    work.mkdir()
    for name in ('package.xml', 'CHANGELOG.rst', 'LICENSE'):
        (work / name).write_bytes((REPOSITORY / name).read_bytes())

    def run(*words):
        return subprocess.run(words, cwd=work, capture_output=True, text=True, check=True).stdout

    run('git', 'init', '--quiet')
    git = ('git', '-c', 'user.name=one', '-c', 'user.email=one@example.com')
    run(*git, 'add', '.')
    run(*git, 'commit', '--quiet', '-m', 'The first one')
    run('git', 'tag', '0.0.1')
    (work / 'README.md').touch()
    run(*git, 'add', '.')
    run(*git, 'commit', '--quiet', '-m', 'A commit that has to be told')
    run(sys.executable, '-c', 'from catkin_pkg.cli.generate_changelog import main; main()')
    text = (work / 'CHANGELOG.rst').read_text(encoding='utf-8')
    assert '* A commit that has to be told' in text
    assert text.count('\nForthcoming\n---') == 1
    assert 'The published numbers of the paper' in text
