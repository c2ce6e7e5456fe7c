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

"""Command ``python -m benchmarks``: speeds of graph, kernels, bags and fits, and their ratios."""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from benchmarks.bags import BAG_RATIOS, BAGS
from benchmarks.benchmark_record import (
    Change,
    benchmark_record,
    changes,
    check_continues,
    joined,
    read_record,
    record_table,
)
from benchmarks.figure import bench_figure
from benchmarks.fits import FIT_RATIOS, FITS
from benchmarks.kernel_speeds import KERNEL_RATIOS, KERNELS
from benchmarks.measurement import BenchmarkError, Measurement, Ratio, chosen, take_rounds
from benchmarks.sweeps import SWEEP_RATIOS, SWEEPS
from benchmarks.yardsticks import YARDSTICKS
from piezo_ros.cli.shared.progress import Progress
from piezo_ros.report.figures.export import png, svg

__all__ = ['main']

EXIT_DONE, EXIT_FAILED, EXIT_USAGE = range(3)
_PICTURES: Final = ('.svg', '.png')
_EXAMPLES: Final = """\
examples:
  python -m benchmarks
  python -m benchmarks --only kernels,bag --rounds 9
  python -m benchmarks --json today.json --compare docs/bench/reference.json
  python -m benchmarks --list
  python -m benchmarks --draw docs/bench/reference.json -o reference.svg
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        ``sys.argv[1:]`` by default.

    Returns
    -------
    int
        0 done, 1 a measurement failed or a ratio is worse, 2 usage.

    """
    options = _parser().parse_args(arguments)
    try:
        _check(options)
        if options.draw:
            return _draw(read_record(options.draw), options.output)
        if options.list:
            return _list()
        return _measure(options)
    except BenchmarkError as error:
        print(f'benchmarks: {error}', file=sys.stderr)
        return EXIT_USAGE
    except KeyboardInterrupt:
        print('benchmarks: stopped by SIGINT', file=sys.stderr)
        return EXIT_FAILED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks', epilog=_EXAMPLES,
        description='Loops per second of the composed and of the separate graph beside the bare '
        'transport; kernels, bags, fits and sweeps.',
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--rounds', type=int, default=5, metavar='N', help='rounds (default: 5)')
    parser.add_argument(
        '--only', default='', metavar='NAMES',
        help='groups or single quantities, separated by commas; see --list')
    parser.add_argument(
        '--list', action='store_true', help='list groups and quantities, measure nothing')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write all values into this file')
    parser.add_argument(
        '--append', action='store_true',
        help='add the rounds to those in the file of --json, if it exists')
    parser.add_argument(
        '--compare', type=Path, metavar='FILE',
        help='name every ratio that is worse by more than 15 %% than in the file of an earlier '
        '--json; exit 1 if there is one')
    parser.add_argument(
        '--draw', type=Path, metavar='FILE',
        help='measure nothing, draw the results in the file of an earlier --json; needs -o')
    parser.add_argument(
        '-o', '--output', type=Path, metavar='PICTURE', help='picture of --draw, .svg or .png')
    return parser


def _check(options: argparse.Namespace) -> None:
    """Raise BenchmarkError for options that contradict each other."""
    if options.rounds < 1:
        raise BenchmarkError(f'--rounds is {options.rounds}, it must be at least 1')
    if (options.draw is None) != (options.output is None):
        raise BenchmarkError('--draw and -o belong together')
    if options.output and options.output.suffix not in _PICTURES:
        raise BenchmarkError(f'-o is {options.output}, it must end in {" or ".join(_PICTURES)}')
    if options.append and options.json is None:
        raise BenchmarkError('--append needs --json')


def _measure(options: argparse.Namespace) -> int:
    """Take the rounds, write and print their record; raise BenchmarkError before the first one."""
    table, ratios, without = _everything()
    measurements = chosen(
        table, [name.strip() for name in options.only.split(',') if name.strip()])
    earlier = read_record(options.compare) if options.compare else None
    continued = read_record(options.json) if options.append and options.json.exists() else None
    if continued:
        check_continues(continued, measurements)
    if without:
        print(f'benchmarks: {without}', file=sys.stderr)
    progress = Progress()
    readings = take_rounds(measurements, options.rounds, progress.announce)
    progress.end()
    rounds = options.rounds
    if continued:
        try:
            readings = joined(continued, measurements, readings)
        except BenchmarkError as error:  # something failed that the earlier rounds have
            print(f'benchmarks: {error}', file=sys.stderr)
            return EXIT_FAILED
        rounds += continued['rounds']
    record = benchmark_record(measurements, ratios, readings, rounds)
    if options.json:
        options.json.write_text(json.dumps(record, indent=2) + '\n', encoding='utf-8')
    print(record_table(record))
    worse = _print_changes(changes(record, earlier)) if earlier else False
    return EXIT_FAILED if worse or readings.failed else EXIT_DONE


def _everything() -> tuple[list[Measurement], list[Ratio], str]:
    """Return all measurements, all ratios, and what is left out on a machine without ROS."""
    table = [*YARDSTICKS, *KERNELS, *BAGS, *FITS, *SWEEPS]
    ratios = [*KERNEL_RATIOS, *BAG_RATIOS, *FIT_RATIOS, *SWEEP_RATIOS]
    try:
        from benchmarks.live import LIVE, LIVE_RATIOS
    except ImportError as error:
        return table, ratios, f'live nodes are not measured, that needs ROS 2 ({error})'
    return [*table, *LIVE], [*LIVE_RATIOS, *ratios], ''


def _list() -> int:
    """Print every group with its quantities, and why one cannot be measured on this machine."""
    group = ''
    for entry in _everything()[0]:
        if entry.group != group:
            group = entry.group
            print(group)
        missing = entry.missing()
        for quantity in entry.quantities:
            print(f'  {quantity.name:34}{quantity.unit:12}{missing}'.rstrip())
    return EXIT_DONE


def _print_changes(found: list[Change]) -> bool:
    """Print the ratios beside the earlier ones; return whether one is worse."""
    print(f'{"compared":36}{"before":>12}{"now":>12}')
    for change in found:
        verdict = '  WORSE' if change.worse else ''
        print(f'  {change.name:34}{change.before:12.3g}{change.now:12.3g}{verdict}')
    worse = sum(change.worse for change in found)
    print(f'{worse} of {len(found)} ratios are worse by more than 15 %')
    return worse > 0


def _draw(record: dict[str, Any], output: Path) -> int:
    """Draw the results of a record as SVG or PNG."""
    figure = bench_figure(record)
    if output.suffix == '.png':
        output.write_bytes(png(figure))
    else:
        output.write_text(svg(figure, 'bench'), encoding='utf-8')
    print(f'picture: {output}')
    return EXIT_DONE


if __name__ == '__main__':
    sys.exit(main())
