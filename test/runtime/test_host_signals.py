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

import subprocess
import sys

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


def test_an_interruption_that_is_repeated_does_not_kill_a_process_on_its_way_out():
    process = subprocess.run(
        [sys.executable, '-c', _INTERRUPTED_WHILE_STARTING], check=False, timeout=60)
    assert process.returncode == 0
