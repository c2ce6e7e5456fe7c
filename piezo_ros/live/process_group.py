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

"""Processes of node executables: started together, watched, and ended whatever happens."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

from piezo_ros.runtime.process.parent import PARENT_VARIABLE
from piezo_ros.runtime.process.running_time import RunningTime

__all__ = ['POLL_S', 'ProcessGroup']

POLL_S: Final = 0.02
_GRACE_S: Final = ((signal.SIGINT, 10.0), (signal.SIGTERM, 3.0), (signal.SIGKILL, 3.0))


class ProcessGroup:
    """
    Processes that end with this one.

    Attributes
    ----------
    blamed : dict of str to int
        Executables that ended otherwise than well, and their exit codes, in the order in which
        this was noticed; negative for a signal, 0 for one that ended before its run.
    has_begun : callable
        Tells of an executable that has ended with 0 whether its run had begun; by default it had.
    unresponsive : list of str
        Executables that did not end when they were asked to, and were killed by `stop`.

    """

    def __init__(self) -> None:
        self.blamed: dict[str, int] = {}
        self.has_begun: Callable[[str], bool] = lambda name: True
        self.unresponsive: list[str] = []
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._asked_by: dict[str, list[int]] = {}  # signals that `stop` has sent to each

    def __contains__(self, name: object) -> bool:
        """Return whether an executable was started."""
        return name in self._processes

    def start(
        self, name: str, arguments: Iterable[str], log: Path, executable: str = '',
    ) -> None:
        """Start one executable, by default the one of the same name, its output into a log."""
        with log.open('wb') as output:
            self._processes[name] = subprocess.Popen(
                [sys.executable, '-m', 'piezo_ros.nodes.executables', executable or name,
                 *arguments],
                stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT,
                env={**os.environ, PARENT_VARIABLE: str(os.getpid())})

    def pids(self) -> list[int]:
        """Return the numbers of the processes."""
        return [process.pid for process in self._processes.values()]

    def runs(self, name: str) -> bool:
        """Return whether one executable runs."""
        return self._processes[name].poll() is None

    def going(self) -> bool:
        """Return whether any process runs."""
        return any(process.poll() is None for process in self._processes.values())

    def dead(self) -> bool:
        """Return whether a process ended otherwise than well, or too soon, and remember it."""
        for name, process in self._processes.items():
            code = process.poll()
            if code is None or name in self.blamed or name in self.unresponsive:
                continue
            asked_by = self._asked_by.get(name, ())
            # One that is still to take over its signals dies of what it is asked to end by.
            if (code and -code not in asked_by) or not (
                    code or asked_by or self.has_begun(name)):
                self.blamed[name] = code
        return bool(self.blamed)

    def was_killed(self, *names: str) -> bool:
        """Return whether one of some executables has come to no end of its own."""
        return any(
            self.blamed.get(name, 0) < 0 or name in self.unresponsive for name in names)

    def stop(self) -> None:
        """Ask every process to end, and make sure."""
        for step, grace_s in _GRACE_S:
            for name, process in self._processes.items():
                if process.poll() is None:
                    if step == signal.SIGKILL:
                        self.unresponsive.append(name)
                    self._asked_by.setdefault(name, []).append(step)
                    process.send_signal(step)
            waited = RunningTime()
            while self.going() and waited.elapsed_s() < grace_s:
                time.sleep(POLL_S)
            if not self.going():
                return

    def kill(self) -> None:
        """Make sure that no process is left."""
        for process in self._processes.values():
            if process.poll() is None:
                process.kill()
            process.wait()
