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

"""The report of a sweep, with a plan for each of its worst draws."""

import sys
from pathlib import Path
from typing import Any, Final

import yaml

from piezo_ros.experiment.sweep.run_sweep import Sweep
from piezo_ros.experiment.sweep.sweep_plan import SweepPlan
from piezo_ros.experiment.sweep.sweep_table import by_run, run_title
from piezo_ros.parameters.parameter_file import parameters_yaml
from piezo_ros.parameters.provenance import software_versions
from piezo_ros.report.analysis.sweep_page import SweptRun, WorstDraw, write_sweep_page
from piezo_ros.report.files import write_atomically

__all__ = ['write_sweep_report']

_MOST_WORST: Final = 10
_PLANS: Final = 'worst'


def write_sweep_report(
    directory: Path, plan: SweepPlan, sweep: Sweep, *, title: str = '', text: str = '',
) -> Path | None:
    """
    Write the page of a sweep, and a plan of each of its worst draws.

    Parameters
    ----------
    directory : Path
        Directory of the sweep.
    plan : SweepPlan
        The sweep.
    sweep : Sweep
        Its results.
    title, text : str, optional
        Heading, and text of the plan.

    Returns
    -------
    Path or None
        report.html; None where no run succeeded.

    Raises
    ------
    OSError
        If a file cannot be written.

    """
    done = [result for result in sweep.results if not result['error']]
    if not done:
        return None
    worst = sorted(done, key=lambda result: -result['nrmse_percent'])[:_MOST_WORST]
    return write_sweep_page(
        directory, title=title or 'Sweep',
        runs=[SweptRun(run_title(group), group) for group in by_run(done).values()],
        parameters=list(plan.distributions),
        worst=[_kept(directory, plan, record) for record in worst], failed=sweep.failed,
        software=software_versions(), plan=text, command=' '.join(['piezo', *sys.argv[1:]]))


def _kept(directory: Path, plan: SweepPlan, record: dict[str, Any]) -> WorstDraw:
    """Write the plan of one draw, and its parameters: an entry may not have idle ones, as these."""
    number = record['number']
    planned = plan.run(number)
    name = f'{_PLANS}/{number:06d}.yaml'
    parameters = f'{number:06d}_parameters.yaml'
    write_atomically(
        directory / _PLANS / parameters, parameters_yaml('/**', planned.parameters))
    write_atomically(directory / name, yaml.safe_dump({
        'format_version': 1, 'title': f'Draw {record["draw"]} of a sweep: {planned.name}',
        'parameter_files': [parameters], 'score_periods': plan.score_periods, 'runs': [{}]},
        sort_keys=False))
    output = directory / _PLANS / f'{number:06d}'
    return WorstDraw(record, name, f'piezo simulate {directory / name} -o {output}')
