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

"""``piezo report``: scores, tables and pictures of bags, also of foreign ones."""

import argparse
import os
import sys
from pathlib import Path
from typing import Any, Final

from piezo_ros.bag import BagError, Recording, open_recording
from piezo_ros.cli.shared.bag_options import add_bag_options, bag_options
from piezo_ros.cli.shared.given_options import refuse_same_twice, refuse_without_effect
from piezo_ros.cli.shared.option_types import AMPLITUDE_UM, FREQUENCY_HZ, Number, Whole
from piezo_ros.cli.shared.outputs import OutputDirectory
from piezo_ros.experiment.output_directory import prepare_directory
from piezo_ros.parameters.errors import PlanError, failure_text
from piezo_ros.parameters.provenance import software_versions
from piezo_ros.report import ScoredRun, score
from piezo_ros.report.run_tables import text_table

__all__ = ['add_arguments']

_EXAMPLES: Final = """\
examples:
  piezo report out/demo -o out/again
  piezo report bag_1 bag_2 -o out/compared
  piezo report foreign_bag --scheme ff --waveform triangle --amplitude-um 1 --frequency-hz 300 \\
      --harmonics 9 -o out/foreign
"""
# What a bag of ours says of itself and a foreign one does not.
_DESCRIPTION: Final[dict[str, dict[str, Any]]] = {
    'scheme': {}, 'waveform': {},
    'amplitude_um': {'type': AMPLITUDE_UM}, 'frequency_hz': {'type': FREQUENCY_HZ},
    'harmonics': {'type': Whole(0, 100_000)},
}
_PERIODS: Final = Number(0.0, 1e6, is_above=True)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    parser.epilog = _EXAMPLES
    parser.add_argument(
        'bags', type=Path, nargs='+', metavar='DIR|BAG',
        help='bags, or output directories of piezo run; of raster scans the images are made')
    parser.add_argument(
        '-o', '--output', type=Path, action=OutputDirectory, required=True, metavar='DIR',
        help='output directory')
    parser.add_argument(
        '--force', action='store_true', help='replace an earlier output in DIR')
    parser.add_argument(
        '--periods', type=_PERIODS, default=4.0, metavar='N',
        help='periods at the end that are scored (default: 4)')
    add_bag_options(parser)
    for name, allowed in _DESCRIPTION.items():
        parser.add_argument(
            f'--{name.replace("_", "-")}', metavar='VALUE', **allowed,
            help=f'{name} of bags that do not say it themselves')
    parser.set_defaults(function=_report)


def _report(options: argparse.Namespace) -> int:
    from piezo_ros.experiment.raster.recorded_scans import has_scans
    if any(map(has_scans, options.bags)):
        return _report_scans(options)
    return _report_runs(options)


def _report_scans(options: argparse.Namespace) -> int:
    from piezo_ros.experiment.raster.recorded_scans import has_scans, recorded_scans
    from piezo_ros.report.page.raster_report import image_table, write_raster_report
    for given in options.bags:
        if not has_scans(given):
            print(
                f'piezo: {given} has no raster scans, others of the arguments have; report them '
                'apart', file=sys.stderr)
            return 2
    try:
        refuse_without_effect(
            options, ['periods', 'namespace', 'run', 'allow_loss', *_DESCRIPTION],
            'on raster scans')
        scans = [scan for given in options.bags for scan in recorded_scans(given, options.output)]
        prepare_directory(options.output, force=options.force)
        report = write_raster_report(
            options.output, title=f'{len(scans)} recorded scans', scans=scans,
            software=software_versions(), command=' '.join(['piezo', *sys.argv[1:]]))
    except PlanError as error:
        print(f'piezo: {error}', file=sys.stderr)
        return 2
    except (BagError, ValueError, OSError) as error:
        print(f'piezo: {failure_text(error)}', file=sys.stderr)
        return 1
    print(image_table(scans))
    print(f'report: {report}')
    return 0


def _report_runs(options: argparse.Namespace) -> int:
    from piezo_ros.report.page.run_report import write_report
    told = {
        name: str(value) for name in _DESCRIPTION
        if (value := getattr(options, name)) is not None}
    try:
        paths = [path for given in options.bags for path in _bags_below(given)]
        refuse_same_twice(paths)
        runs: list[Recording] = []
        scored: list[ScoredRun] = []
        left_out: list[str] = []
        for path in paths:
            try:
                run = open_recording(path, **bag_options(options))
                if run.metadata.get('output') == 'voltage':
                    print(f'left out: {path}: the bare actuator follows no reference')
                else:
                    scored.append(_scored(run, told, path, options))
                runs.append(run)
            except (BagError, ValueError) as error:
                if len(paths) == 1:
                    raise
                left_out.append(f'left out: {error}')
        refuse_without_effect(
            options, [name for name in _DESCRIPTION if all(name in run.metadata for run in runs)],
            'where every bag tells it itself')
        if not scored:
            for line in left_out:
                print(f'piezo: {line}', file=sys.stderr)
            raise ValueError(
                f'{", ".join(map(str, options.bags))}: there is no run that follows a reference')
        prepare_directory(options.output, force=options.force)
        report = write_report(
            options.output, title=f'{len(scored)} recorded runs', runs=scored,
            software=software_versions(),
            notes=[*left_out, *(f'{run.path}: {loss}' for run in runs for loss in run.lost)],
            command=' '.join(['piezo', *sys.argv[1:]]))
    except PlanError as error:
        print(f'piezo: {error}', file=sys.stderr)
        return 2
    except (BagError, ValueError, OSError) as error:
        print(f'piezo: {failure_text(error)}', file=sys.stderr)
        return 1
    for line in left_out:
        print(f'piezo: {line}', file=sys.stderr)
    for run in runs:
        for loss in run.lost:
            print(f'piezo: {run.path}: {loss}', file=sys.stderr)
    print(text_table(scored))
    print(f'report: {report}')
    return 3 if left_out or any(run.lost for run in runs) else 0


def _scored(
    run: Recording, told: dict[str, str], path: Path, options: argparse.Namespace,
) -> ScoredRun:
    known = run.described({**told, **run.metadata})
    try:
        return score(
            known, periods=options.periods, bag=os.path.relpath(path, options.output),
            wall_seconds=0.0)
    except ValueError as error:
        raise ValueError(f'{path}: {error}') from None


def _bags_below(path: Path) -> list[Path]:
    """Return the bags of an output directory, or the bag itself."""
    collection = path / 'bags'
    if not collection.is_dir():
        return [path]
    return sorted(entry for entry in collection.iterdir() if (entry / 'metadata.yaml').is_file())
