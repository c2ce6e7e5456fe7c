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
A sweep: thousands of simulated runs on an engine, resumable, their results in one table.

Every run has a directory of its own, ``runs/<number>``. Its ``run.json`` is written last and at
once, so that a run is done or it is not, whenever its worker was killed.
"""

import csv
import json
import shutil
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from piezo_ros.experiment.campaign import PLAN_COPY, prepare_directory
from piezo_ros.experiment.offline import compile_loop, simulated_streams, write_run
from piezo_ros.experiment.sweep_plan import SweepPlan
from piezo_ros.parameters.errors import CampaignError, PlanError
from piezo_ros.report.files import write_atomically
from piezo_ros.report.metrics import nrmse, tail

__all__ = [
    'Engine',
    'Sweep',
    'SweepWork',
    'do_runs',
    'open_sweep',
    'run_directory',
    'run_sweep',
    'summary_table',
]

FORMAT_VERSION: Final = 1
_RECORD: Final = 'sweep.json'
_RUN_RECORD: Final = 'run.json'
_PERCENT: Final = 100.0
_RESULT_KEYS: Final = ('nrmse_percent', 'max_error_um', 'seconds', 'error')
# What a table says of each run beside what was drawn.
_DESCRIBING: Final = (
    ('controller', 'scheme'), ('trajectory', 'waveform'), ('trajectory', 'amplitude_um'),
    ('trajectory', 'frequency_hz'), ('trajectory', 'harmonics'))
# So long that handing tasks out costs nothing, so short that a killed worker costs little.
_MOST_RUNS_PER_TASK: Final = 50
_TASKS_PER_WORKER: Final = 8
_QUANTILES: Final = (0.05, 0.5, 0.95)


@dataclass(frozen=True)
class SweepWork:
    """
    What a worker needs.

    Attributes
    ----------
    plan : SweepPlan
        The sweep.
    directory : str
        Where its runs go, by a path that holds for every worker.
    keep_bags : bool
        Whether the bag of each run is kept beside its result.

    """

    plan: SweepPlan
    directory: str
    keep_bags: bool


# Does every batch of runs with `do_runs`; tells of each as it is done.
Engine = Callable[
    [SweepWork, Sequence[Sequence[int]], Callable[[Sequence[Mapping[str, Any]]], None]], None]


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
    return [_done(work.directory, number) or _do(work, number) for number in numbers]


def _do(work: SweepWork, number: int) -> dict[str, Any]:
    directory = run_directory(work.directory, number)
    if directory.exists():
        shutil.rmtree(directory)  # of a worker that was killed
    directory.mkdir(parents=True)
    record: dict[str, Any] = {
        'number': number, 'draw': number // len(work.plan.entries),
        'run': number % len(work.plan.entries), 'name': '',
        **work.plan.drawn(number), **dict.fromkeys(_RESULT_KEYS), 'error': ''}
    start = time.perf_counter()
    try:
        planned = work.plan.run(number)
        record['name'] = planned.name
        for stage, parameter in _DESCRIBING:
            record[parameter] = planned.parameters[stage][parameter]
        streams = simulated_streams(planned)
        trajectory = planned.trajectory
        window = tail(
            trajectory.samples, trajectory.frequency_hz, trajectory.sample_period_s,
            work.plan.score_periods)
        reference_um = streams['reference'][window]
        displacement_um = streams['displacement'][window]
        record['nrmse_percent'] = _PERCENT * nrmse(reference_um, displacement_um)
        record['max_error_um'] = float(np.max(np.abs(reference_um - displacement_um)))
        if work.keep_bags:
            write_run(planned, streams, directory / 'bag')
    except (ValueError, ArithmeticError) as error:
        record['error'] = str(error)
    record['seconds'] = time.perf_counter() - start
    write_atomically(directory / _RUN_RECORD, json.dumps(record))
    return record


def _done(directory: str, number: int) -> dict[str, Any] | None:
    """Return the record of a run, None if it is not done."""
    try:
        text = (run_directory(directory, number) / _RUN_RECORD).read_text(encoding='utf-8')
        record = json.loads(text)
    except (OSError, ValueError):
        return None
    return dict(record)


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
        If the directory holds something else, or the sweep of another plan.

    """
    record = directory / _RECORD
    if record.is_file() and not force:
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
        prepare_directory(directory, force=force)
        write_atomically(record, json.dumps(
            {'format_version': FORMAT_VERSION, 'digest': plan.digest}, indent=2) + '\n')
    shutil.copyfile(source, directory / PLAN_COPY)


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
    results = {
        number: record for number in range(runs)
        if (record := _done(work.directory, number)) is not None}
    resumed = len(results)
    left = [number for number in range(runs) if number not in results]
    size = max(1, min(_MOST_RUNS_PER_TASK, len(left) // (workers * _TASKS_PER_WORKER)))
    batches = [left[start:start + size] for start in range(0, len(left), size)]

    def take(records: Iterable[Mapping[str, Any]]) -> None:
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


def write_table(directory: Path, results: Sequence[Mapping[str, Any]]) -> Path:
    """
    Write one row for each run: Parquet where pyarrow is installed, else CSV.

    Parameters
    ----------
    directory : Path
        Where results.parquet or results.csv goes.
    results : sequence of mapping
        The records of the runs.

    Returns
    -------
    Path
        The written file.

    """
    columns = list(dict.fromkeys(name for record in results for name in record))
    # Lists become text in either form, so that both say the same.
    rows = [
        [json.dumps(value) if isinstance(value, list) else value
         for value in (record.get(name) for name in columns)]
        for record in results]
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        path = directory / 'results.csv'
        unfinished = directory / 'results.csv.part'
        with unfinished.open('w', encoding='utf-8', newline='') as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            writer.writerows(rows)
        unfinished.replace(path)
        return path
    path = directory / 'results.parquet'
    unfinished = directory / 'results.parquet.part'
    parquet.write_table(
        pyarrow.table({name: [row[k] for row in rows] for k, name in enumerate(columns)}),
        unfinished)
    unfinished.replace(path)
    return path


def summary_table(results: Sequence[Mapping[str, Any]]) -> str:
    """Return quantiles of the tracking error over the draws, one line for each run of the plan."""
    heads = ''.join(f'{f"{quantile:.0%}":>10}' for quantile in _QUANTILES)
    lines = [f'{"NRMSE %":44}{"draws":>8}{heads}']
    groups: dict[int, list[Mapping[str, Any]]] = {}
    for result in results:
        if not result['error']:
            groups.setdefault(result['run'], []).append(result)
    for run in sorted(groups):
        group = groups[run]
        values = np.quantile([result['nrmse_percent'] for result in group], _QUANTILES)
        numbers = ''.join(f'{value:10.3f}' for value in values)
        lines.append(f'{_title(group):44}{len(group):8}{numbers}')
    return '\n'.join(lines)


def _title(group: Sequence[Mapping[str, Any]]) -> str:
    """Return what all runs of a group have in common."""
    forms = {
        'scheme': '{}', 'waveform': '{}', 'amplitude_um': '{:g} um', 'frequency_hz': '{:g} Hz',
        'harmonics': 'm = {}'}
    return ' '.join(
        form.format(group[0][name]) for name, form in forms.items()
        if all(result[name] == group[0][name] for result in group))
