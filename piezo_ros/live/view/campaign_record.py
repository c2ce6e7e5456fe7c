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

"""What the page shows of a campaign: its runs, how far they are, and the rigs that do them."""

import threading
from collections import deque
from collections.abc import Mapping
from typing import Any, Final

from piezo_ros.live.view.rig_record import RigRecord
from piezo_ros.parameters.run_and_result import PlannedRun

__all__ = ['CampaignRecord']

_KEPT_RUNS: Final = 100
_LONGEST_TEXT: Final = 1000


class CampaignRecord:
    """
    The state of a campaign, told by the thread that does it and read by those of the page.

    Parameters
    ----------
    title : str
        Title of the plan.
    runs_total : int
        Number of its runs, 0 where that is not known in advance.

    """

    def __init__(self, title: str, runs_total: int = 0) -> None:
        self._title = title
        self._runs_total = runs_total
        self._lock = threading.Lock()
        self._rigs: dict[str, RigRecord] = {}
        self._runs: deque[dict[str, Any]] = deque(maxlen=_KEPT_RUNS)
        self._begun = 0
        self._announced = ''
        self._share_done = 0.0
        self._ended: dict[str, Any] | None = None
        self._is_stopping = False

    def add_rig(self, name: str) -> None:
        """Add a rig, by the name of its axis; '' for one that is alone."""
        with self._lock:
            self._rigs[name] = RigRecord(name)

    def announce(self, text: str) -> None:
        """Take what is done now, as the terminal shows it."""
        with self._lock:
            self._announced = text[:_LONGEST_TEXT]
            self._share_done = 0.0

    def show(self, share: float) -> None:
        """Take how much of it is done, 0 … 1."""
        with self._lock:
            self._share_done = min(max(share, 0.0), 1.0)

    def begin_run(self, planned: Mapping[str, PlannedRun]) -> None:
        """Take that a run begins, of one rig or of several at once, by the names of the rigs."""
        with self._lock:
            self._begun += 1
            first = next(iter(planned.values()))
            self._runs.append({
                'number': self._begun, 'name': first.name, 'description': first.description,
                'state': 'running', 'detail': ''})
            for name, run in planned.items():
                self._rigs[name].begin(run)

    def end_run(self, *, wall_seconds: float | None = None, problem: str = '') -> None:
        """Take how the run has ended."""
        with self._lock:
            self._runs[-1]['state'] = 'failed' if problem else 'done'
            self._runs[-1]['detail'] = (
                problem[:_LONGEST_TEXT] if problem or wall_seconds is None
                else f'{wall_seconds:.1f} s')

    def take_sample(self, rig: str, stream: str, index: int, value: float) -> None:
        """Take a sample of a rig."""
        with self._lock:
            if rig in self._rigs:
                self._rigs[rig].take_sample(stream, index, value)

    def take_status(self, rig: str, status: Mapping[str, Any]) -> None:
        """Take the status of a node of a rig."""
        with self._lock:
            if rig in self._rigs:
                self._rigs[rig].take_status(status)

    def ask_to_stop(self) -> bool:
        """Take that the page has asked to stop; return whether it is for the first time."""
        with self._lock:
            is_first, self._is_stopping = not self._is_stopping, True
        return is_first

    def end(self, exit_code: int) -> None:
        """Take that the campaign is over."""
        with self._lock:
            self._ended = {'exit_code': exit_code}

    def snapshot(self, known: Mapping[str, tuple[int, int]]) -> dict[str, Any]:
        """
        Return what a page shows that knows some of it already.

        Parameters
        ----------
        known : mapping of str to tuple of int
            Rig to the run and the sequence of the newest sample that the page has.

        """
        with self._lock:
            return {
                'title': self._title, 'announced': self._announced,
                'share_done': self._share_done, 'runs_total': self._runs_total,
                'runs_begun': self._begun, 'runs': [dict(run) for run in self._runs],
                'is_stopping': self._is_stopping, 'ended': self._ended,
                'rigs': [
                    rig.snapshot(*known.get(name, (0, 0)))
                    for name, rig in self._rigs.items()]}
