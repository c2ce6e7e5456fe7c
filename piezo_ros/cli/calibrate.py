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

"""``piezo calibrate``: the mismatches of the simulated rig out of the published tracking errors."""

import argparse
from pathlib import Path
from typing import Final

from piezo_ros.cli.shared.option_types import Whole
from piezo_ros.cli.shared.outputs import OutputFile
from piezo_ros.cli.shared.progress import Progress
from piezo_ros.report.files import write_atomically

__all__ = ['add_arguments']

_SEED: Final = Whole(0, 2**32 - 1)
_GENERATIONS: Final = Whole(1, 100_000)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    parser.epilog = (
        'examples:\n  piezo calibrate -o config/rig.yaml --force\n'
        '  piezo calibrate --self-heating --seed 2 -o config/rig_that_warms.yaml --force')
    parser.add_argument(
        '-o', '--output', type=Path, action=OutputFile, required=True, metavar='FILE',
        help='parameter file to write')
    parser.add_argument('--force', action='store_true', help='replace the file')
    parser.add_argument(
        '--self-heating', action='store_true',
        help='of a stage that warms by its losses; fitted to Table 3 too')
    parser.add_argument('--seed', type=_SEED, default=1, help='of the search (default: 1)')
    parser.add_argument(
        '--generations', type=_GENERATIONS, default=45,
        help='of the search (default: 45, some minutes)')
    parser.set_defaults(function=_calibrate)


def _calibrate(options: argparse.Namespace) -> int:
    from piezo_ros.study.rig_calibration import calibrate_rig
    progress = Progress()
    progress.announce('calibrating on the rows 0.5, 1.5 and 2.5 um of Table 4' + (
        ', and 1.5 to 2.5 um of Table 3' if options.self_heating else ''))
    calibration = calibrate_rig(
        self_heating=options.self_heating, generations=options.generations, seed=options.seed,
        progress=progress.show)
    progress.end()
    write_atomically(options.output, calibration.to_parameter_yaml())
    for name, found in (
            ('all rows', calibration.overall), ('fitted rows', calibration.fitted),
            ('held-out rows', calibration.held_out)):
        print(
            f'{name:14} median deviation {found.median_deviation:6.2%}, better scheme agrees in '
            f'{found.verdicts} of {found.conditions}')
    crossings = ', '.join(f'{value:.0f}' for value in calibration.crossings_hz)
    print(f'Table 3        FF and FBFF are equal at {crossings} Hz')
    return 0
