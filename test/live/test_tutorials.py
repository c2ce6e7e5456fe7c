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
The tutorials of docs/, run as they stand: every block of commands, in one shell each.

So is docs/hardware.md, on a virtual card.
"""

import contextlib
import os
import pty
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from processes import has_ni
from python_path import python_path

from piezo_ros.parameters.parameter_file import parameters_yaml, read_parameter_file

ROOT = Path(__file__).parents[2]
TUTORIALS = sorted((ROOT / 'docs' / 'tutorials').glob('*.md'))
PATIENCE_S = 900.0
# What blocks need beside the plain ones: `launch`, all of ros2, colcon, access to rosdep's lists.
KINDS = ('launch', 'stock', 'workspace', 'rosdep')
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

# What the blocks of a workspace need of it: what is found is what is sourced.
WORKSPACE_STAND_IN = """\
#!/bin/bash
prefix=$(IFS=:; for place in $AMENT_PREFIX_PATH; do
    [ -e "$place/share/ament_index/resource_index/packages/piezo_ros" ] && echo "$place" && break
done) || { echo "piezo_ros is not sourced" >&2; exit 1; }
case "$1 $2 $3" in
'run piezo_ros '*) executable=$3; shift 3; exec "$prefix/lib/piezo_ros/$executable" "$@";;
'pkg executables piezo_ros') ls "$prefix/lib/piezo_ros";;
'pkg prefix --share') echo "$prefix/share/piezo_ros";;
'pkg prefix piezo_ros') echo "$prefix";;
*) echo "ros2 $* is not here" >&2; exit 1;;
esac
"""


def blocks(path, *kinds):
    """Return the commands of a tutorial: of plain blocks, and of those that need more."""
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

    def run(
        commands, *, own_ros2=False, ros2=None, options='-euo', answers='', **environment,
    ):
        if own_ros2:
            (programs / 'ros2').unlink()
        if ros2 is not None:
            (programs / 'ros2').write_text(ros2)
        said = tmp_path / 'said.txt'
        ours, theirs = pty.openpty()  # questions are asked on a terminal only
        os.write(ours, answers.encode())
        with said.open('w') as file:
            process = subprocess.Popen(
                ['bash', options, 'pipefail', '-c', commands], cwd=folder, stdout=file,
                stdin=theirs, stderr=subprocess.STDOUT, start_new_session=True,
                env={
                    **os.environ, 'PATH': f'{programs}:{Path(sys.executable).parent}:'
                    f'{os.environ["PATH"]}',
                    'PYTHONPATH': python_path(ROOT),
                    'docs': str(ROOT / 'docs'),
                    'ROS_DOMAIN_ID': str(1 + (os.getpid() + 53) % 101), **environment})
        try:
            process.wait(PATIENCE_S)
        finally:
            # What it has put into the background goes too.
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            os.close(ours)
            os.close(theirs)
        output = said.read_text()
        assert process.returncode == 0, output
        return output, folder

    return run


def test_there_are_tutorials_and_each_has_commands():
    assert {path.stem for path in TUTORIALS} == {
        'by-hand', 'colcon-workspace', 'first-scan', 'your-own-controller', 'your-own-device',
        'your-own-rig'}
    for path in TUTORIALS:
        assert len(blocks(path, *KINDS)) >= 3
        # No block may escape the tests by a kind that is not known here.
        kinds = set(re.findall(r'^```(.+)$', path.read_text(encoding='utf-8'), re.MULTILINE))
        assert kinds <= {'sh', *(f'sh {kind}' for kind in KINDS)}


def test_the_first_scan(shell):
    (path,) = (path for path in TUTORIALS if path.stem == 'first-scan')
    output, folder = shell('\n'.join(blocks(path)))
    assert 'first_report/report.html' in output
    assert re.search(r'common samples 1600 from index 0', output)
    assert re.search(r'replayed +\d', output)
    assert (folder / 'first_scan' / 'metadata.yaml').is_file()


@pytest.mark.parametrize('name', [
    pytest.param(name, marks=pytest.mark.slow) for name in ('your-own-controller', 'your-own-rig')])
def test_nodes_of_ones_own(shell, name):
    (path,) = (path for path in TUTORIALS if path.stem == name)
    output, folder = shell('\n'.join(blocks(path)))
    assert re.search(r'^\d+ checks, 0 wrong$', output, re.MULTILINE)
    assert (folder / 'my_report' / 'report.html').is_file()
    if name == 'your-own-rig':
        assert '3 runs, 0 beyond what the rig can do' in output


@pytest.mark.slow
def test_a_device_of_ones_own(shell):
    (path,) = (path for path in TUTORIALS if path.stem == 'your-own-device')
    output, folder = shell('\n'.join(blocks(path)))
    assert re.search(r'^\d+ checks, 0 wrong$', output, re.MULTILINE)
    assert '1 runs, 0 beyond what the rig can do' in output
    assert (folder / 'my_output.f64').stat().st_size > 8 * 3000
    assert re.search(r'device +.*file', output, re.IGNORECASE), output


def hardware_page():
    """Return what docs/hardware.md shows: stage.yaml, the checks before, the flow."""
    page = (ROOT / 'docs' / 'hardware.md').read_text(encoding='utf-8')
    (stage,) = re.findall(r'^```\n(/\*\*/plant:.*?)^```$', page, re.MULTILINE | re.DOTALL)
    before, flow = (
        page.partition(f'## {title}')[2].partition('\n## ')[0]
        for title in ('Before the first drive', 'From the first command to the scan'))
    checks = [
        command for command in re.findall(r'`(piezo [^`]+)`', before) if '…' not in command]
    lines = re.findall(r'^    (.*)$', flow, re.MULTILINE)
    return stage, checks, lines


@pytest.fixture
def stage_on_a_card(rig, shell, tmp_path):
    """Write the files that docs/hardware.md takes as given; returns how to choose the card."""
    if not has_ni():
        pytest.skip('nidaqmx[grpc] is not installed')
    example = ROOT / 'config' / 'examples' / 'slow_stage'
    values = read_parameter_file(example / 'rig.yaml', ['plant'])['plant']
    # The dynamics of the example, with the travel of the page.
    smaller = 0.12
    values.update(
        travel_um=12.0, operating_point_um=6.0, voltage_minimum_v=-2.0, slew_limit_v_per_s=18000.0,
        sensor_scale_um_per_v=1.2, noise_rms_um=smaller * values['noise_rms_um'],
        kappa_um_per_v=[smaller * each for each in values['kappa_um_per_v']],
        dac_bits=0, adc_bits=0)
    folder = tmp_path / 'home'
    (folder / 'rig.yaml').write_text(parameters_yaml('/**', {'plant': values}))
    for name in ('identify', 'scan'):
        text = (example / f'{name}.yaml').read_text()
        (folder / f'{name}.yaml').write_text(text.replace('rig.yaml', 'stage.yaml').replace(
            '[fb, ff, fbff]', 'ff').replace('amplitude_um: 20.0', 'amplitude_um: 2.4').replace(
            '-50.0', '-6.0').replace('50.0}', '6.0}'))

    def use(stage, *options):
        _, address = rig.start_emulator(
            'daqmx.daqmx_server', '--rig', folder / 'rig.yaml', '--bits', 16, 18, *options)
        (folder / 'stage.yaml').write_text(
            stage.replace('    device: ni\n', f'    device: ni\n    address: {address}\n'))

    return use


@pytest.mark.slow
def test_the_commands_before_a_first_drive(shell, stage_on_a_card):
    stage, checks, _ = hardware_page()
    assert len(checks) >= 5
    stage_on_a_card(stage, '--wire')
    output, _ = shell('\n'.join(checks), answers=20 * 'y\n')
    assert re.search(r'^delay +1 samples$', output, re.MULTILINE)
    assert re.search(r'^\d+ checks, 0 wrong', output, re.MULTILINE)
    assert '2 runs, 0 beyond what the rig can do' in output


@pytest.mark.slow
@pytest.mark.timeout(1000)
def test_the_commands_from_the_first_drive_to_the_scan(shell, stage_on_a_card):
    stage, _, lines = hardware_page()
    assert len(lines) >= 7
    stage_on_a_card(stage)
    output, folder = shell('\n'.join(lines), answers=20 * 'y\n')
    assert output.count('Continue? [y/N]') == 2
    assert (folder / 'scan' / 'report.json').is_file()


@pytest.mark.slow  # test_packaging.py builds and tests a workspace every time.
def test_a_colcon_workspace(shell, tmp_path):
    colcon = shutil.which('colcon', path=f'{Path(sys.executable).parent}:{os.environ["PATH"]}')
    if colcon is None:
        pytest.skip('colcon is not installed')
    (path,) = (path for path in TUTORIALS if path.stem == 'colcon-workspace')
    sources = tmp_path / 'sources'
    shutil.copytree(ROOT, sources, ignore=shutil.ignore_patterns(
        '.*cache', '.git', '.hypothesis', '.venv*', '*.egg-info', '__pycache__', 'build',
        'install', 'log', 'out'))
    prefixes = filter(None, [sys.prefix, os.environ.get('AMENT_PREFIX_PATH')])
    output, folder = shell(
        # What colcon writes to be sourced reads variables that may not be set.
        '\n'.join(blocks(path, 'workspace')), options='-eo', ros2=WORKSPACE_STAND_IN,
        sources=str(sources), AMENT_PREFIX_PATH=os.pathsep.join(prefixes),
        COLCON_HOME=str(tmp_path / 'colcon'), PYTHONPATH=os.environ.get('PYTHONPATH', ''))
    assert '(ros.ament_python)' in output
    assert '3 runs, 0 beyond what the rig can do' in output
    assert re.search(r'common samples 5000 from index 0', output)
    assert re.search(r'Summary: [1-9]\d+ tests, 0 errors, 0 failures', output)
    assert (folder / 'ws' / 'demo' / 'report.html').is_file()


@pytest.mark.parametrize('path', TUTORIALS, ids=lambda path: path.stem)
def test_with_all_of_ros2(shell, path):
    if shutil.which('ros2') is None:
        pytest.skip('ros2 is not installed')
    if len(blocks(path, 'launch', 'stock')) > len(blocks(path)):
        shell('\n'.join(blocks(path, 'launch', 'stock')), own_ros2=True)
