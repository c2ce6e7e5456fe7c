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

"""``piezo bag import`` and ``piezo bag export``: tables of other programs into bags, and back."""

import argparse
import math
from pathlib import Path
from typing import Any, Final

from piezo_ros.bag import STREAMS, open_recording
from piezo_ros.bag.tables.export_table import check_export_suffix, export_table
from piezo_ros.bag.tables.import_table import REST, ImportChoice, ImportedBag, import_table
from piezo_ros.cli.bag.outcome import add_output, guarded
from piezo_ros.cli.shared.bag_options import add_bag_options, bag_options
from piezo_ros.cli.shared.option_types import FILE_TIME_S, SAMPLE_PERIOD_S, Number
from piezo_ros.cli.shared.outputs import OutputPath
from piezo_ros.parameters.errors import PlanError
from piezo_ros.report.files import put_in_place

__all__ = ['add_actions']

_IMPORT_EXAMPLES: Final = """\
COLUMN is the name of a column, the last part of it, or its number, counted from 1; data@2 is the
second column of a matrix. UNIT may be left out where the file tells it: "pos [nm]", U_mV.

examples:
  piezo bag import stage.csv --columns time=t:ms voltage=U:V displacement=pos:nm -o stage
  piezo bag import stage.csv --columns voltage=1:mV displacement=2:V --sample-rate-hz 20e3 \\
      --scale voltage=15 displacement=2.5 --zero displacement=rest -o stage
  piezo bag import stage.tdms --columns voltage=Drive:V displacement=Cap:nm -o stage
  piezo bag import scan.csv -o scan        (as piezo bag export has written it)
"""
_FACTOR: Final = Number(-1e12, 1e12)  # of a scale, and a zero
_RATE_HZ: Final = Number(1e-3, 1e9, 'Hz')


def add_actions(kinds: Any) -> None:
    """Describe the arguments of these actions."""
    _add_import(kinds.add_parser(
        'import', help='a table of another program as a bag: CSV, MAT, HDF5, TDMS, NumPy, Parquet',
        epilog=_IMPORT_EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter))
    export = kinds.add_parser(
        'export', help='aligned samples as CSV, MAT, HDF5, NumPy or Parquet, by the suffix of FILE')
    export.add_argument('bag', type=Path, metavar='BAG')
    add_bag_options(export)
    add_output(export, check_name=check_export_suffix)
    export.set_defaults(function=lambda options: guarded(_export, options))


def _add_import(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('table', type=Path, metavar='FILE')
    parser.add_argument(
        '-o', '--output', type=Path, action=OutputPath, required=True, metavar='BAG')
    parser.add_argument(
        '--columns', action='extend', nargs='+', default=[], metavar='STREAM=COLUMN[:UNIT]',
        help=f'which column is the time and which is which stream: time, {", ".join(STREAMS)} '
        '(default: the columns of an exported bag)')
    parser.add_argument(
        '--scale', action='extend', nargs='+', default=[], metavar='STREAM=FACTOR',
        help='multiply a stream: the gain of an amplifier of which the input was recorded, the '
        'micrometres per volt of a sensor')
    parser.add_argument(
        '--zero', action='extend', nargs='+', default=[], metavar='STREAM=VALUE',
        help='what of a stream is the operating point, in V or um before --scale; '
        f"'{REST}': its mean before the voltage begins to move")
    period = parser.add_mutually_exclusive_group()
    period.add_argument(
        '--sample-period-s', type=SAMPLE_PERIOD_S, metavar='T', help='where no column is the time')
    period.add_argument('--sample-rate-hz', type=_RATE_HZ, metavar='F', help='the same')
    parser.add_argument(
        '--resample', action='store_true',
        help='interpolate at even times, of the sample period if one is given')
    parser.add_argument(
        '--from-s', type=FILE_TIME_S, default=-math.inf, metavar='T',
        help='leave out the rows before this time of the file')
    parser.add_argument(
        '--to-s', type=FILE_TIME_S, default=math.inf, metavar='T',
        help='leave out the rows from this time of the file on')
    parser.add_argument(
        '--allow-loss', action='store_true',
        help='take rows without a displacement, which are then left out of fits; exit 3')
    parser.set_defaults(function=lambda options: guarded(_import, options))


def _assignments(option: str, words: list[str]) -> dict[str, str]:
    """Return what ``NAME=VALUE`` words say."""
    assigned: dict[str, str] = {}
    for word in words:
        name, equals, value = word.partition('=')
        if not (equals and name and value):
            raise PlanError(f'{option}: {word!r} is not STREAM=VALUE')
        if name in assigned:
            raise PlanError(f'{option}: {name!r} is given twice')
        assigned[name] = value
    return assigned


def _number(option: str, name: str, text: str, also: str = '') -> float:
    try:
        return _FACTOR(text)
    except argparse.ArgumentTypeError as error:
        raise PlanError(f'{option}: {name} {error}{also}') from None


def _choice(options: argparse.Namespace) -> ImportChoice:
    period_s = options.sample_period_s
    if options.sample_rate_hz:
        period_s = 1.0 / options.sample_rate_hz
    scales = {
        name: _number('--scale', name, text)
        for name, text in _assignments('--scale', options.scale).items()}
    for name, scale in scales.items():
        if scale == 0.0:
            raise PlanError(f'--scale: {name} is 0, it must be another number')
    return ImportChoice(
        _assignments('--columns', options.columns), scales,
        {name: text if text == REST else _number('--zero', name, text, f" or '{REST}'")
         for name, text in _assignments('--zero', options.zero).items()},
        period_s, options.resample, options.from_s, options.to_s, options.allow_loss)


def _import(options: argparse.Namespace) -> tuple[str, ...]:
    imported = import_table(options.table, options.output, _choice(options))
    print(_summary(imported))
    return imported.lost


def _summary(imported: ImportedBag) -> str:
    period_s, samples = imported.sample_period_s, imported.samples
    lines = [
        f'{samples} samples every {period_s:g} s ({1.0 / period_s:g} Hz), {samples * period_s:g} s']
    for stream, (column, lowest, highest) in imported.streams.items():
        unit = 'V' if STREAMS[stream] == 'v' else STREAMS[stream]
        lines.append(f'  {stream:13}{lowest:.4g} … {highest:.4g} {unit}, from {column}')
    lines += [*imported.notes, f'bag: {imported.path}']
    return '\n'.join(lines)


def _export(options: argparse.Namespace) -> tuple[str, ...]:
    run = open_recording(options.bag, **bag_options(options))
    # Half a table would pass for a whole one.
    with put_in_place(options.output) as unfinished:
        export_table(run, unfinished, options.output.suffix)
    print(f'{run.samples} samples: {options.output}')
    return run.lost
