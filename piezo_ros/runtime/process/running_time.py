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

"""
Time limits that count the time in which this process and its peers could run.

A machine may stand still for seconds: its owner suspends a process, a virtual machine is moved, a
disk is slow. A limit on the wall clock is over then before anything could be tried again. And it
may be busy: where thirty processes share two processors, each comes fifteen times slower to where
it would be otherwise, and what is merely slow must not be told as lost.
"""

import os
import time
from pathlib import Path
from typing import Final

__all__ = ['LONGEST_LOOK_S', 'RunningTime', 'busy_words', 'crowding']

# Looking more often than this loses nothing; in what is longer, the process did not run.
LONGEST_LOOK_S: Final = 0.25
_LOADAVG: Final = Path('/proc/loadavg')
_BUSY: Final = 2.0  # the nodes of one graph alone can want more processors than there are
_PROCESSORS: Final = os.cpu_count() or 1


def crowding() -> float:
    """Return how many threads of the machine want to run for each processor now, at least 1."""
    try:
        runnable, _ = _LOADAVG.read_text(encoding='ascii').split()[3].split('/')
        return max(1.0, int(runnable) / _PROCESSORS)
    except (OSError, ValueError, IndexError):  # no Linux
        return 1.0


def busy_words() -> str:
    """Return what to add to the message of a time limit that is over, '' on a quiet machine."""
    crowded = crowding()
    if crowded < _BUSY:
        return ''
    return (
        f'; the machine is busy: {crowded * _PROCESSORS:.0f} threads want to run on '
        f'{_PROCESSORS} processors')


class RunningTime:
    """
    Time since it was started, as far as the process could run in it.

    A piece between two looks counts for 0.25 s at most, and for the n-th part where n times as many
    threads want to run as there are processors.

    Attributes
    ----------
    awake_s : float
        The same at the last call of `elapsed_s`, but as quick on a busy machine: for limits that
        others set by the wall clock.

    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Begin at zero."""
        self._elapsed_s = self.awake_s = 0.0
        self._looked_s = time.monotonic()

    def elapsed_s(self) -> float:
        """Return the time that has passed; to be called several times a second."""
        now_s = time.monotonic()
        piece_s = min(now_s - self._looked_s, LONGEST_LOOK_S)
        self.awake_s += piece_s
        self._elapsed_s += piece_s / crowding()
        self._looked_s = now_s
        return self._elapsed_s
