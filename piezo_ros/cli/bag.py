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

"""``piezo bag``: what is in a bag, what can be saved of it, its samples as a table."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from piezo_ros.bag import STREAMS, BagError, open_recording, salvage
from piezo_ros.cli.shared.bag_options import add_bag_options, bag_options
from piezo_ros.parameters.role_parameters import full_name
from piezo_ros.report.files import put_in_place

__all__ = ['add_arguments']

_EXPORTED_AT_ONCE: Final = 100_000  # samples
_EXAMPLES: Final = """\
examples:
  piezo bag info out/demo/bags/002_fbff_triangle_1um_300hz
  piezo bag salvage cut_bag -o whole_bag
  piezo bag export out/demo/bags/002_fbff_triangle_1um_300hz -o scan.csv
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    parser.epilog = _EXAMPLES
    actions = parser.add_subparsers(dest='action', required=True, metavar='ACTION')
    info = actions.add_parser('info', help='streams, samples, metadata')
    export = actions.add_parser('export', help='aligned samples as CSV')
    rescue = actions.add_parser('salvage', help='a whole bag of what is whole in a damaged one')
    for action in (info, export, rescue):
        action.add_argument('bag', type=Path, metavar='BAG')
    for action in (info, export):
        add_bag_options(action)
    export.add_argument('-o', '--output', type=Path, required=True, metavar='FILE')
    export.add_argument('--force', action='store_true', help='replace the file')
    rescue.add_argument('-o', '--output', type=Path, required=True, metavar='DIR')
    info.set_defaults(function=lambda options: _guarded(_info, options))
    export.set_defaults(function=_export_unless_there)
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
    for stream, summary in run.streams.items():
        print(
            f'  {stream:13}{summary.samples} samples from index {summary.start_index}, '
            f'{summary.minimum:.4g} … {summary.maximum:.4g} {STREAMS[stream]}'
            + _remapped(run.namespace, stream, summary.topic))
    for name, value in run.metadata.items():
        print(f'{name:28}{value}')
    print(f'parameters of  {", ".join(run.parameters) or "no node"}')
    for topic, why in run.facts.unlike.items():
        print(f'no stream      {topic} {why}')
    return *run.lost, *run.uneven()


def _remapped(namespace: str, stream: str, topic: str) -> str:
    return '' if topic == full_name(namespace, stream) else f', on {topic}'


def _export_unless_there(options: argparse.Namespace) -> int:
    if options.output.exists() and not options.force:
        print(f'piezo: {options.output} exists; --force replaces it', file=sys.stderr)
        return 2
    return _guarded(_export, options)


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


def _salvage(options: argparse.Namespace) -> tuple[str, ...]:
    result = salvage(options.bag, options.output)
    for topic, count in result.messages.items():
        print(f'{topic:24} {count} messages')
    print(f'saved: {result.path}')
    return result.lost
