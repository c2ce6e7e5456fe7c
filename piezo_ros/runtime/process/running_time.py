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
Time limits that count the time in which this process could run.

A machine may stand still for seconds: its owner suspends a process, a virtual machine is moved, a
disk is slow. A limit on the wall clock is over then before anything could be tried again.
"""

import time
from typing import Final

__all__ = ['LONGEST_LOOK_S', 'RunningTime']

# Looking more often than this loses nothing; in what is longer, the process did not run.
LONGEST_LOOK_S: Final = 0.25


class RunningTime:
    """Time since it was started; a piece between two looks counts for 0.25 s at most."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Begin at zero."""
        self._elapsed_s = 0.0
        self._looked_s = time.monotonic()

    def elapsed_s(self) -> float:
        """Return the time that has passed; to be called several times a second."""
        now_s = time.monotonic()
        self._elapsed_s += min(now_s - self._looked_s, LONGEST_LOOK_S)
        self._looked_s = now_s
        return self._elapsed_s
