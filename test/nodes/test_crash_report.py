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

"""A process that dies of a signal leaves the stacks of its threads."""

import signal
import subprocess
import sys

import pytest


def test_a15_a_node_that_dies_of_a_signal_says_where_it_was(rig, peer):
    process = rig.start_node('compensator', '-p', 'autostart:=false')
    assert peer.change_state('compensator', 'configure')
    process.send(signal.SIGSEGV)
    assert process.wait() == -signal.SIGSEGV
    assert 'Fatal Python error: Segmentation fault' in process.output
    assert 'stream_loop.py' in process.output


@pytest.mark.parametrize('code', [
    # Without an error output there is nowhere to print to, and nothing to stop for.
    'sys.stderr = None; report_crashes(); assert not faulthandler.is_enabled()',
    'sys.stderr = io.StringIO(); report_crashes(); assert not faulthandler.is_enabled()',
    'report_crashes(); assert faulthandler.is_enabled()',
])
def test_it_never_stands_in_the_way(code):
    head = 'import faulthandler, io, sys; from piezo_ros.crash_report import report_crashes; '
    subprocess.run([sys.executable, '-c', head + code], check=True)
