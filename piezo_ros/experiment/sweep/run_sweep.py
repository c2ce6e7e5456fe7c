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

"""A sweep: thousands of simulated runs on an engine, resumable, their results in one table."""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from piezo_ros.experiment.output_directory import keep_plan, resume_directory
from piezo_ros.experiment.sweep.scores_file import ScoresFile
from piezo_ros.experiment.sweep.sweep_plan import SweepPlan
from piezo_ros.experiment.sweep.sweep_table import write_table
from piezo_ros.experiment.sweep.work import Engine, SweepWork, finished_run
from piezo_ros.parameters.errors import CampaignError, PlanError
from piezo_ros.report.files import write_atomically

__all__ = ['Sweep', 'open_sweep', 'run_sweep']

FORMAT_VERSION: Final = 2  # 1 drew other values of the same seed
_RECORD: Final = 'sweep.json'
# So long that handing tasks out costs nothing, so short that a killed worker costs little.
_MOST_RUNS_PER_TASK: Final = 50
_MOST_SCORED_PER_TASK: Final = 500  # that leave nothing but their scores
_TASKS_PER_WORKER: Final = 8


@dataclass(frozen=True)
class Sweep:
    """
    What came of a sweep.

    Attributes
    ----------
    results : list of dict
        One flat record for each run, in the order of their numbers.
    table : Path
        The written table.
    resumed : int
        How many of the runs had been done before.
    seconds : float
        Wall-clock time of the others.

    """

    results: list[dict[str, Any]]
    table: Path
    resumed: int
    seconds: float

    @property
    def failed(self) -> list[dict[str, Any]]:
        """The records of the runs that failed."""
        return [result for result in self.results if result['error']]


def open_sweep(plan: SweepPlan, source: Path, directory: Path, *, force: bool) -> None:
    """
    Prepare the directory of a sweep, or make sure that one to be resumed is of the same plan.

    Parameters
    ----------
    plan : SweepPlan
        The sweep.
    source : Path
        The file of the plan, of which a copy is kept.
    directory : Path
        Where it goes.
    force : bool
        Replace an earlier output in place of resuming it.

    Raises
    ------
    PlanError
        If the directory contains something else, or the sweep of another plan.

    """
    record = directory / _RECORD
    if resume_directory(directory, _RECORD, force=force):
        try:
            content = json.loads(record.read_text(encoding='utf-8'))
            version, digest = content['format_version'], content['digest']
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise PlanError(f'{record} is no record of a sweep: {error!r}') from None
        if version != FORMAT_VERSION:
            raise PlanError(
                f'{record} has the format_version {version!r}, only {FORMAT_VERSION} is known')
        if digest != plan.digest:
            raise PlanError(
                f'{directory} holds the sweep of another plan than {source} is now; only the '
                'number of draws may change. --force starts anew')
    else:
        write_atomically(record, json.dumps(
            {'format_version': FORMAT_VERSION, 'digest': plan.digest}, indent=2) + '\n')
    keep_plan(source, directory)


def run_sweep(
    work: SweepWork, engine: Engine, *, workers: int,
    progress: Callable[[int, int], None] = lambda done, runs: None,
) -> Sweep:
    """
    Do what is left of a sweep and write the table of all its runs.

    Parameters
    ----------
    work : SweepWork
        The sweep, its directory opened by `open_sweep`.
    engine : callable
        Does the runs.
    workers : int
        How many it has.
    progress : callable, optional
        Is told how many runs of how many are done.

    Raises
    ------
    CampaignError
        If the engine could not do its work. What was done stays, and the next call goes on.

    """
    runs = work.plan.runs
    scores = ScoresFile(Path(work.directory))
    results = _finished(work, scores)
    resumed = len(results)
    left = [number for number in range(runs) if number not in results]
    most = _MOST_SCORED_PER_TASK if work.scores_only else _MOST_RUNS_PER_TASK
    size = max(1, min(most, len(left) // (workers * _TASKS_PER_WORKER)))
    batches = [left[start:start + size] for start in range(0, len(left), size)]

    def take(records: Sequence[Mapping[str, Any]]) -> None:
        if work.scores_only:
            scores.add(records)
        for record in records:
            results[record['number']] = dict(record)
        progress(len(results), runs)

    progress(resumed, runs)
    start = time.perf_counter()
    if batches:
        engine(work, batches, take)
    seconds = time.perf_counter() - start
    missing = [number for number in left if number not in results]
    if missing:
        raise CampaignError(
            f'{len(missing)} runs were not done, the first is number {missing[0]}')
    ordered = [results[number] for number in range(runs)]
    return Sweep(ordered, write_table(Path(work.directory), ordered), resumed, seconds)


def _finished(work: SweepWork, scores: ScoresFile) -> dict[int, dict[str, Any]]:
    """Return number and record of the runs that are done, with a directory or without."""
    found = {
        number: record for number, record in scores.read().items() if number < work.plan.runs}
    if (Path(work.directory) / 'runs').is_dir():
        for number in range(work.plan.runs):
            record = None if number in found else finished_run(work.directory, number)
            if record is not None:
                found[number] = record
    return found
