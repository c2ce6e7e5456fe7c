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

"""Runs of a campaign of which a live view shows that they begin and how they end."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol

from piezo_ros.live.view.live_view import LiveView
from piezo_ros.parameters.errors import CampaignError
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult

__all__ = ['WatchedRigs', 'WatchedRuns']


class WatchedRuns:
    """
    Does the runs of one rig, each shown.

    Parameters
    ----------
    view : LiveView
        The view.
    run : callable
        Does one run into a bag directory.
    prepare : callable
        Is called before each run; drops samples of the run before.

    """

    def __init__(
        self, view: LiveView, run: Callable[[PlannedRun, Path], RunResult],
        prepare: Callable[[], None],
    ) -> None:
        view.add_rigs('')
        self._view = view
        self._run = run
        self._prepare = prepare

    def __call__(self, planned: PlannedRun, bag: Path) -> RunResult:
        """Do one run; raises `CampaignError` where what does it raises one."""
        (result,) = _shown(
            self._view, {'': planned}, self._prepare, lambda: (self._run(planned, bag),))
        return result


class _Rigs(Protocol):
    def alone(self, planned: PlannedRun, bag: Path) -> RunResult:
        ...

    def together(
        self, planned: Mapping[str, PlannedRun], bags: Mapping[str, Path],
    ) -> tuple[RunResult, ...]:
        ...


class WatchedRigs:
    """
    Does the runs of both axes of a raster scan, each shown.

    Parameters
    ----------
    view : LiveView
        The view.
    rigs : Rigs
        Does the runs.
    axes : sequence of str
        Names of the axes, the fast one first.
    prepare : callable
        Is called before each run; drops samples of the run before.

    """

    def __init__(
        self, view: LiveView, rigs: _Rigs, axes: tuple[str, ...], prepare: Callable[[], None],
    ) -> None:
        view.add_rigs(*axes)
        self._view = view
        self._rigs = rigs
        self._fast = axes[0]
        self._prepare = prepare

    def alone(self, planned: PlannedRun, bag: Path) -> RunResult:
        """Do a run of the fast axis; raises `CampaignError` where the rigs raise one."""
        (result,) = _shown(
            self._view, {self._fast: planned}, self._prepare,
            lambda: (self._rigs.alone(planned, bag),))
        return result

    def together(
        self, planned: Mapping[str, PlannedRun], bags: Mapping[str, Path],
    ) -> tuple[RunResult, ...]:
        """Do a run of each axis; raises `CampaignError` where the rigs raise one."""
        return _shown(
            self._view, planned, self._prepare, lambda: self._rigs.together(planned, bags))


def _shown(
    view: LiveView, planned: Mapping[str, PlannedRun], prepare: Callable[[], None],
    do: Callable[[], tuple[RunResult, ...]],
) -> tuple[RunResult, ...]:
    prepare()
    view.begin_run(planned)
    try:
        results = do()
    except CampaignError as error:
        view.end_run(problem=str(error))
        raise
    view.end_run(max(results, key=lambda result: result.wall_seconds))
    return results
