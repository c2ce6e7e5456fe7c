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

"""What every command has in common: help, usage errors, and a start that imports only its own."""

import subprocess
import sys

import pytest

from piezo_ros.cli.main import main
from piezo_ros.cli.shared.command_line import COMMANDS

# Prints what of the large libraries the help has imported.
HELP = """\
import sys
from piezo_ros.cli.main import main
try:
    main(['--help'])
finally:
    large = {'control', 'matplotlib', 'mcap', 'numba', 'numpy', 'rclpy', 'scipy', 'yaml'}
    print('imported:', *large & sys.modules.keys(), file=sys.stderr)
"""


def test_help_names_every_command(capsys):
    with pytest.raises(SystemExit, match='^0$'):
        main(['--help'])
    words = capsys.readouterr().out.split()
    assert {*COMMANDS} <= {*words}


@pytest.mark.parametrize('command', COMMANDS)
def test_every_command_has_its_own_help(capsys, command):
    with pytest.raises(SystemExit, match='^0$'):
        main([command, '--help'])
    text = capsys.readouterr().out
    assert text.startswith(f'usage: piezo {command} [-h] ')
    assert 'example' in text


@pytest.mark.parametrize('words', [[], ['nonsense'], ['run'], ['-x', 'bag', 'info', 'a_bag']])
def test_a_usage_error_is_exit_2(capsys, words):
    with pytest.raises(SystemExit, match='^2$'):
        main(words)
    assert 'usage: piezo' in capsys.readouterr().err


def test_help_imports_no_command():
    done = subprocess.run(
        [sys.executable, '-c', HELP], capture_output=True, text=True, check=True)
    assert done.stderr.split() == ['imported:']


# Sends itself SIGINT where Python can but drop the exception: in what an import does at its end.
INTERRUPTED = """\
import os, runpy, signal, sys

def interrupt(frame, event, argument):
    global first
    code = frame.f_code
    if first and event == 'call' and code.co_name == 'cb' and 'importlib' in code.co_filename and (
            'piezo_ros.cli.shared.command_line' in sys.modules):
        first = False
        os.kill(os.getpid(), signal.SIGINT)

first = True
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.argv[1:] = ['run', '--help']
sys.setprofile(interrupt)
runpy.run_module('piezo_ros.cli.main', run_name='__main__')
"""


def test_ctrl_c_is_not_lost_while_the_command_is_imported():
    done = subprocess.run(
        [sys.executable, '-c', INTERRUPTED], capture_output=True, text=True, check=False)
    assert 'Exception ignored' in done.stderr
    assert done.stderr.endswith('piezo: stopped by SIGINT\n')
    assert done.returncode == 1
    assert not done.stdout
