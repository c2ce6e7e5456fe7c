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

"""The studies that a plan may name."""

from collections.abc import Callable
from pathlib import Path

from piezo_ros.experiment.plan import Plan
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult

__all__ = ['run_named_study']


def run_named_study(
    plan: Plan, directory: Path, run: Callable[[PlannedRun, Path], RunResult],
    announce: Callable[[str], None],
) -> tuple[str, Path]:
    """
    Do the study that a plan names; return its outcome in a few lines and its report.html.

    Parameters
    ----------
    plan, directory, run, announce
        As for `piezo_ros.study.run_study.run_study`.

    """
    if plan.study == 'beyond':
        from piezo_ros.study.beyond.beyond_page import beyond_summary
        from piezo_ros.study.beyond.run_beyond import run_beyond
        beyond, report = run_beyond(plan, directory, run, announce)
        return beyond_summary(beyond), report
    from piezo_ros.study.page import study_summary
    from piezo_ros.study.run_study import run_study
    results, report = run_study(plan, directory, run, announce)
    return study_summary(results), report
