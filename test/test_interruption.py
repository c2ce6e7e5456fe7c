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

"""A Ctrl-C counts even where foreign code catches whatever is raised."""

import os
import signal
import subprocess
import sys
import textwrap

import pytest

from piezo_ros.interruption import remembering_interruption, was_interrupted


@pytest.fixture
def python_handler():
    """Python's own handler: tests started in the background inherit that SIGINT is ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def _swallow_ctrl_c():
    """Do as an import that catches everything."""
    try:
        os.kill(os.getpid(), signal.SIGINT)
        for _ in range(1000):
            pass  # the handler runs between two of these
    except BaseException:
        return
    pytest.fail('no KeyboardInterrupt')


def test_one_that_was_caught_by_others_is_remembered(python_handler):
    before = signal.getsignal(signal.SIGINT)
    with remembering_interruption() as interruption:
        assert not interruption.came
        _swallow_ctrl_c()
        assert interruption.came
        assert was_interrupted(signal.getsignal(signal.SIGINT))
    assert signal.getsignal(signal.SIGINT) is before
    assert not was_interrupted(before)


# Code that C has started, as that of an extension module, is interrupted; then the command ends.
INTERRUPTED_IN_C = """
    import ctypes
    import sys
    from piezo_ros.interruption import remembering_interruption
    run = ctypes.pythonapi.PyRun_String
    run.restype = ctypes.py_object
    run.argtypes = [ctypes.c_char_p, ctypes.c_int, ctypes.py_object, ctypes.py_object]
    names = {'__builtins__': __builtins__}
    file_input = 257
    try:
        with remembering_interruption():
            run(b'import os, signal; os.kill(os.getpid(), signal.SIGHUP)', file_input, names, names)
    except KeyboardInterrupt as interrupt:
        print(interrupt)
        sys.exit(3)
"""


def test_one_in_code_that_c_has_started_leaves_the_exit_code(tmp_path):
    (tmp_path / 'interrupted.py').write_text(textwrap.dedent(INTERRUPTED_IN_C))
    paths = os.pathsep.join([str(tmp_path), *sys.path])
    done = subprocess.run(
        [sys.executable, '-m', 'interrupted'], env={**os.environ, 'PYTHONPATH': paths}, text=True,
        capture_output=True, check=False)
    assert (done.returncode, done.stdout) == (3, 'SIGHUP\n'), done.stderr


def test_a_signal_that_is_ignored_stays_so():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with remembering_interruption() as interruption:
            os.kill(os.getpid(), signal.SIGINT)
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        assert not interruption.came
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_supervisor_starts_no_run_after_one(python_handler, tmp_path):
    pytest.importorskip('rclpy')
    from piezo_ros.live.graph_per_run import GraphPerRun
    from piezo_ros.live.supervisor import Supervisor
    from piezo_ros.parameters.errors import CampaignError
    with remembering_interruption():
        _swallow_ctrl_c()
        with Supervisor() as supervisor, pytest.raises(CampaignError, match='by SIGINT'):
            GraphPerRun(supervisor, tmp_path)(None, tmp_path / 'bag')
