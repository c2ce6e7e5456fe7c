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

"""``piezo check``: a node against the contract of its topics, a plan against its rig."""

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterable

    from piezo_ros.contract.topics import Finding
    from piezo_ros.hardware.checks.device_check import DeviceFinding

__all__ = ['add_arguments']

ROLES: Final = ('plant', 'compensator', 'controller')
_EXAMPLES: Final = """\
examples:
  piezo check plant                              the plant that runs, alone, in this domain
  piezo check plant --start my_driver --port 3   start my_driver afresh for every fault
  piezo check plant --ahead                      one that plays whole runs, as hardware_plant does
  piezo check controller --namespace rig_a --sample-period-s 1e-4
  piezo check config/experiments/demo.yaml       travel, rails, slew, average current of a plan
  piezo check device --parameters stage.yaml     a device against its protocol

A plant is driven with a sine of --amplitude around its operating point, for some 150 samples.
Blocks that must be refused are sent in between, NaN among them: a driver that takes them drives
its hardware with them.
"""
_LOOK_AROUND_S: Final = 3.5  # discovery may tell of one node seconds before another
_WORDS: Final = {True: 'ok', False: 'WRONG', None: 'unknown'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    parser.epilog = _EXAMPLES
    parser.add_argument(
        'what', metavar='plant|compensator|controller|device|PLAN',
        help='the kind of node, the device of --parameters, or a plan file (YAML)')
    parser.add_argument(
        '--parameters', type=Path, metavar='FILE',
        help='parameter file with the plant that has the device to check')
    parser.add_argument(
        '--yes', action='store_true', help='drive a real device without asking')
    parser.add_argument('--namespace', default='', metavar='NS', help='namespace of the node')
    parser.add_argument(
        '--amplitude', type=float, default=0.1, metavar='A',
        help='what the node is driven with, V or um (default: 0.1)')
    parser.add_argument(
        '--sample-period-s', type=float, metavar='T',
        help='sample period (default: that of the plant, 1e-5 for the others)')
    parser.add_argument(
        '--discovery-s', type=float, default=15.0, metavar='T',
        help='how long the node may take to appear (default: 15)')
    parser.add_argument(
        '--patience-s', type=float, default=10.0, metavar='T',
        help='how long an answer may take (default: 10)')
    parser.add_argument(
        '--watchdog-s', type=float, default=5.0, metavar='T',
        help='how long the plant may go on without voltage (default: 5)')
    parser.add_argument(
        '--ahead', action='store_true',
        help='send the whole run first, to a plant that plays it by the clock of a device')
    parser.add_argument(
        '--start', nargs=argparse.REMAINDER, metavar='COMMAND', default=[],
        help='start the node by this command, afresh for every fault; all words behind it are its '
        'own')
    parser.set_defaults(function=_check)


def _check(options: argparse.Namespace) -> int:
    if options.what in ROLES:
        return _check_node(options)
    if options.what == 'device':
        return _check_device(options)
    if options.start:
        print(
            f'piezo: {options.what} is none of {", ".join(ROLES)}; only these are started by a '
            'command', file=sys.stderr)
        return 2
    return _check_plan(Path(options.what))


def _check_node(options: argparse.Namespace) -> int:
    try:
        from piezo_ros.contract.session import check_command, check_running
        from piezo_ros.contract.topics import CheckSettings
    except ImportError as error:
        print(f'piezo check {options.what} needs ROS 2 ({error})', file=sys.stderr)
        return 1
    if options.ahead and options.what != 'plant':
        print(f'piezo: --ahead is for plant, not for {options.what}', file=sys.stderr)
        return 2
    period_s = options.sample_period_s
    if period_s is None and options.what != 'plant':
        period_s = 1e-5
    settings = CheckSettings(
        options.amplitude, period_s, options.discovery_s, options.patience_s, options.watchdog_s,
        0.0 if options.start else _LOOK_AROUND_S, options.ahead)
    if options.start:
        try:
            findings = check_command(
                options.what, options.start, settings,
                lambda what: print(f'checking: {what}', file=sys.stderr))
        except OSError as error:
            print(f'piezo: cannot start {options.start[0]}: {error.strerror}', file=sys.stderr)
            return 1
    else:
        findings = check_running(options.what, options.namespace, settings)
    return _tell(findings)


def _check_device(options: argparse.Namespace) -> int:
    from piezo_ros.cli.shared.drive_question import ask_to_drive
    from piezo_ros.hardware.checks.device_check import check_device
    from piezo_ros.hardware.chosen_device import choose_device
    from piezo_ros.hardware.device import DeviceError
    from piezo_ros.interruption import holding_interruption
    from piezo_ros.parameters.errors import PlanError
    from piezo_ros.parameters.hardware_file import read_hardware
    if options.parameters is None:
        print('piezo: give --parameters FILE, which tells the device', file=sys.stderr)
        return 2
    period_s = 1e-5 if options.sample_period_s is None else options.sample_period_s
    if not 0.0 < period_s < math.inf:
        raise PlanError(f'--sample-period-s is {period_s}, it must be positive and finite')
    hardware = read_hardware(options.parameters)
    if hardware.is_real and not options.yes:
        ask_to_drive(f'{hardware.device} {hardware.output_channel}')
    try:
        device = choose_device(hardware.device, hardware.to_mapping())
        most_v = device.constraints.highest_voltage_v
        if not 0.0 < options.amplitude <= most_v:
            raise PlanError(
                f'--amplitude is {options.amplitude} V, it must be above 0, and the rails allow '
                f'{most_v:g} V')
        with holding_interruption() as interruption:  # The output is at rest before it raises.
            findings = [*check_device(
                device, period_s, options.amplitude, interruption.released)]
        return _tell(findings)
    except DeviceError as error:
        print(f'piezo: {error}', file=sys.stderr)
        return 1


def _tell(findings: 'Iterable[Finding | DeviceFinding]') -> int:
    findings = list(findings)
    for finding in findings:
        detail = f': {finding.detail}' if finding.detail else ''
        print(f'{_WORDS[finding.right]:8} {finding.what}{detail}')
    wrong = sum(finding.right is False for finding in findings)
    unknown = sum(finding.right is None for finding in findings)
    print(
        f'{len(findings)} checks, {wrong} wrong' + (f', {unknown} unknown' if unknown else ''))
    return 1 if wrong else 0


def _check_plan(path: Path) -> int:
    if not path.is_file():
        print(
            f'piezo: {path} is neither {", ".join(ROLES)} nor a plan file', file=sys.stderr)
        return 2
    from piezo_ros.experiment.plan import read_plan
    from piezo_ros.experiment.plan.device_limits import DeviceDemand, check_device_plan
    from piezo_ros.experiment.plan.rig_limits import Demand, check_plan
    plan = read_plan(path)
    demands: list[Demand | DeviceDemand]
    if plan.scans:
        from piezo_ros.experiment.raster.motions import check_scans
        demands = [*check_scans(plan.scans)]
    else:
        demands = [*check_plan(plan), *check_device_plan(plan)]
    for demand in demands:
        print(demand.text)
    beyond = {demand.name for demand in demands if demand.beyond}
    runs = {demand.name for demand in demands}
    print(f'{len(runs)} runs, {len(beyond)} beyond what the rig can do')
    return 1 if beyond else 0
