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

"""A campaign: the runs of a plan one after the other, their bags, and the report."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from piezo_ros.bag import BagError, open_recording
from piezo_ros.experiment.motion_files import with_copied_motions
from piezo_ros.experiment.output_directory import keep_plan
from piezo_ros.experiment.plan import Plan
from piezo_ros.interruption import interruptible
from piezo_ros.parameters.errors import CampaignError, failure_text
from piezo_ros.parameters.provenance import software_versions
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult
from piezo_ros.report import ScoredRun, score

__all__ = ['Campaign', 'run_campaign']


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

    plan_copy = keep_plan(plan.path, directory)
    scored: list[ScoredRun] = []
    notes = list(plan.notes)
    predictions: dict[str, dict[str, Any]] = {}
    failure: CampaignError | None = None
    for number, planned in enumerate(plan.runs, start=1):
        announce(f'[{number}/{len(plan.runs)}] {planned.description}')
        bag = directory / 'bags' / planned.name
        try:
            result = run(with_copied_motions(planned, plan_copy.files), bag)
            if not planned.bare:  # it follows no reference
                scored.append(_scored(plan, directory, bag, result))
        except (CampaignError, BagError, OSError) as error:
            failure = CampaignError(failure_text(error))
            notes.append(f'The campaign ended at run {number}, {planned.name}: {error}')
            break
        notes += [f'{planned.name}: {note}' for note in result.notes]
        if planned.changes:
            notes.append(f'{planned.name} changes during the run: {planned.description}')
        if planned.prediction:
            predictions[str(bag.relative_to(directory))] = planned.prediction.record()
            notes.append(
                f'{planned.name}: predicted NRMSE {planned.prediction.nrmse_percent:.2f} %. '
                f'{planned.prediction.reason}')
    report: Path | None = None
    if scored:
        try:
            with interruptible():
                report = write_report(
                    directory, title=plan.title, runs=scored, software=software_versions(),
                    notes=notes, predictions=predictions, plan=plan_copy.text,
                    command=' '.join(['piezo', *sys.argv[1:]]))
        except OSError as error:
            words = [] if failure is None else [str(failure)]
            raise CampaignError('; '.join([*words, _without_report(error, directory)])) from None
    if failure:
        raise failure
    return Campaign(tuple(scored), report)


def _without_report(error: OSError, directory: Path) -> str:
    """Return what to say of a report that cannot be written, and of what is there without it."""
    return (
        f'the report cannot be written: {failure_text(error)}; the bags of the runs before are '
        f'whole, `piezo report {directory} -o DIR` reports them where there is room')


def _scored(plan: Plan, directory: Path, bag: Path, result: RunResult) -> ScoredRun:
    try:
        return score(
            open_recording(bag), periods=plan.score_periods, bag=str(bag.relative_to(directory)),
            wall_seconds=result.wall_seconds)
    except ValueError as error:
        raise CampaignError(f'{bag} cannot be scored: {error}') from None
