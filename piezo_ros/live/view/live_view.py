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

"""The live view of `piezo run`: what its supervisor sees, served as a page that may stop it."""

import functools
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, Final, ParamSpec

from piezo_ros.live.view.campaign_record import CampaignRecord
from piezo_ros.live.view.live_page import live_page
from piezo_ros.live.view.page_server import LOOPBACK, PageServer
from piezo_ros.parameters.errors import CampaignError, cause_of
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult

__all__ = ['LiveView']

_LAST_LOOK_S: Final = 2.5  # in which an open page takes in how the campaign has ended
_OPEN_S: Final = 3.0  # since its last look a page counts as open
_Arguments = ParamSpec('_Arguments')


def _harmless(method: Callable[_Arguments, None]) -> Callable[_Arguments, None]:
    """Let no mistake of the view reach the campaign that it shows; say it once."""
    told: set[str] = set()

    @functools.wraps(method)
    def guarded(*arguments: _Arguments.args, **named: _Arguments.kwargs) -> None:
        try:
            method(*arguments, **named)
        except Exception as error:
            if str(error) not in told and len(told) < 3:
                told.add(str(error))
                print(f'piezo: the live view does not show all: {error!r}', file=sys.stderr)

    return guarded


class LiveView:
    """
    A page that shows a campaign while it goes on.

    What the campaign tells goes into a bounded record; threads of the server read it. No method
    raises but the first one, and none waits for a page.

    Parameters
    ----------
    title : str
        Title of the plan.
    runs_total : int
        Number of its runs, 0 where that is not known in advance.
    port : int
        Port on loopback, 0 for any that is free.

    Raises
    ------
    CampaignError
        If the port is not to be had.

    """

    def __init__(self, title: str, runs_total: int = 0, *, port: int = 0) -> None:
        self._record = CampaignRecord(title, runs_total)
        self._looked_s = float('-inf')
        self._has_shown_end = threading.Event()
        self._is_over = False
        try:
            self._server = PageServer(live_page, self._data, self._stop, port=port)
        except OSError as error:
            raise CampaignError(
                f'--live cannot listen on {LOOPBACK}, port {port} ({cause_of(error)}); 0 takes any '
                'free one') from None

    @property
    def address(self) -> str:
        """Where the page is."""
        return self._server.address

    def add_rigs(self, *names: str) -> None:
        """Name the rigs of the campaign, '' for one that is alone."""
        for name in names:
            self._record.add_rig(name)

    @_harmless
    def announce(self, text: str) -> None:
        """Show what is done now."""
        self._record.announce(text)

    @_harmless
    def show(self, share: float) -> None:
        """Show how much of it is done, 0 … 1."""
        self._record.show(share)

    @_harmless
    def take_sample(self, rig: str, stream: str, index: int, value: float) -> None:
        """Show the newest sample of a stream."""
        self._record.take_sample(rig, stream, index, value)

    @_harmless
    def take_status(self, rig: str, status: Mapping[str, Any]) -> None:
        """Show the status of a node."""
        self._record.take_status(rig, status)

    @_harmless
    def begin_run(self, planned: Mapping[str, PlannedRun]) -> None:
        """Show that a run begins, by the names of its rigs."""
        self._record.begin_run(planned)

    @_harmless
    def end_run(self, result: RunResult | None = None, problem: str = '') -> None:
        """Show how it has ended."""
        self._record.end_run(
            wall_seconds=result.wall_seconds if result else None, problem=problem)

    def close(self, exit_code: int) -> None:
        """Show how the campaign has ended to a page that is open, and end."""
        if self._is_over:
            return
        self._is_over = True
        self._record.end(exit_code)
        if time.monotonic() - self._looked_s < _OPEN_S:
            self._has_shown_end.wait(_LAST_LOOK_S)
        self._server.close()

    def _data(self, query: Mapping[str, str]) -> dict[str, Any]:
        """Return what is new to a page, which tells rig by rig what it has: rig=run.sequence."""
        known = {}
        for rig, text in query.items():
            run, _, sequence = text.partition('.')
            known[rig.removeprefix('rig_')] = int(run), int(sequence)
        self._looked_s = time.monotonic()
        values = self._record.snapshot(known)
        if values['ended']:
            self._has_shown_end.set()
        return values

    def _stop(self) -> None:
        """Stop the campaign as Ctrl-C does: every node brings its voltage to zero."""
        if self._is_over or not self._record.ask_to_stop():
            return
        print('\npiezo: stop, by the button of the live view', file=sys.stderr)
        os.kill(os.getpid(), signal.SIGINT)
