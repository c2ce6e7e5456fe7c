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

"""The offline half where nothing of Linux is to be had, as on other systems."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from python_path import python_path
from short_plan import SHORT_PLAN

REPOSITORY = Path(__file__).resolve().parents[2]
# Without what Python has on Linux alone, without timers by signal, limits and /proc.
ELSEWHERE = """\
import builtins, ctypes, io, os, signal, sys

for module, names in {
        os: ('sched_getaffinity', 'sched_setaffinity', 'sched_setscheduler', 'sched_getparam',
             'eventfd', 'memfd_create', 'pidfd_open', 'posix_fadvise', 'posix_fallocate', 'splice',
             'copy_file_range', 'getxattr', 'setxattr', 'O_TMPFILE', 'O_PATH'),
        signal: ('SIGALRM', 'alarm', 'setitimer', 'SIGRTMIN', 'SIGPWR', 'sigwaitinfo',
                 'sigtimedwait', 'pidfd_send_signal')}.items():
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
for module in 'resource', 'termios', 'fcntl', 'pwd', 'grp', 'pty', 'tty':
    sys.modules[module] = None

def is_of_kernel(path):
    return isinstance(path, (str, bytes, os.PathLike)) and os.fsdecode(path).startswith(
        ('/proc', '/sys/', '/dev/shm'))

def without_kernel(function):
    def call(path, *arguments, **options):
        if is_of_kernel(path):
            raise FileNotFoundError(2, 'No such file or directory', os.fsdecode(path))
        return function(path, *arguments, **options)
    return call

for module, name in (
        (builtins, 'open'), (io, 'open'), (os, 'open'), (os, 'stat'), (os, 'listdir'),
        (os, 'readlink'), (os, 'scandir')):
    setattr(module, name, without_kernel(getattr(module, name)))

# Until Python 3.10 pathlib keeps functions of its own.
import pathlib
for name in ('open', 'stat', 'listdir', 'readlink', 'scandir'):
    accessor = getattr(pathlib, '_NormalAccessor', None)
    if hasattr(accessor, name):
        setattr(accessor, name, staticmethod(without_kernel(getattr(accessor, name))))

class OtherLibrary(ctypes.CDLL):
    def __getattr__(self, name):
        if name in ('prctl', 'eventfd', 'sched_setaffinity', 'malloc_trim', 'syscall'):
            raise AttributeError(f'function {name!r} not found')
        return super().__getattr__(name)

ctypes.CDLL = OtherLibrary
"""
COMMAND = 'from piezo_ros.cli.main import main; sys.exit(main())'


@pytest.fixture
def python(tmp_path):
    def run(program, *arguments):
        return subprocess.run(
            [sys.executable, '-c', ELSEWHERE + program, *map(str, arguments)], cwd=tmp_path,
            env={**os.environ, 'PYTHONPATH': python_path(REPOSITORY)}, check=False,
            capture_output=True, text=True)
    return run


@pytest.mark.parametrize('program', [
    'import resource', 'import termios', 'os.sched_getaffinity(0)',
    'signal.setitimer(signal.ITIMER_REAL, 1.0)',
    "open('/proc/self/status')", "import pathlib; pathlib.Path('/proc/meminfo').read_text()",
    "os.listdir('/sys/devices')", 'ctypes.CDLL(None).prctl(1, 2)'])
def test_the_blocker_blocks(python, program):
    done = python(program)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith(
        ('ModuleNotFoundError', 'AttributeError', 'FileNotFoundError'))


@pytest.mark.slow
def test_simulation_identification_tuning_and_report_need_nothing_of_linux(
        python, models, tmp_path):
    (tmp_path / 'plan.yaml').write_text(SHORT_PLAN)

    def piezo(*arguments):
        done = python(COMMAND, *arguments)
        assert done.returncode == 0, done.stderr
        return done.stdout

    piezo('simulate', 'plan.yaml', '-o', 'out')
    triangle, scan = sorted((tmp_path / 'out' / 'bags').iterdir())
    piezo('identify', 'hysteresis', triangle, '--elements', 4, '--every', 20, '--accept-poor',
          '-o', 'found.yaml')
    piezo('tune', 'trajectory.yaml', '--no-operating-points', '-o', 'tuned.yaml')
    piezo('report', scan, '-o', 'report')
    assert 'recorded ' in piezo('bag', 'info', scan)
    for page in 'report', 'out':
        assert (tmp_path / page / 'report.html').stat().st_size > 0
    for model in 'found.yaml', 'tuned.yaml':
        assert (tmp_path / model).stat().st_size > 0
