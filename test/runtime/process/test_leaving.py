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

"""A process that hangs in C code, the interpreter's lock held, still ends with its exit code."""

import subprocess
import sys

import pytest

# PyDLL keeps the lock: no other thread of Python, and no signal handler, runs from then on.
HANGING = """
import ctypes
from piezo_ros.runtime.process.leaving import exit_after
exit_after(0.5, {code})
ctypes.PyDLL(None).sleep(60)
"""


@pytest.mark.parametrize('code', [0, 1])
def test_a_process_that_hangs_ends_with_its_exit_code(code):
    process = subprocess.run([sys.executable, '-c', HANGING.format(code=code)], timeout=30)
    assert process.returncode == code


def test_a_process_that_ends_by_itself_is_left_alone():
    script = 'from piezo_ros.runtime.process.leaving import exit_after\nexit_after(30.0, 1)'
    assert subprocess.run([sys.executable, '-c', script], timeout=20).returncode == 0


def test_a_process_that_goes_on_calls_it_off():
    script = (
        'import time\nfrom piezo_ros.runtime.process.leaving import exit_after\n'
        'exit_after(0.2, 1)()\ntime.sleep(0.6)')
    assert subprocess.run([sys.executable, '-c', script], timeout=20).returncode == 0
