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
The work of a sweep's worker: simulated runs and their scores.

Where each run has a directory of its own, ``runs/<number>``, its result ``run.json`` is written
last and at once, so that a run is done or it is not, whenever its worker was killed.
"""

import json
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np

from piezo_ros.experiment.offline import compile_loop, write_run
from piezo_ros.experiment.sweep.drawn_runs import DrawnRuns
from piezo_ros.experiment.sweep.sweep_plan import SweepPlan
from piezo_ros.report.files import write_atomically
from piezo_ros.report.metrics import nrmse, tail

__all__ = ['Engine', 'SweepWork', 'do_runs', 'finished_run', 'run_directory']

_RUN_RECORD: Final = 'run.json'
_PERCENT: Final = 100.0
_RESULT_KEYS: Final = ('nrmse_percent', 'max_error_um', 'seconds', 'error')
# What a record says of each run beside what was drawn.
_DESCRIBING: Final = (
    ('controller', 'scheme'), ('trajectory', 'waveform'), ('trajectory', 'amplitude_um'),
    ('trajectory', 'frequency_hz'), ('trajectory', 'harmonics'))


@dataclass(frozen=True)
class SweepWork:
    """
    What a worker needs.

    Attributes
    ----------
    plan : SweepPlan
        The sweep.
    directory : str
        Where its runs go, by a path that is valid for every worker.
    keep_bags : bool
        Whether the bag of each run is kept beside its result.
    scores_only : bool
        Whether no run has a directory: the records are handed over and not written.

    """

    plan: SweepPlan
    directory: str
    keep_bags: bool = False
    scores_only: bool = False


# Does every batch of runs with `do_runs`; hands over the records of each as soon as it is done.
Engine: TypeAlias = Callable[
    [SweepWork, Sequence[Sequence[int]], Callable[[Sequence[Mapping[str, Any]]], None]], None]


def run_directory(directory: Path | str, number: int) -> Path:
    """Return the directory of a run."""
    return Path(directory) / 'runs' / f'{number:06d}'


def do_runs(work: SweepWork, numbers: Sequence[int]) -> list[dict[str, Any]]:
    """
    Do some runs, in a worker; those that are done already are not done again.

    Parameters
    ----------
    work : SweepWork
        The sweep.
    numbers : sequence of int
        Numbers of the runs.

    Returns
    -------
    list of dict
        The record of each run; ``error`` says why one failed.

    """
    compile_loop()
    runs = DrawnRuns(work.plan)
    if work.scores_only:
        return [_scored(work, runs, number, None) for number in numbers]
    return [
        finished_run(work.directory, number) or _kept(work, runs, number) for number in numbers]


def _kept(work: SweepWork, runs: DrawnRuns, number: int) -> dict[str, Any]:
    """Do a run and keep its record, and its bag where that is wanted."""
    directory = run_directory(work.directory, number)
    if directory.exists():
        shutil.rmtree(directory)  # of a worker that was killed
    directory.mkdir(parents=True)
    record = _scored(work, runs, number, directory / 'bag' if work.keep_bags else None)
    write_atomically(directory / _RUN_RECORD, json.dumps(record))
    return record


def _scored(
    work: SweepWork, runs: DrawnRuns, number: int, bag: Path | None,
) -> dict[str, Any]:
    """Do a run and return its record."""
    drawn = work.plan.drawn(number)
    draw, entry = divmod(number, len(work.plan.entries))
    record: dict[str, Any] = {
        'number': number, 'draw': draw, 'run': entry, 'name': '', **drawn,
        **dict.fromkeys(_RESULT_KEYS), 'error': ''}
    start = time.perf_counter()
    try:
        record['name'], planned = runs.run(number, drawn)
        for node, parameter in _DESCRIBING:
            record[parameter] = planned.parameters[node][parameter]
        streams = runs.streams(planned)
        trajectory = planned.trajectory
        window = tail(
            trajectory.samples, trajectory.frequency_hz, trajectory.sample_period_s,
            work.plan.score_periods)
        reference_um = streams['reference'][window]
        displacement_um = streams['displacement'][window]
        record['nrmse_percent'] = _PERCENT * nrmse(reference_um, displacement_um)
        record['max_error_um'] = float(np.max(np.abs(reference_um - displacement_um)))
        if bag is not None:
            write_run(planned, streams, bag)
    except (ValueError, ArithmeticError) as error:
        record['error'] = str(error)
    record['seconds'] = time.perf_counter() - start
    return record


def finished_run(directory: str, number: int) -> dict[str, Any] | None:
    """Return the record of a run, None if it is not done."""
    try:
        text = (run_directory(directory, number) / _RUN_RECORD).read_text(encoding='utf-8')
        record = json.loads(text)
    except (OSError, ValueError):
        return None
    return dict(record)
