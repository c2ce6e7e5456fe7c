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

"""Does the runs of a plan one after the other, keeps their bags, and reports."""

import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from piezo_ros.bag import open_recording
from piezo_ros.experiment.plan import Plan
from piezo_ros.parameters.errors import CampaignError, PlanError
from piezo_ros.parameters.provenance import software_versions
from piezo_ros.parameters.run import PlannedRun, RunResult
from piezo_ros.report import ScoredRun, score

__all__ = ['PLAN_COPY', 'Campaign', 'prepare_directory', 'run_campaign']

# Only what bears this name is ever deleted: a plan.yaml of the user's own may lie anywhere.
_MARKER: Final = '.piezo_output'
PLAN_COPY: Final = 'plan.yaml'


@dataclass(frozen=True)
class Campaign:
    """
    What came of a plan.

    Attributes
    ----------
    runs : tuple of ScoredRun
        The scored runs, in the order of the plan.
    report : Path or None
        The written report.html; None where no run follows a reference.

    """

    runs: tuple[ScoredRun, ...]
    report: Path | None


def prepare_directory(directory: Path, *, force: bool) -> None:
    """
    Make a directory for the output, empty but for a mark that says what it is.

    Parameters
    ----------
    directory : Path
        Where the output goes.
    force : bool
        Replace an earlier output, which bears the mark; nothing else is ever deleted.

    Raises
    ------
    PlanError
        If the directory exists and may not be replaced.

    """
    if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
        if not force:
            raise PlanError(f'{directory} exists; --force replaces it')
        if not (directory / _MARKER).is_file():
            raise PlanError(
                f'{directory} exists and is no earlier output (it has no {_MARKER}); '
                'it is not replaced')
        shutil.rmtree(directory)
    directory.mkdir(parents=True, exist_ok=True)
    (directory / _MARKER).touch()


def run_campaign(
    plan: Plan,
    directory: Path,
    run: Callable[[PlannedRun, Path], RunResult],
    announce: Callable[[str], None] = lambda text: None,
) -> Campaign:
    """
    Do every run of a plan and write the report.

    Parameters
    ----------
    plan : Plan
        The plan.
    directory : Path
        As `prepare_directory` leaves it; plan.yaml, bags/, report.html, report.json, runs.csv and
        figures/ are written.
    run : callable
        Does one run into the bag directory it is given.
    announce : callable, optional
        Is told of each run before it starts.

    Returns
    -------
    Campaign
        The scored runs and the report.

    Raises
    ------
    CampaignError
        If a run does not come to its end. The runs before it are reported all the same.

    """
    from piezo_ros.report.page.run_report import write_report

    shutil.copyfile(plan.path, directory / PLAN_COPY)
    scored: list[ScoredRun] = []
    notes: list[str] = []
    predictions: dict[str, dict[str, Any]] = {}
    failure: CampaignError | None = None
    for number, planned in enumerate(plan.runs, start=1):
        announce(f'[{number}/{len(plan.runs)}] {describe(planned)}')
        bag = directory / 'bags' / planned.name
        try:
            result = run(planned, bag)
            if not planned.bare:  # it follows no reference
                scored.append(_scored(plan, directory, bag, result))
        except CampaignError as error:
            failure = error
            notes.append(f'The campaign ended at run {number}, {planned.name}: {error}')
            break
        notes += [f'{planned.name}: {note}' for note in result.notes]
        if planned.changes:
            notes.append(f'{planned.name} changes during the run: {describe(planned)}')
        if planned.prediction:
            predictions[str(bag.relative_to(directory))] = planned.prediction.record()
            notes.append(
                f'{planned.name}: predicted NRMSE {planned.prediction.nrmse_percent:.2f} %. '
                f'{planned.prediction.reason}')
    report: Path | None = None
    if scored:
        report = write_report(
            directory, title=plan.title, runs=scored, software=software_versions(),
            notes=notes, predictions=predictions,
            plan=(directory / PLAN_COPY).read_text(encoding='utf-8'),
            command=' '.join(['piezo', *sys.argv[1:]]))
    if failure:
        raise failure
    return Campaign(tuple(scored), report)


def _scored(plan: Plan, directory: Path, bag: Path, result: RunResult) -> ScoredRun:
    try:
        return score(
            open_recording(bag), periods=plan.score_periods, bag=str(bag.relative_to(directory)),
            wall_seconds=result.wall_seconds)
    except ValueError as error:
        raise CampaignError(f'{bag} cannot be scored: {error}') from None


def describe(planned: PlannedRun) -> str:
    """Return one line about a run."""
    trajectory = planned.trajectory
    if planned.bare:
        return (
            f'bare actuator: {trajectory.waveform} {trajectory.amplitude_v:g} V, '
            f'{trajectory.frequency_hz:g} Hz, {trajectory.samples} samples')
    # What follows during the run counts as much as what it begins with.
    schemes = [planned.controller.scheme, *(
        f'{change.values.get("scheme", "other gains")} from sample {change.at_sample} on'
        for change in planned.changes)]
    return (
        f'{", ".join(schemes)}: {trajectory.waveform} {trajectory.amplitude_um:g} um, '
        f'{trajectory.frequency_hz:g} Hz, m = {trajectory.harmonics}, '
        f'{trajectory.samples} samples')
