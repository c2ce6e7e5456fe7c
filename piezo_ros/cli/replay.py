"""``piezo replay``: what a recorded run would have been with other gains, models or schemes."""

import argparse
import sys
from pathlib import Path
from typing import Any

from piezo_ros.bag import BagError, read
from piezo_ros.control import SCHEMES, ControllerParameters
from piezo_ros.experiment.errors import PlanError
from piezo_ros.experiment.parameter_file import read_parameter_file
from piezo_ros.experiment.replay import replay
from piezo_ros.model import (
    HysteresisParameters,
    ParameterError,
    ParameterSet,
    RigParameters,
)
from piezo_ros.report.metrics import nrmse

__all__ = ['add_command']

_EXAMPLES = """\
examples:
  piezo replay out/demo/bags/000_fb_triangle_1um_300hz --scheme fbff
  piezo replay out/demo/bags/002_fbff_triangle_1um_300hz --controller tuned.yaml
"""
_PERCENT = 100.0


def add_command(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        'replay', help='what a recorded run would have been', epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('bag', type=Path, metavar='BAG')
    for node in ('controller', 'compensator', 'plant'):
        parser.add_argument(
            f'--{node}', type=Path, metavar='FILE', help=f'another {node} (parameter file)')
    parser.add_argument('--scheme', choices=SCHEMES, help='another scheme')
    parser.add_argument('--namespace', metavar='NS', help='the rig, where the bag holds several')
    parser.set_defaults(function=_replay)


def _replay(options: argparse.Namespace) -> int:
    try:
        run = read(options.bag, namespace=options.namespace)
        result = replay(
            run, scheme=options.scheme,
            controller=_replaced(options.controller, 'controller', ControllerParameters),
            compensator=_replaced(options.compensator, 'compensator', HysteresisParameters),
            plant=_replaced(options.plant, 'plant', RigParameters))
    except (BagError, PlanError, ParameterError) as error:
        print(f'piezo: {error}', file=sys.stderr)
        return 1
    if result.same_samples and not result.is_faithful:
        print(
            'piezo: warning: the stages of the bag do not give the recorded run again: '
            f'{dict(result.same_samples)} samples are the same', file=sys.stderr)
    # The transients of the start are over in the second half.
    samples = min(run.samples, result.streams.reference_um.size)
    half = slice(samples // 2, samples)
    reference_um = result.streams.reference_um[half]
    rows = (
        ('recorded', run.displacement_um[half], run.voltage_v[half]),
        ('replayed', result.streams.displacement_um[:samples][half],
         result.streams.voltage_v[half]),
    )
    replaced = ', '.join(result.overridden) or 'nothing'
    print(f'replaced: {replaced}; second half of {samples} samples')
    print(f'{"":10}{"NRMSE %":>10}{"max error um":>14}{"max |u| V":>12}')
    for name, displacement_um, voltage_v in rows:
        print(
            f'{name:10}{_PERCENT * nrmse(reference_um, displacement_um):10.3f}'
            f'{abs(reference_um - displacement_um).max():14.4f}{abs(voltage_v).max():12.4f}')
    return 0


def _replaced(
    path: Path | None, node: str, parameter_set: type[ParameterSet],
) -> dict[str, Any] | None:
    """Return what a file says of a node; what it does not say stays as recorded."""
    if path is None:
        return None
    sections = read_parameter_file(path, [node])
    if node not in sections:
        raise PlanError(f'{path} has no section for {node}')
    known = parameter_set().to_mapping()
    return {name: value for name, value in sections[node].items() if name in known}
