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

"""``piezo sweep``: a campaign of thousands of simulated runs on an engine."""

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

from piezo_ros.cli.shared.given_options import refuse_without_effect
from piezo_ros.cli.shared.option_types import Whole
from piezo_ros.cli.shared.outputs import OutputPath
from piezo_ros.cli.shared.progress import Progress
from piezo_ros.experiment.plan.packaged_plans import plan_path
from piezo_ros.interruption import stopped_by
from piezo_ros.parameters.errors import CampaignError, PlanError, failure_text

if TYPE_CHECKING:
    from piezo_ros.experiment.sweep.run_sweep import Sweep
    from piezo_ros.experiment.sweep.sweep_plan import SweepPlan
    from piezo_ros.experiment.sweep.work import Engine

__all__ = ['add_arguments']

_EXAMPLES: Final = """\
examples:
  piezo sweep config/experiments/sweep.yaml -o out/sweep
  piezo sweep config/experiments/sweep.yaml -o out/sweep --scores-only
  piezo sweep config/experiments/sweep.yaml -o out/sweep --engine dask --workers 8
  piezo sweep config/experiments/sweep.yaml -o out/sweep --engine dask \\
      --scheduler tcp://10.0.0.1:8786

The same command again goes on where it was interrupted. More draws in the plan are added to those
that are done.
"""
_WORKERS: Final = Whole(1, 1024)
_STEPS: Final = 10  # plain lines of progress where there is no terminal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    parser.epilog = _EXAMPLES
    parser.add_argument(
        'plan', type=plan_path, metavar='PLAN',
        help='plan file with a key sweep, or the bare name of a packaged one')
    parser.add_argument(
        '-o', '--output', type=Path, action=OutputPath, required=True, metavar='DIR',
        help='output directory')
    parser.add_argument(
        '--engine', choices=('local', 'dask'), default='local',
        help='processes of this machine (default), or Dask (pip install piezo_ros[dask])')
    parser.add_argument(
        '--workers', type=_WORKERS, default=os.cpu_count() or 1, metavar='N',
        help='worker processes (default: one for each core)')
    parser.add_argument(
        '--scheduler', type=str, default='', metavar='ADDRESS',
        help='a Dask cluster that is there already; its workers must see DIR by the same path')
    parser.add_argument(
        '--scores-only', action='store_true',
        help='keep one line of scores for each run in place of a directory: five times as fast')
    parser.add_argument(
        '--bags', action='store_true', help='keep the bag of every run beside its result')
    parser.add_argument(
        '--force', action='store_true', help='start anew in place of going on')
    parser.set_defaults(function=_sweep)


def _sweep(options: argparse.Namespace) -> int:
    from piezo_ros.experiment.plan import read_plan
    from piezo_ros.experiment.sweep.run_sweep import open_sweep, run_sweep
    from piezo_ros.experiment.sweep.sweep_plan import read_sweep
    from piezo_ros.experiment.sweep.sweep_table import summary_table
    from piezo_ros.experiment.sweep.work import SweepWork
    progress = _SweepProgress()
    try:
        if options.bags and options.scores_only:
            raise PlanError('--bags keeps the bag of every run, --scores-only keeps none')
        if options.scheduler and options.engine != 'dask':
            raise PlanError('--scheduler needs --engine dask')
        if options.scheduler:
            refuse_without_effect(
                options, ['workers'], 'beside --scheduler, which has workers already')
        engine = _engine(options)
        whole = read_plan(options.plan)
        plan = read_sweep(whole)
        open_sweep(plan, options.plan, options.output, force=options.force)
        sweep = run_sweep(
            SweepWork(
                plan, str(options.output.resolve()), options.bags, options.scores_only), engine,
            workers=options.workers, progress=progress)
        report = _report(options.output, plan, sweep, whole.title)
    except (CampaignError, ImportError, OSError) as error:
        progress.end()
        print(f'piezo: {failure_text(error)}', file=sys.stderr)
        return 1
    except KeyboardInterrupt as interrupt:
        progress.end()
        print(
            f'piezo: {stopped_by(interrupt)}; the same command goes on from here',
            file=sys.stderr)
        return 1
    progress.end()
    print(summary_table(sweep.results))
    done = len(sweep.results) - sweep.resumed
    if done:
        print(f'{done} runs in {sweep.seconds:.1f} s, {done / sweep.seconds:.0f} runs/s')
    if sweep.resumed:
        print(f'{sweep.resumed} runs had been done before')
    for result in sweep.failed[:3]:
        print(f'piezo: failed: {result["error"]}', file=sys.stderr)
    if sweep.failed:
        print(f'piezo: {len(sweep.failed)} runs failed', file=sys.stderr)
    print(f'table: {sweep.table}')
    if report is not None:
        print(f'report: {report}')
    return 1 if sweep.failed else 0


def _report(output: Path, plan: 'SweepPlan', sweep: 'Sweep', title: str) -> Path | None:
    try:
        from piezo_ros.experiment.sweep.sweep_report import write_sweep_report
    except ImportError:  # without Matplotlib the table is all the same
        return None
    return write_sweep_report(
        output, plan, sweep, title=title, text=(output / 'plan.yaml').read_text(encoding='utf-8'))


def _engine(options: argparse.Namespace) -> 'Engine':
    from piezo_ros.experiment.sweep.engines import dask_engine, local_engine
    if options.engine == 'local':
        return local_engine(options.workers)
    try:
        return dask_engine(options.workers, options.scheduler)
    except ImportError:
        raise ImportError(
            '--engine dask needs Dask (pip install piezo_ros[dask]); --engine local does '
            'without') from None


class _SweepProgress:
    """A bar on a terminal, a line for each tenth elsewhere."""

    def __init__(self) -> None:
        self._progress = Progress()
        self._step = -1

    def __call__(self, done: int, runs: int) -> None:
        """Show how many runs are done."""
        if sys.stderr.isatty():
            if self._step < 0:
                self._progress.announce(f'{runs} runs')
            self._step = 0
            self._progress.show(done / runs)
        elif done * _STEPS // runs > self._step:
            self._step = done * _STEPS // runs
            self._progress.announce(f'{done} of {runs} runs')

    def end(self) -> None:
        """Leave the line of the bar."""
        self._progress.end()
