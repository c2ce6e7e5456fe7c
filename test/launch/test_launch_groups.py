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
The launch files under the real `launch`, with stand-ins for the nodes that end when they are told.

What each process is started with, and which others end with it. Real nodes: test/live.
"""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from launch_files import LAUNCH_FILES
from python_path import python_path

ROOT = Path(__file__).parents[2]
PATIENCE_S = 30.0
NODES = ('compensator', 'controller', 'plant', 'trajectory')

# Ends with the code that it finds in $ENDS/<namespace>.<name>, or with 0 when it is told to.
STAND_IN = """\
#!{python} -S
import os, signal, sys, time
name = os.path.basename(sys.argv[0])
rig = next((word[6:].replace('/', '_') for word in sys.argv if word.startswith('__ns:=')), '')
path = os.path.join(os.environ['ENDS'], rig + '.' + name)
def end(how, code):
    print(rig, name, how, flush=True)
    os._exit(code)
for number in signal.SIGINT, signal.SIGTERM:
    signal.signal(number, lambda *_: end('stopped', 0))
print(rig, name, 'began', *sys.argv[1:], flush=True)
while not os.path.exists(path):
    time.sleep(0.01)
end('ended', int(open(path).read()))
"""

# As `ros2 launch` does it: the service has the arguments, and gives them to the file.
RUN = """\
import sys
from launch import LaunchService
from launch.launch_description_sources import get_launch_description_from_python_launch_file
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
service = LaunchService(argv=sys.argv[2:])
service.include_launch_description(LaunchDescription([IncludeLaunchDescription(
    sys.argv[1], launch_arguments=[word.split(':=', 1) for word in sys.argv[2:]])]))
sys.exit(service.run())
"""

HEAD = """\
from launch import LaunchDescription
from launch.actions import GroupAction, IncludeLaunchDescription, LogInfo
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import PushROSNamespace, SetRemap

def include(name, **arguments):
    return IncludeLaunchDescription(
        {folder!r} + '/' + name + '.launch.py', launch_arguments=arguments.items())

def generate_launch_description():
    return LaunchDescription([{entities}])
"""


class _Launch:
    """A launch that runs in a process group of its own, as one in a terminal does."""

    def __init__(self, folder, entities, arguments=(), file=None):
        pytest.importorskip('launch_ros')
        self._ends = folder / 'ends'
        self._said = folder / 'said.txt'
        prefix = folder / 'prefix'
        programs = prefix / 'lib' / 'piezo_ros'
        index = prefix / 'share' / 'ament_index' / 'resource_index' / 'packages'
        for path in self._ends, programs, index:
            path.mkdir(parents=True)
        (index / 'piezo_ros').touch()
        for name in ('recorder', 'loop', *NODES):
            (programs / name).write_text(STAND_IN.format(python=sys.executable))
            (programs / name).chmod(0o755)
        outer = folder / 'two_rigs.launch.py'
        outer.write_text(HEAD.format(folder=str(ROOT / 'launch'), entities=entities))
        with self._said.open('w') as output:
            self._process = subprocess.Popen(
                [sys.executable, '-c', RUN, str(file or outer), *arguments],
                stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT,
                start_new_session=True,
                env={
                    **os.environ, 'ENDS': str(self._ends), 'ROS_LOG_DIR': str(folder / 'log'),
                    'PYTHONPATH': python_path(ROOT),
                    'AMENT_PREFIX_PATH': f'{prefix}:{os.environ.get("AMENT_PREFIX_PATH", "")}'},
                # Tests started in the background inherit that SIGINT is ignored.
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))

    @property
    def said(self):
        return self._said.read_text()

    def says(self, rig, name, how):
        return f'{rig} {name} {how}' in self.said

    def words(self, rig, name):
        """Return the command line of a stand-in."""
        self.wait_for(f'{rig} {name} began')
        (line,) = (line for line in self.said.splitlines() if f'{rig} {name} began' in line)
        return line.partition(' began ')[2].split()

    def wait_for(self, *texts):
        deadline = time.monotonic() + PATIENCE_S
        while not all(text in self.said for text in texts):
            assert self._process.poll() is None, self.said
            assert time.monotonic() < deadline, f'waited in vain for {texts}:\n{self.said}'
            time.sleep(0.02)

    def end(self, rig, name, code):
        # In one piece: it is read as soon as it is there.
        (self._ends / 'new').write_text(str(code))
        (self._ends / 'new').rename(self._ends / f'{rig}.{name}')

    def ctrl_c(self):
        os.killpg(self._process.pid, signal.SIGINT)

    def wait(self, code=0):
        """Return what it has said, once it is over by itself."""
        try:
            assert self._process.wait(PATIENCE_S) == code, self.said
        except subprocess.TimeoutExpired:
            pytest.fail(f'the launch does not end:\n{self.said}')
        return self.said

    def destroy(self):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()


@pytest.fixture
def launched(tmp_path):
    """Launch some entities."""
    launches = []

    def start(entities, *arguments, file=None):
        launches.append(_Launch(tmp_path, entities, arguments, file))
        return launches[-1]

    try:
        yield start
    finally:
        for launch in launches:
            launch.destroy()


def two(**arguments):
    given = ''.join(f', {name}={value!r}' for name, value in arguments.items())
    return ', '.join(
        f"include('scan', namespace={name!r}, record='true'{given})" for name in ('one', 'two'))


def all_of(rig, how, names=('recorder', *NODES)):
    return [f'{rig} {name} {how}' for name in names]


def is_clean(said):
    return not any(word in said for word in ('ERROR', 'has died', 'Traceback'))


def test_an_included_rig_ends_alone_and_the_launch_with_the_last_one(launched):
    launch = launched(two())
    launch.wait_for(*all_of('_one', 'began'), *all_of('_two', 'began'))
    launch.end('_one', 'recorder', 0)
    launch.wait_for(
        '/one: recorder is done; ending the other nodes', *all_of('_one', 'stopped', NODES))
    assert '_two recorder stopped' not in launch.said
    launch.end('_two', 'recorder', 0)
    said = launch.wait()
    assert all(text in said for text in all_of('_two', 'stopped', NODES))
    assert '_two recorder ended' in said
    assert is_clean(said), said


@pytest.mark.parametrize('composed', ['false', 'true'])
def test_who_fails_takes_its_own_rig_along_and_the_log_says_so(launched, composed):
    launch = launched(two(composed=composed))
    nodes = ('loop',) if composed == 'true' else NODES
    for rig in ('_one', '_two'):
        launch.wait_for(*all_of(rig, 'began', ('recorder', *nodes)))
    launch.end('_one', nodes[-1], 3)
    launch.wait_for(
        f'[ERROR] [piezo_ros]: /one: {nodes[-1]} failed with exit code 3; ending the other nodes '
        'of this rig', *all_of('_one', 'stopped', ('recorder', *nodes[:-1])))
    assert '_two recorder stopped' not in launch.said
    # One that ends well without being the recorder ends no other.
    launch.end('_two', nodes[0], 0)
    launch.wait_for(f'_two {nodes[0]} ended')
    launch.end('_two', 'recorder', 0)
    said = launch.wait()
    assert said.count('[piezo_ros]: /one: ') == 1, said
    assert '/two: recorder is done' in said


def test_a_rig_ends_the_whole_launch_where_that_is_wanted(launched):
    launch = launched(two(ends='launch'))
    launch.wait_for(*all_of('_one', 'began'), *all_of('_two', 'began'))
    launch.end('_one', 'recorder', 0)
    said = launch.wait()
    assert '/one: recorder is done; ending the launch' in said
    assert all(text in said for text in all_of('_two', 'stopped'))
    assert is_clean(said), said


def test_ctrl_c_leaves_a_clean_log(launched):
    launch = launched(two())
    launch.wait_for(*all_of('_one', 'began'), *all_of('_two', 'began'))
    launch.ctrl_c()
    said = launch.wait()
    for rig in ('_one', '_two'):
        assert all(text in said for text in all_of(rig, 'stopped'))
    assert '[piezo_ros]: /' not in said.replace('in /', ''), said
    assert is_clean(said), said


def test_namespaces_and_names_of_an_enclosing_launch_file_hold(launched):
    launch = launched(
        "GroupAction([PushROSNamespace('lab'), SetRemap('plant:__node', 'stage'), "
        "SetRemap('displacement', 'position'), SetRemap('clock', 'lab_clock'), "
        "include('rig', namespace='one', publish_clock='true'), "
        "include('loop', namespace='/apart', publish_clock='true')]), "
        "PushROSNamespace('lab'), include('loop')")
    plant = launch.words('_lab_one', 'plant')
    for words in plant, launch.words('_apart', 'loop'):
        assert {'plant:__node:=stage', 'displacement:=position'} <= {*words}
        # Of several rules for a name the first one counts.
        assert words.index('clock:=lab_clock') < words.index('clock:=/clock')
    assert 'displacement:=position' in launch.words('_lab_one', 'controller')
    bare = launch.words('_lab', 'loop')
    assert not [word for word in bare if 'stage' in word or 'lab_clock' in word], bare


def test_what_is_not_given_is_by_default_in_a_group_and_nothing_of_ours_is_left_behind(launched):
    names = {argument.name for arguments in LAUNCH_FILES.values() for argument in arguments}
    told = ', '.join(f"'{name}=', LaunchConfiguration({name!r}, default='unset')" for name in names)
    launch = launched(
        "GroupAction([include('scan', namespace='one', periods='3', sample_period_s='2e-5')]), "
        f"GroupAction([include('scan', namespace='two')]), LogInfo(msg=[{told}])")
    for rig, periods, period_s in ('_one', '3.0', '2.0e-05'), ('_two', '15.0', '1.0e-05'):
        words = launch.words(rig, 'trajectory')
        assert f'periods:={periods}' in words
        assert f'sample_period_s:={period_s}' in words
    launch.wait_for(''.join(f'{name}=unset' for name in names))
    assert 'scan.launch.py in /one: ' in launch.said
    assert 'scan.launch.py in /two: namespace:=two\n' in launch.said


def test_a_copy_under_another_name_starts_what_its_own_folder_says(launched, tmp_path):
    for folder in 'launch', 'config':
        shutil.copytree(ROOT / folder, tmp_path / 'my_rig' / folder)
    copy = tmp_path / 'my_rig' / 'launch' / 'mine.launch.py'
    copy.write_text((ROOT / 'launch' / 'rig.launch.py').read_text().replace(
        "executable='plant'", "executable='plant', name='stage'"))
    launch = launched('', 'namespace:=mine', 'record:=true', file=copy)
    words = launch.words('_mine', 'plant')
    assert str(tmp_path / 'my_rig' / 'config' / 'rig.yaml') in words
    assert '__node:=stage' in words
    launch.end('_mine', 'recorder', 0)
    said = launch.wait()
    assert 'mine.launch.py in /mine: namespace:=mine, record:=true' in said
    assert is_clean(said), said


def test_a_misspelt_argument_of_the_launch_file_itself_starts_nothing(launched):
    path = ROOT / 'launch' / 'scan.launch.py'
    said = launched('', 'frequncy_hz:=500', file=path).wait(code=1)
    assert f'{path}: unknown argument frequncy_hz:=500; allowed are scheme, ' in said
    assert "did you mean 'frequency_hz'?" in said
    assert ' began' not in said


def test_a_misspelt_argument_of_an_include_is_told(launched):
    launch = launched(
        "GroupAction([include('scan', namespace='one', record='true', frequncy_hz='500')])")
    launch.wait_for(
        "scan.launch.py: frequncy_hz is no argument of it and changes nothing; did you mean "
        "'frequency_hz'?", *all_of('_one', 'began'))
    launch.end('_one', 'recorder', 0)
    assert is_clean(launch.wait())


def test_arguments_of_an_enclosing_launch_file_are_its_own(launched):
    launch = launched(
        "include('scan', namespace=LaunchConfiguration('rig_name'), record='true')",
        'rig_name:=one', 'frequncy_hz:=500')
    launch.wait_for(*all_of('_one', 'began'))
    launch.end('_one', 'recorder', 0)
    assert is_clean(launch.wait())
