"""A process that hangs in C code, the interpreter's lock held, still ends with its exit code."""

import subprocess
import sys

import pytest

# PyDLL keeps the lock: no other thread of Python, and no signal handler, runs from then on.
HANGING = """
import ctypes
from piezo_ros.nodes.leaving import exit_after
exit_after(0.5, {code})
ctypes.PyDLL(None).sleep(60)
"""


@pytest.mark.parametrize('code', [0, 1])
def test_a_process_that_hangs_ends_with_its_exit_code(code):
    process = subprocess.run([sys.executable, '-c', HANGING.format(code=code)], timeout=30)
    assert process.returncode == code


def test_a_process_that_ends_by_itself_is_left_alone():
    script = 'from piezo_ros.nodes.leaving import exit_after\nexit_after(30.0, 1)'
    assert subprocess.run([sys.executable, '-c', script], timeout=20).returncode == 0
