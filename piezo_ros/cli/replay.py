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

"""``piezo replay``: what a recorded run would have been with other gains, models or schemes."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

from piezo_ros.bag import BagError, read
from piezo_ros.cli.shared.bag_options import add_bag_options, bag_options
from piezo_ros.control import SCHEMES, ControllerParameters
from piezo_ros.model import (
    CompensatorParameters,
    DynamicsParameters,
    HysteresisParameters,
    ParameterError,
    ParameterSet,
    RigParameters,
)
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.parameter_file import read_parameter_file
from piezo_ros.report.metrics import nrmse

if TYPE_CHECKING:
    from piezo_ros.experiment.replay import ReplayResult

__all__ = ['add_arguments']

_EXAMPLES: Final = """\
examples:
  piezo replay out/demo/bags/000_fb_triangle_1um_300hz --scheme fbff
  piezo replay out/demo/bags/002_fbff_triangle_1um_300hz --controller tuned.yaml
  piezo replay recording --controller tuned.yaml --compensator compensator.yaml \
      --trajectory trajectory.yaml --plant data_sheet.yaml
"""
_PERCENT: Final = 100.0
_Set = TypeVar('_Set', bound=ParameterSet)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    parser.epilog = _EXAMPLES
    parser.add_argument('bag', type=Path, metavar='BAG')
    for node in ('controller', 'compensator', 'plant'):
        parser.add_argument(
            f'--{node}', type=Path, metavar='FILE', help=f'another {node} (parameter file)')
    parser.add_argument(
        '--trajectory', type=Path, metavar='FILE',
        help='dynamics of a rig of which neither bag nor --plant tells them; its hysteresis is '
        'that of --compensator then')
    parser.add_argument('--scheme', choices=SCHEMES, help='another scheme')
    add_bag_options(parser)
    parser.set_defaults(function=_replay)


def _replay(options: argparse.Namespace) -> int:
    from piezo_ros.experiment.replay import replay
    try:
        run = read(options.bag, **bag_options(options))
        result = replay(
            run, scheme=options.scheme,
            controller=_replaced(options.controller, 'controller', ControllerParameters),
            compensator=_replaced(options.compensator, 'compensator', CompensatorParameters),
            plant=_replaced(options.plant, 'plant', RigParameters),
            hysteresis=_model(options.compensator, 'compensator', HysteresisParameters),
            dynamics=_model(options.trajectory, 'trajectory', DynamicsParameters))
        print(_table(result))
        print(_origins(result, options))
    except ParameterError as error:
        raise PlanError(str(error)) from None
    except PlanError:
        raise
    except (BagError, ValueError) as error:
        print(f'piezo: {error}', file=sys.stderr)
        return 1
    if result.same_samples and not result.is_faithful:
        print(
            'piezo: warning: the nodes of the bag do not give the recorded run again: '
            f'{dict(result.same_samples)} samples are the same', file=sys.stderr)
    for loss in run.lost:
        print(f'piezo: {run.path}: {loss}', file=sys.stderr)
    return 3 if run.lost else 0


def _table(result: 'ReplayResult') -> str:
    """Return both runs' errors over the second half, where the transients of the start are over."""
    run, streams = result.recorded, result.streams
    # Streams of a bag may begin later than its reference, with which the replay begins.
    stop = min(run.start_index + run.samples, streams.reference_um.size)
    half = slice(run.start_index + (stop - run.start_index) // 2, stop)
    recorded = slice(half.start - run.start_index, half.stop - run.start_index)
    reference_um = streams.reference_um[half]
    replaced = ', '.join(result.overridden) or 'nothing'
    lines = [
        f'replaced: {replaced}; samples {half.start} … {half.stop - 1}',
        f'{"":10}{"NRMSE %":>10}{"max error um":>14}{"max |u| V":>12}']
    for name, displacement_um, voltage_v in (
            ('recorded', run.displacement_um[recorded], run.voltage_v[recorded]),
            ('replayed', streams.displacement_um[half], streams.voltage_v[half])):
        lines.append(
            f'{name:10}{_PERCENT * nrmse(reference_um, displacement_um):10.3f}'
            f'{abs(reference_um - displacement_um).max():14.4f}{abs(voltage_v).max():12.4f}')
    return '\n'.join(lines)


def _replaced(
    path: Path | None, node: str, parameter_set: type[ParameterSet],
) -> dict[str, Any] | None:
    """Return what a file says of a node; what it does not say stays as recorded."""
    if path is None:
        return None
    sections = read_parameter_file(path, [node])
    if node not in sections:
        raise PlanError(f'{path} has no section for {node}')
    known = parameter_set.names()
    return {name: value for name, value in sections[node].items() if name in known}


def _model(path: Path | None, node: str, parameter_set: type[_Set]) -> _Set | None:
    """Return the model in a file, None where it does not tell the whole of it."""
    from piezo_ros.experiment.replay import missing_of_model
    values = _replaced(path, node, parameter_set)
    if values is None or missing_of_model(values, parameter_set):
        return None
    return parameter_set.from_mapping(values)


def _origins(result: 'ReplayResult', options: argparse.Namespace) -> str:
    """Return where the parts of the rig are from."""
    files = {
        'bag': 'the bag', 'plant': f'{options.plant} (--plant)'}
    models = {
        'hysteresis': f'{options.compensator} (--compensator)',
        'dynamics': f'{options.trajectory} (--trajectory)'}
    return 'rig: ' + ', '.join(
        f'{part} of {files.get(origin, models[part])}' for part, origin in result.origins.items())
