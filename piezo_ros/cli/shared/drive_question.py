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

"""What comes before a plan drives a device: its limits are checked, and its user is asked."""

import sys

from piezo_ros.experiment.plan import Plan
from piezo_ros.experiment.plan.device_limits import check_device_plan
from piezo_ros.parameters.errors import PlanError

__all__ = ['ask_to_drive', 'check_devices']


def check_devices(plan: Plan, *, is_composed: bool, is_agreed: bool) -> None:
    """
    Refuse a plan that its devices cannot do, and ask once before real ones are driven.

    Parameters
    ----------
    plan : Plan
        The plan.
    is_composed : bool
        Whether the nodes shall share one process.
    is_agreed : bool
        Whether the user has agreed already (``--yes``).

    Raises
    ------
    PlanError
        If something is asked that is beyond a limit, or the user does not agree.

    """
    if is_composed:
        raise PlanError(
            f'{plan.path}: a plant with a device has a process of its own; leave --composed and '
            '--keep out')
    for demand in check_device_plan(plan):
        if demand.beyond:
            raise PlanError(f'{plan.path}: {demand.name}: {demand.beyond_text}')
    devices = dict.fromkeys(
        f'{run.hardware.device} {run.hardware.address}'.strip() for run in plan.runs
        if run.hardware and run.hardware.is_real)
    if devices and not is_agreed:
        ask_to_drive(f'{len(plan.runs)} runs on {", ".join(devices)}')


def ask_to_drive(what: str) -> None:
    """
    Ask on the terminal whether a real output may be driven.

    Raises
    ------
    PlanError
        If the answer is not yes, or there is no terminal to ask on.

    """
    question = f'{what} will drive a real output'
    if not (sys.stdin and sys.stdin.isatty()):
        raise PlanError(f'{question}: give --yes, there is no terminal to ask on')
    print(f'{question}. Continue? [y/N] ', end='', file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ('y', 'yes'):
        raise PlanError('not driven: the answer was not y')
