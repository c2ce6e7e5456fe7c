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

"""``piezo simulate``: the plan of `piezo run` offline, without ROS."""

import argparse

from piezo_ros.cli.run import add_plan_arguments, run_plan, run_scans, with_plan
from piezo_ros.cli.shared.progress import Progress
from piezo_ros.experiment.plan import Plan

__all__ = ['add_arguments']


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    add_plan_arguments(parser)
    parser.set_defaults(function=_simulate)


def _simulate(options: argparse.Namespace) -> int:
    from piezo_ros.experiment.offline import simulate_run
    from piezo_ros.experiment.plan.hardware_entry import stand_in

    def check(plan: Plan) -> None:
        for run in plan.runs:
            stand_in(run, plan.known)

    def campaign(plan: Plan) -> int:
        if plan.scans:
            from piezo_ros.experiment.raster.offline_rigs import OfflineRigs
            return run_scans(plan, options.output, OfflineRigs(), Progress())
        return run_plan(
            plan, options.output,
            lambda planned, bag: simulate_run(stand_in(planned, plan.known), bag), Progress())

    return with_plan(options, campaign, check)
