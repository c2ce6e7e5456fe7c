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

"""Commands and nodes do not fill a machine with threads that wait for each other."""

import os
import subprocess
import sys

import pytest

from piezo_ros.matrix_threads import ONE_THREAD

# Prints the threads of a process that has called the command and then needs matrices.
COUNT = """
import os
import sys
from piezo_ros.cli.main import main
try:
    main(['--help'])
except SystemExit:
    pass
import numpy
print(len(os.listdir('/proc/self/task')))
"""


def _threads(**environment):
    plain = {key: value for key, value in os.environ.items() if key not in ONE_THREAD}
    done = subprocess.run(
        [sys.executable, '-c', COUNT], env={**plain, **environment}, capture_output=True,
        text=True, check=True)
    return int(done.stdout.splitlines()[-1])


@pytest.mark.skipif(sys.platform != 'linux', reason='the threads are counted in /proc')
def test_the_command_has_one_thread_unless_the_user_wants_more():
    assert _threads() == 1
    if os.cpu_count() > 1:
        assert _threads(OPENBLAS_NUM_THREADS='2') == 2
