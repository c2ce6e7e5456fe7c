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

"""Runs the study of the paper and writes its report."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from piezo_ros.experiment.output_directory import keep_plan
from piezo_ros.experiment.plan import Plan
from piezo_ros.interruption import interruptible
from piezo_ros.parameters.provenance import software_versions
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult
from piezo_ros.study.experiments import run_experiments
from piezo_ros.study.model_files import write_models
from piezo_ros.study.page import write_study_page
from piezo_ros.study.record import study_record
from piezo_ros.study.results import PaperResults
from piezo_ros.study.study_runs import StudyRuns

__all__ = ['run_study']

RUNS: Final = 656  # that it does on the rig of its plan


def run_study(
    plan: Plan,
    directory: Path,
    run: Callable[[PlannedRun, Path], RunResult],
    announce: Callable[[str], None] = lambda text: None,
) -> tuple[PaperResults, Path]:
    """
    Do every run of a study and write its report.

    Parameters
    ----------
    plan : Plan
        A plan with a study.
    directory : Path
        As `prepare_directory` leaves it.
    run : callable
        Does one run into the bag directory it is given.
    announce : callable, optional
        Is told of each run before it starts.

    Returns
    -------
    results : PaperResults
        All results.
    report : Path
        The written report.html.

    Raises
    ------
    CampaignError
        If a run does not come to its end; the bags of those before it stay.

    """
    plan_text = keep_plan(plan.path, directory).text
    runs = StudyRuns(directory, run, announce, RUNS)
    results = run_experiments(plan.base, runs.each)
    write_models(directory, results.hysteresis, results.dynamics, results.tuning)
    record: dict[str, Any] = {
        'title': plan.title,
        **study_record(results, {
            scheme: f'bags/scan_{scheme}' for scheme in results.scans}),
        'software': software_versions(),
    }
    for row in record['runs']:
        row['wall_seconds'] = runs.wall_seconds[f'scan_{row["scheme"]}']
    with interruptible():
        report = write_study_page(
            directory, results, record, plan=plan_text, command=' '.join(['piezo', *sys.argv[1:]]))
    return results, report
