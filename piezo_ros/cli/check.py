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
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

from piezo_ros.cli.shared.given_options import refuse_without_effect
from piezo_ros.cli.shared.option_types import SAMPLE_PERIOD_S, WAIT_S, Number

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
  piezo check demo                               travel, rails, slew, average current of a plan
  piezo check device --parameters stage.yaml     a device against its protocol

A plant is driven with a sine of --amplitude around its operating point, for some 150 samples.
Blocks that must be refused are sent in between, NaN among them: a driver that takes them drives
its hardware with them.
"""
_AMPLITUDE: Final = Number(0.0, 1e4, 'V or um', is_above=True)
_LOOK_AROUND_S: Final = 3.5  # discovery may tell of one node seconds before another
_WORDS: Final = {True: 'ok', False: 'WRONG', None: 'unknown'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    parser.epilog = _EXAMPLES
    parser.add_argument(
        'what', metavar='plant|compensator|controller|device|PLAN',
        help='the kind of node, the device of --parameters, or a plan: a file (YAML), or the bare '
        'name of one that comes with the package')
    parser.add_argument(
        '--parameters', type=Path, metavar='FILE',
        help='parameter file with the plant that has the device to check')
    parser.add_argument(
        '--yes', action='store_true', help='drive a real device without asking')
    parser.add_argument(
        '--namespace', default='', metavar='NS', type=str,
        help='namespace of the node')
    parser.add_argument(
        '--amplitude', type=_AMPLITUDE, default=0.1, metavar='A',
        help='what the node is driven with, V or um (default: 0.1)')
    parser.add_argument(
        '--sample-period-s', type=SAMPLE_PERIOD_S, metavar='T',
        help='sample period (default: that of the plant, 1e-5 for the others)')
    parser.add_argument(
        '--discovery-s', type=WAIT_S, default=15.0, metavar='T',
        help='how long the node may take to appear (default: 15)')
    parser.add_argument(
        '--patience-s', type=WAIT_S, default=10.0, metavar='T',
        help='how long an answer may take (default: 10)')
    parser.add_argument(
        '--watchdog-s', type=WAIT_S, default=5.0, metavar='T',
        help='how long the plant may go on without voltage (default: 5)')
    parser.add_argument(
        '--ahead', action='store_true',
        help='send the whole run first, to a plant that plays it by the clock of a device')
    parser.add_argument(
        '--start', type=str, nargs=argparse.REMAINDER, metavar='COMMAND', default=[],
        help='start the node by this command, afresh for every fault; all words behind it are its '
        'own')
    parser.set_defaults(function=_check)


# Of a node that another command started, or of a device; none of them of a plan.
_OF_NODES: Final = ('namespace', 'discovery_s', 'patience_s', 'watchdog_s', 'ahead', 'start')
_OF_DEVICES: Final = ('parameters', 'yes')
_OF_BOTH: Final = ('amplitude', 'sample_period_s')


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
    return _check_plan(options.what, options)


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
    refuse_without_effect(options, _OF_DEVICES, f'on a {options.what}, which runs already')
    if options.start:
        refuse_without_effect(
            options, ['namespace'], 'beside --start, which takes a namespace of its own')
    if options.what != 'plant' or not options.start:
        refuse_without_effect(options, ['watchdog_s'], 'but on a plant behind --start')
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
    from piezo_ros.model.parameters import ParameterError
    from piezo_ros.parameters.errors import PlanError
    from piezo_ros.parameters.hardware_file import read_hardware
    refuse_without_effect(options, _OF_NODES, 'on a device')
    if options.parameters is None:
        print('piezo: give --parameters FILE, which tells the device', file=sys.stderr)
        return 2
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
                device, options.sample_period_s or 1e-5, options.amplitude,
                interruption.released)]
        return _tell(findings)
    except ParameterError as error:
        raise PlanError(f'{options.parameters}: {error}') from None
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


def _check_plan(what: str, options: argparse.Namespace) -> int:
    from piezo_ros.experiment.plan.packaged_plans import packaged_plans, plan_path
    from piezo_ros.suggestions import did_you_mean
    try:
        path = plan_path(what)
    except argparse.ArgumentTypeError:
        path = Path(what)
    if not path.is_file():
        print(
            f'piezo: {what} is neither {", ".join(ROLES)} nor a plan file'
            f'{did_you_mean(what, (*ROLES, "device", *packaged_plans()))}', file=sys.stderr)
        return 2
    refuse_without_effect(options, [*_OF_NODES, *_OF_DEVICES, *_OF_BOTH], 'on a plan')
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
