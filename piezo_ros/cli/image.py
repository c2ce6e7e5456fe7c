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
"""``piezo image``: what an image shows of two recorded axes, also of foreign bags."""

import argparse
import os
import sys
from pathlib import Path
from typing import Final

from piezo_ros.bag import BagError, Run, read
from piezo_ros.cli.shared.exit_codes import EXIT_DONE, EXIT_FAILED, EXIT_LOSS, EXIT_USAGE
from piezo_ros.cli.shared.option_types import COUNT, Number, Whole
from piezo_ros.cli.shared.outputs import OutputDirectory
from piezo_ros.experiment.output_directory import prepare_directory
from piezo_ros.parameters.errors import PlanError, failure_text
from piezo_ros.parameters.provenance import software_versions

__all__ = ['add_arguments']

_EXAMPLES: Final = """\
examples:
  piezo image fast_bag slow_bag -o out/image
  piezo image both_axes --namespaces /x /y -o out/image --pixels 512
  piezo report out/raster -o out/again           all scans of a plan
"""
_PIXELS: Final = Whole(2, 100_000)
_CENTRAL: Final = Number(0.0, 1.0, is_above=True)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    parser.epilog = _EXAMPLES
    parser.add_argument(
        'fast', type=Path, metavar='BAG_X', help='the axis that goes to and fro on each line')
    parser.add_argument(
        'slow', type=Path, nargs='?', metavar='BAG_Y',
        help='the axis that goes from line to line (default: in the same bag, in another '
        'namespace)')
    parser.add_argument(
        '-o', '--output', type=Path, action=OutputDirectory, required=True, metavar='DIR',
        help='output directory')
    parser.add_argument(
        '--force', action='store_true', help='replace an earlier output in DIR')
    parser.add_argument(
        '--pixels', type=_PIXELS, default=256, metavar='N', help='pixels of a line (default: 256)')
    parser.add_argument(
        '--central', type=_CENTRAL, default=0.8, metavar='SHARE',
        help='share of each line that is in the image, the rest is for the turns (default: 0.8)')
    parser.add_argument(
        '--namespaces', nargs=2, default=(None, None), metavar=('NS_X', 'NS_Y'),
        help='the rigs of the axes, where a bag has several')
    parser.add_argument(
        '--run', type=COUNT, metavar='N',
        help='the run, counted from 1, where a bag has several one after the other')
    parser.add_argument(
        '--allow-loss', action=argparse.BooleanOptionalAction, default=True,
        help='take what is whole of a damaged bag, say what is lost, exit 3 (default); or refuse')
    parser.set_defaults(function=_image)


def _image(options: argparse.Namespace) -> int:
    from piezo_ros.report.page.raster_report import image_table, write_raster_report
    from piezo_ros.report.scanned_image import scanned_image
    slow_bag = options.slow or options.fast
    if options.namespaces[0] == options.namespaces[1] and os.path.realpath(
            slow_bag) == os.path.realpath(options.fast):
        print(
            f'piezo: {slow_bag} is both axes: one bag holds both axes only if --namespaces tells '
            'them apart; else give BAG_X and BAG_Y', file=sys.stderr)
        return EXIT_USAGE
    try:
        fast, slow = (
            _read(path, namespace, options) for path, namespace in (
                (options.fast, options.namespaces[0]), (slow_bag, options.namespaces[1])))
        scan = scanned_image(
            fast, slow, name='image', case=f'{options.fast.name}, {slow_bag.name}',
            variant='recorded', pixels=options.pixels, central=options.central,
            bags=(os.path.relpath(options.fast, options.output),
                  os.path.relpath(slow_bag, options.output)))
        lost = [f'{run.path}: {loss}' for run in (fast, slow) for loss in run.lost]
        prepare_directory(options.output, force=options.force)
        report = write_raster_report(
            options.output, title='A recorded image', scans=[scan], software=software_versions(),
            notes=lost, command=' '.join(['piezo', *sys.argv[1:]]))
    except PlanError as error:
        print(f'piezo: {error}', file=sys.stderr)
        return EXIT_USAGE
    except (BagError, ValueError, OSError) as error:
        print(f'piezo: {failure_text(error)}', file=sys.stderr)
        return EXIT_FAILED
    for loss in lost:
        print(f'piezo: {loss}', file=sys.stderr)
    first, last = scan.images.samples
    print(
        f'{scan.images.nominal_y_um.size} lines, samples {first} … {last}, '
        f'{scan.line_rate_hz:g} lines a second')
    print(image_table([scan]))
    print(f'report: {report}')
    return EXIT_LOSS if lost else EXIT_DONE


def _read(path: Path, namespace: str | None, options: argparse.Namespace) -> Run:
    return read(path, namespace=namespace, run=options.run, allow_loss=options.allow_loss)
