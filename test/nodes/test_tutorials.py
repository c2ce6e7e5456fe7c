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

"""The tutorials of docs/, run as they stand: every block of commands, in one shell each."""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TUTORIALS = sorted((ROOT / 'docs' / 'tutorials').glob('*.md'))
PATIENCE_S = 240.0
_BLOCK = re.compile(r'^```sh ?(\w*)\n(.*?)^```$', re.MULTILINE | re.DOTALL)

# What the plain blocks need of ros2, which does just this.
STAND_IN = """\
#!/bin/sh
case "$1 $2 $3" in
'run piezo_ros '*) shift 3; exec {python} -m piezo_ros.nodes.executables "$executable" "$@";;
'pkg prefix --share') echo {root};;
*) echo "ros2 $* is not here" >&2; exit 1;;
esac
"""


def blocks(path, *kinds):
    """Return the commands of a tutorial: of plain blocks, and of those that need more of ros2."""
    return [
        commands for kind, commands in _BLOCK.findall(path.read_text(encoding='utf-8'))
        if kind in ('', *kinds)]


@pytest.fixture
def shell(tmp_path):
    """Run commands as a user would type them, in an empty folder and a domain of their own."""
    programs = tmp_path / 'programs'
    programs.mkdir()
    (programs / 'ros2').write_text(STAND_IN.format(python=sys.executable, root=ROOT).replace(
        'shift 3;', 'executable=$3; shift 3;'))
    (programs / 'piezo').write_text(
        f'#!/bin/sh\nexec {sys.executable} -m piezo_ros.cli.main "$@"\n')
    for program in programs.iterdir():
        program.chmod(0o755)
    folder = tmp_path / 'home'
    folder.mkdir()

    def run(commands, *, own_ros2=False):
        if own_ros2:
            (programs / 'ros2').unlink()
        said = tmp_path / 'said.txt'
        with said.open('w') as file:
            process = subprocess.Popen(
                ['bash', '-euo', 'pipefail', '-c', commands], cwd=folder, stdout=file,
                stderr=subprocess.STDOUT, start_new_session=True,
                env={
                    **os.environ, 'PATH': f'{programs}:{Path(sys.executable).parent}:'
                    f'{os.environ["PATH"]}',
                    'PYTHONPATH': f'{ROOT}:{os.environ.get("PYTHONPATH", "")}',
                    'docs': str(ROOT / 'docs'),
                    'ROS_DOMAIN_ID': str(1 + (os.getpid() + 53) % 101)})
        try:
            process.wait(PATIENCE_S)
        finally:
            # What it has put into the background goes too.
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
        output = said.read_text()
        assert process.returncode == 0, output
        return output, folder

    return run


def test_there_are_tutorials_and_each_has_commands():
    assert {path.stem for path in TUTORIALS} == {
        'by-hand', 'first-scan', 'your-own-controller', 'your-own-rig'}
    for path in TUTORIALS:
        assert len(blocks(path, 'launch', 'stock')) >= 3
        # No block may escape the tests by a kind that nobody knows.
        kinds = set(re.findall(r'^```(.+)$', path.read_text(encoding='utf-8'), re.MULTILINE))
        assert kinds <= {'sh', 'sh launch', 'sh stock'}


def test_the_first_scan(shell):
    (path,) = (path for path in TUTORIALS if path.stem == 'first-scan')
    output, folder = shell('\n'.join(blocks(path)))
    assert 'first_report/report.html' in output
    assert re.search(r'common samples 1600 from index 0', output)
    assert re.search(r'replayed +\d', output)
    assert (folder / 'first_scan' / 'metadata.yaml').is_file()


@pytest.mark.parametrize('name', ['your-own-controller', 'your-own-rig'])
def test_nodes_of_ones_own(shell, name):
    (path,) = (path for path in TUTORIALS if path.stem == name)
    output, folder = shell('\n'.join(blocks(path)))
    assert re.search(r'^\d+ checks, 0 wrong$', output, re.MULTILINE)
    assert (folder / 'my_report' / 'report.html').is_file()
    if name == 'your-own-rig':
        assert '3 runs, 0 beyond what the rig can do' in output


@pytest.mark.parametrize('path', TUTORIALS, ids=lambda path: path.stem)
def test_with_all_of_ros2(shell, path):
    if shutil.which('ros2') is None:
        pytest.skip('ros2 is not installed')
    if len(blocks(path, 'launch', 'stock')) > len(blocks(path)):
        shell('\n'.join(blocks(path, 'launch', 'stock')), own_ros2=True)
