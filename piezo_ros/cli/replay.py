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

import numpy as np

from piezo_ros.bag import BagError, read
from piezo_ros.cli.shared.bag_options import add_bag_options, bag_options
from piezo_ros.cli.shared.exit_codes import EXIT_DONE, EXIT_FAILED, EXIT_LOSS
from piezo_ros.cli.shared.given_options import refuse_without_effect
from piezo_ros.cli.shared.option_types import Number
from piezo_ros.cli.shared.outputs import OutputDirectory
from piezo_ros.control import SCHEMES, ControllerParameters
from piezo_ros.experiment.model_file import missing_of_model
from piezo_ros.experiment.output_directory import prepare_directory
from piezo_ros.experiment.plan.automatic import AUTO
from piezo_ros.experiment.plan.run_entry import checked_parameters
from piezo_ros.model import (
    CompensatorParameters,
    DynamicsParameters,
    HysteresisParameters,
    ParameterError,
    ParameterSet,
    RigParameters,
)
from piezo_ros.parameters.errors import PlanError, failure_text
from piezo_ros.parameters.parameter_file import read_parameter_file

if TYPE_CHECKING:
    from piezo_ros.bag import Run
    from piezo_ros.experiment.run_replay import ReplayResult
    from piezo_ros.report.analysis.replayed_run import ReplayedRun

__all__ = ['add_arguments']

_EXAMPLES: Final = """\
examples:
  piezo replay out/demo/bags/000_fb_triangle_1um_300hz --scheme fbff
  piezo replay out/demo/bags/002_fbff_triangle_1um_300hz --controller tuned.yaml -o out/replay
  piezo replay out/demo/bags/002_fbff_triangle_1um_300hz --scheme auto --kp 0.5 --ki 4000
  piezo replay recording --controller tuned.yaml --compensator compensator.yaml \
      --trajectory trajectory.yaml --plant data_sheet.yaml
"""
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
    parser.add_argument(
        '--scheme', choices=(*SCHEMES, AUTO),
        help=f'another scheme; {AUTO}: of ff, fbff and fb the one that errs least in the replay')
    for option, gain, most in (('kp', 'kP', 1e6), ('ki', 'kI, 1/s', 1e9)):
        parser.add_argument(
            f'--{option}', type=Number(0.0, most), metavar='GAIN', help=f'another gain {gain}')
    parser.add_argument(
        '-o', '--output', type=Path, action=OutputDirectory, metavar='DIR',
        help='directory of a page with recorded beside replayed, and their difference')
    parser.add_argument('--force', action='store_true', help='replace an earlier output')
    add_bag_options(parser)
    parser.set_defaults(function=_replay)


def _replay(options: argparse.Namespace) -> int:
    if options.output is None:
        refuse_without_effect(options, ['force'], 'without -o')
    try:
        run = read(options.bag, **bag_options(options))
        result, others = _results(run, options)
        _refuse_what_had_no_effect(result, options)
        print(_table(result))
        if others:
            print(_chosen(result, others))
        print(_origins(result, options))
        report = _report(result, options) if options.output is not None else None
    except ParameterError as error:
        raise PlanError(str(error)) from None
    except PlanError:
        raise
    except (BagError, ValueError, OSError) as error:
        print(f'piezo: {failure_text(error)}', file=sys.stderr)
        return EXIT_FAILED
    print('next: -o DIR draws both runs and their difference' if report is None
          else f'report: {report}')
    if _warning(result):
        print(f'piezo: warning: {_warning(result)}', file=sys.stderr)
    for loss in run.lost:
        print(f'piezo: {run.path}: {loss}', file=sys.stderr)
    return EXIT_LOSS if run.lost else EXIT_DONE


def _refuse_what_had_no_effect(result: 'ReplayResult', options: argparse.Namespace) -> None:
    if 'dynamics' not in result.origins or result.origins['dynamics'] != 'model':
        refuse_without_effect(
            options, ['trajectory'], 'where the bag or --plant tells the dynamics of the rig')
    if result.controller.scheme in ('ff', 'open_loop') and options.scheme != AUTO:
        refuse_without_effect(
            options, ['kp', 'ki'], f'under the scheme {result.controller.scheme}, which has no '
            'feedback')


def _results(
    run: 'Run', options: argparse.Namespace,
) -> tuple['ReplayResult', dict[str, 'ReplayResult']]:
    """Return the replay, and those of all schemes where the best one is asked for."""
    from piezo_ros.experiment.run_replay import replay

    def under(scheme: str | None) -> 'ReplayResult':
        return replay(
            run, scheme=scheme, controller=_controller(options),
            compensator=_replaced(options.compensator, 'compensator', CompensatorParameters),
            plant=_replaced(options.plant, 'plant', RigParameters),
            hysteresis=_model(options.compensator, 'compensator', HysteresisParameters),
            dynamics=_model(options.trajectory, 'trajectory', DynamicsParameters))
    if options.scheme != AUTO:
        return under(options.scheme), {}
    others = {scheme: under(scheme) for scheme in SCHEMES if scheme != 'open_loop'}
    return min(others.values(), key=lambda each: _both(each).nrmse_percent()[1]), others


def _controller(options: argparse.Namespace) -> dict[str, Any] | None:
    """Return what is given of the controller, by a file and by options."""
    values = _replaced(options.controller, 'controller', ControllerParameters) or {}
    for option, name in (('kp', 'proportional_gain'), ('ki', 'integral_gain_per_s')):
        gain = getattr(options, option)
        if gain is not None:
            try:
                ControllerParameters.from_mapping({name: gain})
            except ParameterError as error:
                raise PlanError(f'--{option}: {error}') from None
            values[name] = gain
    return values or None


def _both(result: 'ReplayResult') -> 'ReplayedRun':
    """Return the samples that both runs have; errors are told of their second half."""
    from piezo_ros.report.analysis.replayed_run import ReplayedRun
    run, streams = result.recorded, result.streams
    # Streams of a bag may begin later than its reference, with which the replay begins.
    start = run.start_index
    stop = min(start + run.samples, streams.reference_um.size)
    replayed, recorded = slice(start, stop), slice(0, stop - start)
    time_s = np.asarray(run.sample_period_s * np.arange(start, stop), dtype=np.float64)
    return ReplayedRun(
        time_s, streams.reference_um[replayed],
        (run.displacement_um[recorded], streams.displacement_um[replayed]),
        (run.voltage_v[recorded], streams.voltage_v[replayed]),
        slice((stop - start) // 2, stop - start))


def _table(result: 'ReplayResult') -> str:
    """Return both runs' errors over the second half, where the transients of the start are over."""
    both = _both(result)
    replaced = ', '.join(result.overridden) or 'nothing'
    start = result.recorded.start_index
    first, last = start + both.scored.start, start + both.scored.stop - 1
    lines = [
        f'replaced: {replaced}; samples {first} … {last}',
        f'{"":10}{"NRMSE %":>10}{"max error um":>14}{"max |u| V":>12}']
    for name, percent, error_um, voltage_v in zip(
            ('recorded', 'replayed'), both.nrmse_percent(), both.max_error_um(),
            both.max_voltage_v(), strict=True):
        lines.append(f'{name:10}{percent:10.3f}{error_um:14.4f}{voltage_v:12.4f}')
    return '\n'.join(lines)


def _chosen(result: 'ReplayResult', others: dict[str, 'ReplayResult']) -> str:
    """Return the errors of all schemes, and which one was taken."""
    errors = ', '.join(
        f'{scheme} {_both(each).nrmse_percent()[1]:.3f} %' for scheme, each in others.items())
    return f'scheme auto: {result.controller.scheme} errs least of {errors}'


def _warning(result: 'ReplayResult') -> str:
    """Return why the replay is not to be trusted as it is, '' where it gives the recorded run."""
    if not result.same_samples or result.is_faithful:
        return ''
    return (
        'the nodes of the bag do not give the recorded run again: '
        f'{dict(result.same_samples)} samples are the same')


def _report(result: 'ReplayResult', options: argparse.Namespace) -> Path:
    from piezo_ros.parameters.provenance import software_versions
    from piezo_ros.report.analysis.replay_page import write_replay_page
    prepare_directory(options.output, force=options.force)
    replaced = ', '.join(result.overridden) or 'nothing'
    law = result.controller
    faith = _warning(result) or (
        'The nodes of the bag give the recorded samples again, bit for bit: the rig of the replay '
        'is that of the recording.' if result.same_samples
        else 'The bag does not tell all of its nodes: how near the rig of the replay is to the '
        'recorded one is not known.')
    replayed = (
        f'Replayed: {law.scheme}, kP {law.proportional_gain:g}, kI '
        f'{law.integral_gain_per_s:g} 1/s; {_origins(result, options)}.')
    return write_replay_page(
        options.output, title=f'Replay of {options.bag.name}', run=_both(result),
        remarks=[f'Replaced: {replaced}.', replayed, f'{faith[0].upper()}{faith[1:]}'],
        software=software_versions(), command=' '.join(['piezo', *sys.argv[1:]]))


def _replaced(
    path: Path | None, node: str, parameter_set: type[ParameterSet],
) -> dict[str, Any] | None:
    """Return what a file says of a node; what it does not say stays as recorded."""
    if path is None:
        return None
    sections = read_parameter_file(path, [node])
    if node not in sections:
        raise PlanError(f'{path} has no section for {node}')
    checked_parameters(str(path), node, sections[node])
    known = parameter_set.names()
    return {name: value for name, value in sections[node].items() if name in known}


def _model(path: Path | None, node: str, parameter_set: type[_Set]) -> _Set | None:
    """Return the model in a file, None where it does not tell the whole of it."""
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
