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
The rigs of a raster scan live: one graph of nodes for each axis, in a namespace of its own.

Each graph is in lockstep by itself, and none sends samples that the other does not demand yet
(`lockstep_with`): they are never farther apart than the demand leads. They are started and ended
together: where one fails, the other does not go on alone.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from piezo_ros.live.graph_per_run import GraphPerRun, LiveRun
from piezo_ros.live.process_group import POLL_S
from piezo_ros.live.supervisor import Supervisor
from piezo_ros.parameters.errors import CampaignError
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult

__all__ = ['RasterRigs']


class RasterRigs:
    """
    Does the runs of both axes on node processes.

    Parameters
    ----------
    supervisor : Supervisor
        What starts and ends the processes; the axes are in namespaces below its own.
    directory : Path
        Output directory; logs/ and parameters/ go below it.
    axes : sequence of str
        Names of the axes and of their namespaces, the fast one first.
    composed : bool
        One process for the four nodes of each axis in place of four.
    progress : callable
        Is told the share of the run that is done, 0 … 1.

    """

    def __init__(
        self, supervisor: Supervisor, directory: Path, axes: Sequence[str], *,
        composed: bool = False,
        progress: Callable[[float], None] = lambda share: None,
    ) -> None:
        self._shares: dict[str, float] = {}
        self._progress = progress
        supervisors = {axis: supervisor.below(axis) for axis in axes}
        self._graphs = {
            axis: GraphPerRun(
                each, directory, composed=composed, progress=self._progress_of(axis))
            for axis, each in supervisors.items()}

    def alone(self, planned: PlannedRun, bag: Path) -> RunResult:
        """
        Do a run of the fast axis.

        Raises
        ------
        CampaignError
            As `GraphPerRun`.

        """
        self._shares = {}
        fast = next(iter(self._graphs.values()))
        return fast(planned, bag)

    def together(
        self, planned: Mapping[str, PlannedRun], bags: Mapping[str, Path],
    ) -> tuple[RunResult, ...]:
        """
        Do a run of each axis, both at once.

        Parameters
        ----------
        planned : mapping of str to PlannedRun
            Axis to its run.
        bags : mapping of str to Path
            Axis to its bag directory; must not exist.

        Raises
        ------
        CampaignError
            If a node of any axis failed or died, or the runs were stopped from outside. The text
            names the axis.

        """
        self._shares = dict.fromkeys(planned, 0.0)
        for bag in bags.values():
            bag.parent.mkdir(parents=True, exist_ok=True)
        runs: dict[str, LiveRun] = {}
        try:
            for axis, run in planned.items():
                others = [other for other in planned if other != axis]
                runs[axis] = self._graphs[axis].start(_in_step(run, others), bags[axis])
            while not self._decided(runs):
                for axis, live in runs.items():
                    self._graphs[axis].follow(live)
                time.sleep(POLL_S)
            # What ended them, before the others are told to end.
            failed = [axis for axis, live in runs.items() if self._has_failed(axis, live)]
            for axis, live in runs.items():
                self._graphs[axis].end(live)
        finally:
            for graph in self._graphs.values():
                graph.kill()
        return self._results(runs, bags, failed)

    def _results(
        self, runs: Mapping[str, LiveRun], bags: Mapping[str, Path], failed: list[str],
    ) -> tuple[RunResult, ...]:
        results: list[RunResult] = []
        problems: dict[str, str] = {}
        for axis, live in runs.items():
            try:
                results.append(self._graphs[axis].result(live, bags[axis]))
            except CampaignError as error:
                problems[axis] = str(error)
        if problems:
            # The others had to end with it.
            told = [axis for axis in failed if axis in problems] or list(problems)
            raise CampaignError('; '.join(f'{axis} axis: {problems[axis]}' for axis in told))
        return tuple(results)

    def _decided(self, runs: Mapping[str, LiveRun]) -> bool:
        """Return whether all runs are over, or one has failed."""
        return all(live.over() for live in runs.values()) or any(
            self._has_failed(axis, live) for axis, live in runs.items())

    def _has_failed(self, axis: str, live: LiveRun) -> bool:
        return self._graphs[axis].interrupted() or (live.over() and not live.finished())

    def _progress_of(self, axis: str) -> Callable[[float], None]:
        def tell(share: float) -> None:
            self._shares[axis] = share
            self._progress(min(self._shares.values()))

        return tell


def _in_step(planned: PlannedRun, axes: Sequence[str]) -> PlannedRun:
    """Return a run that keeps step with other axes; bags tell of them without our namespace."""
    trajectory = {
        **planned.parameters['trajectory'],
        'lockstep_with': ','.join(f'../{axis}' for axis in axes)}
    return replace(planned, parameters={**planned.parameters, 'trajectory': trajectory})
