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

"""Real processes on real middleware: started, watched, and ended whatever happens to the test."""

import contextlib
import importlib.util
import itertools
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml
from launch_files import started_by
from python_path import python_path

from piezo_ros.bag import STREAMS, BagError, read
from piezo_ros.runtime.process.running_time import RunningTime

ROOT = Path(__file__).parents[2]
# Python's own words where it is interrupted before it runs a line of the module that it was given.
CUT_OFF = ('Fatal Python error: init_', 'Could not import runpy module')
# Imports of the first module alone: those behind them find a handler of the signal.
FIRST_IMPORTS = re.compile(r'(executables|cli/main)\.py", line \d+, in <module>')
PATIENCE_S = 90.0
_numbers = itertools.count()


def has_ni():
    """Return whether the client of device servers is installed."""
    try:
        return importlib.util.find_spec('nidaqmx._stubs') is not None and (
            importlib.util.find_spec('grpc') is not None)
    except ModuleNotFoundError:
        return False


def wait_until(condition, what, timeout_s=PATIENCE_S):
    """Return the first true value of a condition; a busy machine gets more time."""
    waited = RunningTime()
    while not (value := condition()):
        assert waited.elapsed_s() < timeout_s, f'waited in vain for {what}'
        time.sleep(0.01)
    return value


def was_cut_off_while_starting(output):
    """
    Return whether a process got a signal while Python itself or its first modules came up.

    Then no line of a node has run that could take it, and Python's own words are all there is.
    """
    return (
        any(words in output for words in CUT_OFF)
        or (bool(FIRST_IMPORTS.search(output)) and output.rstrip().endswith('KeyboardInterrupt')))


@contextlib.contextmanager
def busy_processes(number):
    """Have so many processes beside that take all the time that they get."""
    burners = [
        subprocess.Popen([sys.executable, '-c', 'while True: pass']) for _ in range(number)]
    try:
        yield
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


def _heed_signals():
    # Tests inherit that SIGINT is ignored in the background, and SIGHUP below nohup.
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def _begin_a_group():
    _heed_signals()
    # No session: Linux divides the processor among these first, and nodes yield in vain.
    os.setpgid(0, 0)


def _begin_a_session():
    _heed_signals()
    os.setsid()


class Process:
    """A process in a group of its own, its output in a file; in a session as a terminal has."""

    def __init__(self, arguments, output, environment, terminal=False):
        self._output = output
        with output.open('wb') as file:
            self._popen = subprocess.Popen(
                [sys.executable, *arguments], stdin=subprocess.DEVNULL, stdout=file,
                stderr=subprocess.STDOUT, env=environment,
                preexec_fn=_begin_a_session if terminal else _begin_a_group)
        self.pid = self._popen.pid

    @property
    def output(self):
        """What it has written so far, to either stream."""
        return self._output.read_text(errors='replace')

    @property
    def exit_code(self):
        return self._popen.poll()

    def send(self, number):
        self._popen.send_signal(number)

    def wait(self, timeout_s=PATIENCE_S):
        """Return the exit code; a process that does not end is the test's failure."""
        waited = RunningTime()
        while waited.elapsed_s() < timeout_s:
            with contextlib.suppress(subprocess.TimeoutExpired):
                code = self._popen.wait(0.1)
                if code < 0:  # what the crash report says, should the test fail
                    print(f'process {self.pid} died of signal {-code}:\n{self.output}')
                return code
        return pytest.fail(f'process {self.pid} does not end; it wrote:\n{self.output}')

    def wait_for(self, text):
        """Wait until it has written a text."""
        wait_until(
            lambda: text in self.output or self.exit_code is not None, f'{text!r}')
        assert text in self.output, self.output

    def destroy(self):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        self._popen.wait()


class Rig:
    """One rig: a namespace and a domain of its own, and the processes started in them."""

    def __init__(self, directory):
        number = os.getpid() + 37 * next(_numbers)
        self.directory = directory
        self.namespace = f'/test_{os.getpid()}_{next(_numbers)}'
        self.domain = 1 + number % 101
        self.environment = {
            **os.environ, 'PYTHONPATH': python_path(ROOT), 'ROS_DOMAIN_ID': str(self.domain),
            'PYTHONUNBUFFERED': '1'}
        self._processes = []

    def measure(self):
        """Let its processes count the lines that they run, where the tests are measured."""
        if 'coverage' in sys.modules and sys.modules['coverage'].Coverage.current():
            self.environment.update(
                COVERAGE_PROCESS_START=str(ROOT / 'pyproject.toml'), COVERAGE_PATCH='subprocess',
                COVERAGE_FILE=str(ROOT / '.coverage'))

    @property
    def bag(self):
        """Where the first run of a plan under fbff goes."""
        return self.directory / 'out' / 'bags' / '000_fbff_triangle_1um_300hz'

    def piezo(self, *arguments):
        """Start the command; ``run`` gets the namespace of this rig."""
        if arguments[0] == 'run' and '--default-namespace' not in arguments:
            arguments = (*arguments, '--namespace', self.namespace)
        arguments = [str(word) for word in arguments if word != '--default-namespace']
        return self._start('piezo_ros.cli.main', *arguments)

    def node(self, name, **parameters):
        """Start one node."""
        words = [
            word for key, value in parameters.items() for word in ('-p', f'{key}:={value}')]
        return self.start_node(name, *words)

    def start_node(self, name, *arguments, terminal=False):
        """Start one node with some arguments for ROS, in a session of its own if asked to."""
        return self._spawn(
            ['-m', 'piezo_ros.nodes.executables', name, '--ros-args',
             '-r', f'__ns:={self.namespace}', *arguments], terminal)

    def start_process(self, executable, *words):
        """Start one node executable with its whole command line."""
        return self._start('piezo_ros.nodes.executables', executable, *words)

    def start_emulator(self, module, *words):
        """Start an emulator of a device; return its process and the address that it prints."""
        self.environment['PYTHONPATH'] = str(ROOT / 'test' / 'emulators') + os.pathsep + (
            self.environment['PYTHONPATH'])
        process = self._start(module, *map(str, words))
        process.wait_for('\n')
        return process, process.output.strip().splitlines()[-1]

    def start_file(self, path, *words):
        """Start a Python file, as a foreign node is."""
        return self._spawn([str(path), *words])

    def _start(self, *arguments):
        return self._spawn(['-m', *arguments])

    def _spawn(self, arguments, terminal=False):
        output = self.directory / f'output_{len(self._processes)}.txt'
        process = Process(arguments, output, self.environment, terminal)
        self._processes.append(process)
        return process

    def nodes(self, *names):
        """Return the process number of every living node of this rig, or of those named."""
        found = {}
        for entry in Path('/proc').iterdir():
            try:
                words = (entry / 'cmdline').read_bytes().decode().split('\0')
            except (OSError, UnicodeDecodeError):
                continue
            # The command line of a zombie is empty.
            if entry.name.isdigit() and f'__ns:={self.namespace}' in words:
                name = words[words.index('--ros-args') - 1]
                if not names or name in names:
                    found[name] = int(entry.name)
        return found

    def destroy(self):
        """End its processes; those of a rig that is destroyed already are not looked at again."""
        processes, self._processes = self._processes, []
        for process in processes:
            process.destroy()
            # Pytest shows it where the test failed: the cause is often in another process.
            print(f'process {process.pid} ended with {process.exit_code}; it wrote:')
            print(process.output[-4000:] or '(nothing)')
        for number in self.nodes().values():
            os.kill(number, signal.SIGKILL)


def _rigs(make_directory):
    rigs = []

    def make():
        rigs.append(Rig(make_directory()))
        return rigs[-1]

    try:
        yield make
    finally:
        for rig in rigs:
            rig.destroy()


@pytest.fixture
def rig(tmp_path):
    """One rig; its processes end with the test."""
    yield from (make() for make in _rigs(lambda: tmp_path))


@pytest.fixture
def launched(rig):
    """Start what scan.launch.py would."""
    def start(**given):
        return {
            process.executable: rig.start_process(
                process.executable, *process.command_line)
            for process in started_by('scan.launch.py', **given)}

    return start


@pytest.fixture(scope='module')
def make_rig(tmp_path_factory):
    """Make rigs; their processes end with the module."""
    yield from _rigs(lambda: tmp_path_factory.mktemp('rig'))


@pytest.fixture(scope='session')
def write_plan(tmp_path_factory):
    """Write a plan of one waveform under some schemes, on the simulated rig of config/."""
    def write(*schemes, periods=3, watchdog_s=60.0):
        path = tmp_path_factory.mktemp('plan') / 'plan.yaml'
        path.write_text(yaml.safe_dump({
            'format_version': 1,
            'parameter_files': [
                str(ROOT / 'config' / f'{name}.yaml')
                for name in ('rig', 'compensator', 'controller', 'trajectory')],
            'score_periods': 1,
            # Busy machines keep processes waiting for seconds.
            'runs': [{'scheme': list(schemes), 'periods': periods,
                      'plant': {'watchdog_s': watchdog_s}}],
        }))
        return path

    return write


@pytest.fixture
def start_long(rig, write_plan):
    """
    Start a run that takes minutes; return its command once samples of the loop are on the disk.

    A chunk of them is whole: of one that is being written nothing is read after a kill.
    """
    def start(processes, watchdog_s=60.0):
        # 100 000 loops, and where they are quick ten million.
        periods = 300 if processes == '--separate' else 30_000
        plan = write_plan('fbff', periods=periods, watchdog_s=watchdog_s)
        command = rig.piezo('run', plan, '-o', rig.directory / 'out', processes)
        wait_until(
            lambda: command.exit_code is not None or any(
                _holds_samples(file) for file in rig.bag.glob('*.mcap')),
            'the first samples on the disk')
        assert command.exit_code is None, command.output
        return command

    return start


def _holds_samples(file):
    """Return whether every stream has samples in a file that is being written."""
    try:
        run = read(file, allow_loss=True)
    except BagError:
        return False
    return run.streams == tuple(STREAMS) and run.displacement_um.size > 10


@pytest.fixture(scope='session')
def assert_whole():
    """Assert that every stream of a run begins at 0; `read` has refused gaps."""
    def check(run):
        assert run.streams == tuple(STREAMS)
        for stream in run.streams:
            start, samples = run.whole(stream)
            assert start == 0
            assert samples.size > 10

    return check


@pytest.fixture(scope='session')
def until():
    return wait_until


@pytest.fixture
def make_peer(until):
    """Make peers that end with the test."""
    from foreign_peer import Peer

    peers = []

    def make(rig):
        peers.append(Peer(rig, until))
        return peers[-1]

    yield make
    for peer in peers:
        peer.destroy()


@pytest.fixture
def peer(rig, make_peer):
    return make_peer(rig)


@pytest.fixture
def transport():
    """Topics in memory."""
    from fake_transport import FakeTransport

    return FakeTransport()


@pytest.fixture
def owner(transport):
    """A node, as its streams see it, on these topics."""
    return transport.owner()


@pytest.fixture
def block():
    from foreign_peer import typed_block

    return typed_block
