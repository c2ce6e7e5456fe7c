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

"""``piezo bag motion``: a stream of a bag as a motion that the trajectory plays."""

import argparse
import math
from pathlib import Path
from typing import Any, Final

from piezo_ros.bag import STREAMS, BagError, open_recording
from piezo_ros.cli.bag.outcome import add_output, guarded
from piezo_ros.cli.shared.bag_options import add_bag_options, bag_options
from piezo_ros.cli.shared.option_types import TIME_S
from piezo_ros.control.tables.motion_table import (
    MotionTable,
    MotionTableError,
    write_motion_table,
)
from piezo_ros.parameters.errors import PlanError
from piezo_ros.report.files import put_in_place

__all__ = ['add_actions']

_IN_UM: Final = tuple(name for name, unit in STREAMS.items() if unit == 'um')


def add_actions(kinds: Any) -> None:
    """Describe the arguments of this action."""
    motion = kinds.add_parser(
        'motion', help='a stream as a motion that the waveform file plays')
    motion.add_argument('bag', type=Path, metavar='BAG')
    add_bag_options(motion)
    add_output(motion)
    motion.add_argument(
        '--reference', choices=_IN_UM, default='reference', metavar='STREAM',
        help='stream that is the reference of the motion (default: reference)')
    motion.add_argument(
        '--command', choices=_IN_UM, metavar='STREAM',
        help='stream that is its command, which the scheme ff sends (default: none)')
    motion.add_argument(
        '--from-s', type=TIME_S, default=0.0, metavar='T', help='begin at this simulated time')
    motion.add_argument(
        '--to-s', type=TIME_S, default=math.inf, metavar='T', help='end before this simulated time')
    motion.add_argument(
        '--repeat-from-s', type=TIME_S, metavar='T',
        help='repeat for ever what is from this simulated time on (default: played once)')
    motion.set_defaults(function=lambda options: guarded(_motion, options))


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
