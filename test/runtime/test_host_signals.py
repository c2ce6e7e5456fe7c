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

"""What the signals of a node's process leave behind."""

import signal
import subprocess
import sys

import pytest

from piezo_ros.runtime import host
from piezo_ros.runtime.process import running_time
from piezo_ros.runtime.process.running_time import RunningTime
from piezo_ros.runtime.process.stop_request import StopRequest

# Python gives a signal without a handler of its own back its default while it ends: to kill.
_INTERRUPTED_WHILE_STARTING = """
import os, signal, time, types
from piezo_ros.runtime import host
host._RAISE_AGAIN_S = 0.02
stop = host._NodeStop()
stop.listen()
stop.nodes = [types.SimpleNamespace(is_starting=True)]
try:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(5.0)
except host._StartInterrupted:
    stop.raise_no_more()
stop.nodes = []
if signal.getsignal(signal.SIGALRM) is not signal.SIG_IGN:
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
time.sleep(0.1)
"""

# Sends itself SIGINT where Python can but drop an exception: in what an import does at its end.
_INTERRUPTED_IMPORT = """
import os, runpy, signal, sys

def interrupt(frame, event, argument):
    code = frame.f_code
    if event == 'call' and code.co_name == 'cb' and 'importlib' in code.co_filename and (
            'piezo_ros.nodes.usage' in sys.modules):
        sys.setprofile(None)
        os.kill(os.getpid(), signal.SIGINT)

sys.argv[1:] = ['compensator', '--ros-args', '-p', 'handshake_timeout_s:=1.0']
sys.setprofile(interrupt)
runpy.run_module('piezo_ros.nodes.executables', run_name='__main__')
"""


def test_ctrl_c_is_not_lost_while_a_node_is_imported():
    process = subprocess.run(
        [sys.executable, '-c', _INTERRUPTED_IMPORT], capture_output=True, text=True, check=False,
        timeout=60)
    assert process.stderr == 'ended by SIGINT while it started\n'
    assert process.returncode == 0


def test_an_interruption_that_is_repeated_does_not_kill_a_process_on_its_way_out():
    process = subprocess.run(
        [sys.executable, '-c', _INTERRUPTED_WHILE_STARTING], check=False, timeout=60)
    assert process.returncode == 0


@pytest.mark.parametrize(('signals', 'failed', 'busy', 'longest_s'), [
    ([], False, 1.0, 20.0),
    ([], True, 1.0, 4.0),
    ([], True, 8.0, 32.0),
    ([signal.SIGINT], False, 1.0, 4.0),
    # The supervisor or a launch file counts by the wall clock.
    ([signal.SIGINT], False, 8.0, 6.0),
    ([signal.SIGINT, signal.SIGINT], False, 8.0, 6.0),
    ([signal.SIGINT, signal.SIGTERM], False, 1.0, 0.0),
    ([signal.SIGTERM, signal.SIGHUP], False, 8.0, 0.0),
    ([signal.SIGINT, signal.SIGTERM, signal.SIGINT], False, 1.0, 0.0),
    # While a node starts, an alarm repeats the signal that came.
    ([signal.SIGTERM, signal.SIGTERM], False, 1.0, 4.0),
])
def test_dead_readers_hold_up_the_end_no_longer_than_it_has(
    signals, failed, busy, longest_s, monkeypatch,
):
    now_s = [100.0]
    monkeypatch.setattr(running_time.time, 'monotonic', lambda: now_s[0])
    monkeypatch.setattr(running_time, 'crowding', lambda: busy)
    stop, waited = StopRequest(), RunningTime()
    for number in signals:
        stop(number, None)
    while host._has_time(waited, stop, failed=failed):
        now_s[0] += 0.125
    assert now_s[0] - 100.0 == pytest.approx(longest_s, abs=0.2)
