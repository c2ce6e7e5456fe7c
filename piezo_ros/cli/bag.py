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

"""``piezo bag``: what is in a bag, what can be saved of it, its samples as a table or a motion."""

import argparse
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from piezo_ros.bag import STREAMS, BagError, open_recording, salvage
from piezo_ros.cli.shared.bag_options import add_bag_options, bag_options
from piezo_ros.cli.shared.outputs import check_output
from piezo_ros.control.tables.motion_table import (
    MotionTable,
    MotionTableError,
    write_motion_table,
)
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.role_parameters import full_name
from piezo_ros.report.files import put_in_place

__all__ = ['add_arguments']

_UNITS: Final = {'v': 'V'}  # in names units are lower case
_EXPORTED_AT_ONCE: Final = 100_000  # samples
_IN_UM: Final = tuple(name for name, unit in STREAMS.items() if unit == 'um')
_EXAMPLES: Final = """\
examples:
  piezo bag info out/demo/bags/002_fbff_triangle_1um_300hz
  piezo bag salvage cut_bag -o whole_bag
  piezo bag export out/demo/bags/002_fbff_triangle_1um_300hz -o scan.csv
  piezo bag motion out/demo/bags/002_fbff_triangle_1um_300hz --command command -o again.npz
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    parser.epilog = _EXAMPLES
    actions = parser.add_subparsers(dest='action', required=True, metavar='ACTION')
    info = actions.add_parser('info', help='streams, samples, metadata')
    export = actions.add_parser('export', help='aligned samples as CSV')
    motion = actions.add_parser(
        'motion', help='a stream as a motion that the waveform file plays')
    rescue = actions.add_parser('salvage', help='a whole bag of what is whole in a damaged one')
    for action in (info, export, motion, rescue):
        action.add_argument('bag', type=Path, metavar='BAG')
    for action in (info, export, motion):
        add_bag_options(action)
    for action in (export, motion):
        action.add_argument('-o', '--output', type=Path, required=True, metavar='FILE')
        action.add_argument('--force', action='store_true', help='replace the file')
    motion.add_argument(
        '--reference', choices=_IN_UM, default='reference', metavar='STREAM',
        help='stream that is the reference of the motion (default: reference)')
    motion.add_argument(
        '--command', choices=_IN_UM, metavar='STREAM',
        help='stream that is its command, which the scheme ff sends (default: none)')
    motion.add_argument(
        '--from-s', type=float, default=0.0, metavar='T', help='begin at this simulated time')
    motion.add_argument(
        '--to-s', type=float, default=math.inf, metavar='T', help='end before this simulated time')
    motion.add_argument(
        '--repeat-from-s', type=float, metavar='T',
        help='repeat for ever what is from this simulated time on (default: played once)')
    rescue.add_argument('-o', '--output', type=Path, required=True, metavar='DIR')
    info.set_defaults(function=lambda options: _guarded(_info, options))
    export.set_defaults(function=lambda options: _unless_there(_export, options))
    motion.set_defaults(function=lambda options: _unless_there(_motion, options))
    rescue.set_defaults(function=lambda options: _guarded(_salvage, options))


def _guarded(
    action: Callable[[argparse.Namespace], tuple[str, ...]], options: argparse.Namespace,
) -> int:
    try:
        lost = action(options)
    except BagError as error:
        print(f'piezo: {error}', file=sys.stderr)
        return 1
    for loss in lost:
        print(f'piezo: {loss}', file=sys.stderr)
    return 3 if lost else 0


def _info(options: argparse.Namespace) -> tuple[str, ...]:
    run = open_recording(options.bag, **bag_options(options))
    print(f'bag            {run.path}')
    print(f'namespace      {run.namespace}')
    print(f'sample period  {run.sample_period_s:g} s')
    print(f'common samples {run.samples} from index {run.start_index}')
    print(f'duration       {run.samples * run.sample_period_s:g} s')
    for stream, summary in run.streams.items():
        print(
            f'  {stream:13}{summary.samples} samples from index {summary.start_index}, '
            f'{summary.minimum:.4g} … {summary.maximum:.4g} '
            f'{_UNITS.get(STREAMS[stream], STREAMS[stream])}'
            + _remapped(run.namespace, stream, summary.topic))
    for name, value in run.metadata.items():
        print(f'{name:28}{value}')
    print(f'parameters of  {", ".join(run.parameters) or "no node"}')
    for topic, why in run.facts.unlike.items():
        print(f'no stream      {topic} {why}')
    return *run.lost, *run.uneven()


def _remapped(namespace: str, stream: str, topic: str) -> str:
    return '' if topic == full_name(namespace, stream) else f', on {topic}'


def _unless_there(
    action: Callable[[argparse.Namespace], tuple[str, ...]], options: argparse.Namespace,
) -> int:
    check_output(options.output, force=options.force)
    return _guarded(action, options)


def _export(options: argparse.Namespace) -> tuple[str, ...]:
    run = open_recording(options.bag, **bag_options(options))
    names = ['time_s', *(f'{stream}_{STREAMS[stream]}' for stream in run.streams)]
    # Half a table would pass for a whole one.
    with (
        put_in_place(options.output) as unfinished, unfinished.open('w', encoding='utf-8') as file,
    ):
        file.write(','.join(names) + '\n')
        for piece in run.pieces(_EXPORTED_AT_ONCE):
            # 17 significant digits: the same bits come back.
            np.savetxt(
                file, np.column_stack([getattr(piece, name) for name in names]), fmt='%.17g',
                delimiter=',')
    print(f'{run.samples} samples: {options.output}')
    return run.lost


def _motion(options: argparse.Namespace) -> tuple[str, ...]:
    if options.output.suffix != '.npz':
        raise PlanError(
            f'-o {options.output}: a motion is written as .npz, not {options.output.suffix!r}')
    names = (options.reference, *((options.command,) if options.command else ()))
    run = open_recording(options.bag, **bag_options(options), keep_not_finite=True)
    period_s, first = run.sample_period_s, run.start_index
    places = {
        name: math.ceil(round(time_s / period_s, 6)) - first
        for name, time_s in (
            ('--from-s', options.from_s), ('--to-s', options.to_s),
            ('--repeat-from-s', options.repeat_from_s))
        if time_s is not None and math.isfinite(time_s)}
    start, stop = max(places.get('--from-s', 0), 0), min(
        places.get('--to-s', run.samples), run.samples)
    if start >= stop:
        raise BagError(
            f'{options.bag} has no sample from --from-s {options.from_s:g} to --to-s '
            f'{options.to_s:g}')
    part = run.part(start, stop, streams=names)
    columns = [getattr(part, f'{name}_um')[:stop - start] for name in names]
    repeat_from = places['--repeat-from-s'] - start if '--repeat-from-s' in places else None
    try:
        table = MotionTable(
            columns[0], columns[1] if options.command else None, period_s, repeat_from)
    except MotionTableError as error:
        raise BagError(f'{options.bag}: {error}') from None
    with put_in_place(options.output) as unfinished:
        write_motion_table(unfinished, table)
    print(f'{columns[0].size} samples: {options.output}')
    return part.lost


def _salvage(options: argparse.Namespace) -> tuple[str, ...]:
    result = salvage(options.bag, options.output)
    for topic, count in result.messages.items():
        print(f'{topic:24} {count} messages')
    print(f'saved: {result.path}')
    return result.lost
