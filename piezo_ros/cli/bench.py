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

"""``piezo bench``: how fast the graph, the kernels and the bags are, as ratios within one run."""

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from piezo_ros.cli.progress import Progress

if TYPE_CHECKING:
    from piezo_ros.experiment.benchmark import Change, Measurement, Ratio

__all__ = ['add_command']

_PICTURES: Final = ('.svg', '.png')
_EXAMPLES: Final = """\
examples:
  piezo bench
  piezo bench --only kernels,bag --rounds 9
  piezo bench --json today.json --compare docs/bench/reference.json
  piezo bench --list
  piezo bench --draw docs/bench/reference.json -o reference.svg
"""


def add_command(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        'bench', help='loops/s composed and separate beside the bare transport; kernels, bags, '
        'fits', epilog=_EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--rounds', type=int, default=5, metavar='N', help='rounds (default: 5)')
    parser.add_argument(
        '--only', default='', metavar='NAMES',
        help='groups or single quantities, separated by commas; --list tells them')
    parser.add_argument(
        '--list', action='store_true', help='list groups and quantities, measure nothing')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write all values here')
    parser.add_argument(
        '--append', action='store_true',
        help='more rounds for the file of --json, where it is there already')
    parser.add_argument(
        '--compare', type=Path, metavar='FILE',
        help='name every ratio that is worse by more than 15 %% than in this earlier --json; '
        'exit 1 if there is one')
    parser.add_argument(
        '--draw', type=Path, metavar='FILE',
        help='measure nothing, draw the ratios of an earlier --json; needs -o')
    parser.add_argument(
        '-o', '--output', type=Path, metavar='PICTURE', help='picture of --draw, .svg or .png')
    parser.set_defaults(function=_bench)


def _bench(options: argparse.Namespace) -> int:
    from piezo_ros.experiment.benchmark import (
        BenchmarkError,
        benchmark_record,
        changes,
        check_continues,
        chosen,
        joined,
        read_record,
        record_table,
        take_rounds,
    )
    try:
        if options.rounds < 1:
            raise BenchmarkError(f'--rounds is {options.rounds}, it must be at least 1')
        if (options.draw is None) != (options.output is None):
            raise BenchmarkError('--draw and -o belong together')
        if options.output and options.output.suffix not in _PICTURES:
            raise BenchmarkError(
                f'-o is {options.output}, it must end in {" or ".join(_PICTURES)}')
        if options.draw:
            return _draw(read_record(options.draw), options.output)
        table, ratios, without = _everything()
        names = [name.strip() for name in options.only.split(',') if name.strip()]
        if options.list:
            _list(table)
            return 0
        measurements = chosen(table, names)
        earlier = read_record(options.compare) if options.compare else None
        rounds_before = None
        if options.append:
            if options.json is None:
                raise BenchmarkError('--append needs --json')
            rounds_before = read_record(options.json) if options.json.exists() else None
            if rounds_before:
                check_continues(rounds_before, measurements)  # not after minutes of measuring
    except BenchmarkError as error:
        print(f'piezo: {error}', file=sys.stderr)
        return 2
    if without:
        print(f'piezo: {without}', file=sys.stderr)
    progress = Progress()
    readings = take_rounds(measurements, options.rounds, progress.announce)
    progress.end()
    rounds = options.rounds
    if rounds_before:
        try:
            readings = joined(rounds_before, measurements, readings)
        except BenchmarkError as error:
            print(f'piezo: {error}', file=sys.stderr)
            return 1
        rounds += rounds_before['rounds']
    record = benchmark_record(measurements, ratios, readings, rounds)
    if options.json:
        options.json.write_text(json.dumps(record, indent=2) + '\n', encoding='utf-8')
    print(record_table(record))
    worse = _report_changes(changes(record, earlier)) if earlier else False
    return 1 if worse or readings.failed else 0


def _everything() -> 'tuple[list[Measurement], list[Ratio], str]':
    """Return all measurements, all ratios, and what is left out without ROS."""
    from piezo_ros.experiment.bag_speed import BAG_RATIOS, BAGS
    from piezo_ros.experiment.fit_speed import FIT_RATIOS, FITS
    from piezo_ros.experiment.kernel_speed import KERNEL_RATIOS, KERNELS, YARDSTICKS
    from piezo_ros.experiment.sweep_speed import SWEEP_RATIOS, SWEEPS
    table = [*YARDSTICKS, *KERNELS, *BAGS, *FITS, *SWEEPS]
    ratios = [*KERNEL_RATIOS, *BAG_RATIOS, *FIT_RATIOS, *SWEEP_RATIOS]
    try:
        from piezo_ros.nodes.live_speed import LIVE, LIVE_RATIOS
    except ImportError as error:
        return table, ratios, f'nothing of live nodes is measured, that needs ROS 2 ({error})'
    return [*table, *LIVE], [*LIVE_RATIOS, *ratios], ''


def _list(table: 'list[Measurement]') -> None:
    group = ''
    for entry in table:
        if entry.group != group:
            group = entry.group
            print(group)
        missing = entry.missing()
        for quantity in entry.quantities:
            print(f'  {quantity.name:34}{quantity.unit:12}{missing}'.rstrip())


def _report_changes(found: 'list[Change]') -> bool:
    """Print how ratios compare with earlier ones; whether one is worse."""
    print(f'{"compared":36}{"before":>12}{"now":>12}')
    for change in found:
        verdict = '  WORSE' if change.worse else ''
        print(f'  {change.name:34}{change.before:12.3g}{change.now:12.3g}{verdict}')
    worse = [change.name for change in found if change.worse]
    print(f'{len(worse)} of {len(found)} ratios are worse by more than 15 %')
    return bool(worse)


def _draw(record: dict[str, Any], output: Path) -> int:
    from piezo_ros.report.figures.benchmark import bench_figure
    from piezo_ros.report.figures.export import png, svg
    figure = bench_figure(record)
    if output.suffix == '.png':
        output.write_bytes(png(figure))
    else:
        output.write_text(svg(figure, 'bench'), encoding='utf-8')
    print(f'picture: {output}')
    return 0
