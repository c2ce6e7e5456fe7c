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

"""``piezo run``: a plan on live nodes."""

import argparse
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from piezo_ros.bag import BagError
from piezo_ros.cli.shared.exit_codes import EXIT_FAILED
from piezo_ros.cli.shared.given_options import refuse_without_effect
from piezo_ros.cli.shared.option_types import Whole
from piezo_ros.cli.shared.outputs import OutputDirectory
from piezo_ros.cli.shared.progress import Progress, ShownProgress
from piezo_ros.experiment.campaign import run_campaign
from piezo_ros.experiment.output_directory import prepare_directory
from piezo_ros.experiment.plan import Plan, read_plan
from piezo_ros.experiment.plan.packaged_plans import PLAN_HELP, plan_path
from piezo_ros.parameters.errors import CampaignError, PlanError
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult
from piezo_ros.report.run_tables import text_table

if TYPE_CHECKING:
    from piezo_ros.experiment.raster.run_raster import Rigs
    from piezo_ros.live.supervisor import Supervisor
    from piezo_ros.live.view.live_view import LiveView

__all__ = ['add_arguments', 'add_plan_arguments', 'check_ros', 'run_plan', 'run_scans', 'with_plan']

_EXAMPLES = """\
examples:
  piezo run demo -o out/demo
  piezo run config/experiments/demo.yaml -o out/demo --composed --force
  piezo run demo -o out/demo --live --force
  piezo simulate config/experiments/demo.yaml -o out/offline
  piezo simulate demo -o out/offline        (the same, by its bare name)
"""
_PORT: Final = Whole(0, 65_535)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    add_plan_arguments(parser)
    processes = parser.add_mutually_exclusive_group()
    processes.add_argument(
        '--separate', action='store_true', help='one process for every node (default)')
    processes.add_argument(
        '--composed', action='store_true', help='the four nodes in one process')
    processes.add_argument(
        '--keep', action='store_true',
        help='composed, and the processes stay for all runs: for plans of many short ones')
    parser.add_argument(
        '--namespace', type=str, default='', metavar='NS',
        help='namespace of the nodes, / for the root (default: one of its own, so that several may '
        'run at once; bags have the root then)')
    parser.add_argument(
        '--live', action='store_true',
        help='serve a page on this machine alone that shows the run and may stop it; its address '
        'is printed')
    parser.add_argument(
        '--live-port', type=_PORT, metavar='PORT',
        help='port of that page (default: 0, any that is free); implies --live')
    parser.add_argument(
        '--yes', action='store_true',
        help='drive a real device without asking; needed where there is no terminal to ask on')
    parser.set_defaults(function=_run_live)


def add_plan_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe what `piezo run` and `piezo simulate` have in common."""
    parser.epilog = _EXAMPLES
    parser.add_argument('plan', type=plan_path, metavar='PLAN', help=PLAN_HELP)
    parser.add_argument(
        '-o', '--output', type=Path, action=OutputDirectory, required=True, metavar='DIR',
        help='output directory')
    parser.add_argument(
        '--force', action='store_true', help='replace an earlier output in DIR')


def _run_live(options: argparse.Namespace) -> int:
    views: list[LiveView] = []
    exit_code = EXIT_FAILED

    def campaign(plan: Plan) -> int:
        nonlocal exit_code
        from piezo_ros.live.supervisor import Supervisor
        view = views[0] if views else None
        with Supervisor(options.namespace) as supervisor:
            if view:
                supervisor.observe(view)
                print(f'piezo: live view: {view.address}', file=sys.stderr, flush=True)
            try:
                exit_code = _do_plan(plan, options, supervisor, view)
            finally:
                if view:
                    view.close(exit_code)
            supervisor.exit_code = exit_code
        return exit_code

    def check(plan: Plan) -> None:
        if plan.scans and options.keep:
            raise CampaignError(
                f'{plan.path} has raster scans, for which --keep is not there; --composed is')
        check_ros(options.namespace)
        if plan.study:
            refuse_without_effect(
                options, ['separate'], 'on a study, all runs of which are in one process')
        if any(run.hardware for run in plan.runs):
            from piezo_ros.cli.shared.drive_question import check_devices
            check_devices(
                plan, is_composed=options.composed or options.keep, is_agreed=options.yes)
        if options.live or options.live_port is not None:
            from piezo_ros.live.view.live_view import LiveView
            views.append(LiveView(plan.title, len(plan.runs), port=options.live_port or 0))

    try:
        return with_plan(options, campaign, check)
    finally:
        for view in views:
            view.close(exit_code)


def _do_plan(
    plan: Plan, options: argparse.Namespace, supervisor: 'Supervisor', view: 'LiveView | None',
) -> int:
    """Do the runs or scans of a plan by a supervisor, and show them in a view."""
    progress = ShownProgress(view) if view else Progress()
    if plan.scans:
        from piezo_ros.experiment.plan.raster_scan import AXES
        from piezo_ros.live.raster_rigs import RasterRigs
        rigs: Rigs = RasterRigs(
            supervisor, options.output, AXES, composed=options.composed, progress=progress.show)
        if view:
            from piezo_ros.live.view.watched_runs import WatchedRigs
            rigs = WatchedRigs(view, rigs, AXES, supervisor.forget_samples)
        return run_scans(plan, options.output, rigs, progress)
    run: Callable[[PlannedRun, Path], RunResult]
    if plan.study or options.keep:
        from piezo_ros.live.kept_graph import KeptGraph
        # Hundreds of short runs: one composed graph is led through all of them.
        run = KeptGraph(supervisor, options.output)
    else:
        from piezo_ros.live.graph_per_run import GraphPerRun
        run = GraphPerRun(
            supervisor, options.output, composed=options.composed, progress=progress.show)
    if view:
        from piezo_ros.live.view.watched_runs import WatchedRuns
        run = WatchedRuns(view, run, supervisor.forget_samples)
    return run_plan(plan, options.output, run, progress)


def check_ros(namespace: str) -> None:
    """Refuse to begin without ROS, or where it could not start: the directory is not touched."""
    try:
        importlib.import_module('piezo_ros.live.supervisor')
    except (ImportError, RuntimeError) as error:
        raise CampaignError(
            f'piezo run needs ROS 2 ({error}); piezo simulate does without it') from None
    from piezo_ros.runtime.process.ros_environment import check_ros_environment, checked_namespace
    check_ros_environment()
    if namespace:
        checked_namespace(namespace)


def with_plan(
    options: argparse.Namespace, campaign: Callable[[Plan], int],
    check: Callable[[Plan], None] = lambda plan: None,
) -> int:
    """Read the plan, check, prepare its output directory, do the campaign; return the exit code."""
    try:
        plan = read_plan(options.plan)
        for note in plan.notes:
            print(f'piezo: {note}', file=sys.stderr)
        if plan.sweep is not None:
            raise PlanError(f'{options.plan} is a sweep; piezo sweep does it')
        check(plan)
        prepare_directory(options.output, force=options.force)
        return campaign(plan)
    except (BagError, CampaignError) as error:
        print(f'piezo: {error}', file=sys.stderr)
        return 1


def run_plan(
    plan: Plan, directory: Path, run: Callable[[PlannedRun, Path], RunResult],
    progress: Progress,
) -> int:
    """Do every run of a plan by ``run``, report them and return the exit code."""
    try:
        if plan.study:
            from piezo_ros.study.studies import run_named_study
            summary, page = run_named_study(plan, directory, run, progress.announce)
            report: Path | None = page
        else:
            campaign = run_campaign(plan, directory, run, progress.announce)
            report, summary = campaign.report, text_table(campaign.runs)
    except CampaignError as error:
        progress.end()
        print(f'piezo: {error}', file=sys.stderr)
        return 1
    progress.end()
    if report is None:
        print(f'no run follows a reference, nothing to score; bags: {directory / "bags"}')
    else:
        print(summary)
        print(f'report: {report}')
    return 0


def run_scans(plan: Plan, directory: Path, rigs: 'Rigs', progress: Progress) -> int:
    """Do every raster scan of a plan, report them and return the exit code."""
    from piezo_ros.experiment.raster.run_raster import run_raster
    from piezo_ros.report.page.raster_report import image_table
    try:
        campaign = run_raster(plan, directory, rigs, progress.announce)
    except CampaignError as error:
        progress.end()
        print(f'piezo: {error}', file=sys.stderr)
        return 1
    progress.end()
    print(image_table(campaign.scans))
    print(f'report: {campaign.report}')
    return 0
