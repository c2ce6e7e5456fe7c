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

"""What all kinds of ``piezo identify`` share: bags to read, files to write, the exit code."""

import argparse
import itertools
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol, TypeVar

from piezo_ros.bag import BagError, Recording, Run, open_recording
from piezo_ros.cli.shared.bag_options import add_bag_options, bag_options
from piezo_ros.cli.shared.exit_codes import (
    EXIT_DONE,
    EXIT_FAILED,
    EXIT_LOSS,
    EXIT_POOR,
)
from piezo_ros.cli.shared.given_options import refuse_named_option
from piezo_ros.cli.shared.option_types import TIME_S
from piezo_ros.cli.shared.outputs import OutputDirectory, OutputFile
from piezo_ros.cli.shared.progress import working
from piezo_ros.experiment.output_directory import prepare_directory
from piezo_ros.identification.verdict import Verdict
from piezo_ros.parameters.errors import PlanError, failure_text
from piezo_ros.report.files import write_atomically

__all__ = [
    'TABLE_SUFFIX', 'Identified', 'Source', 'add_common_arguments', 'add_verdict_arguments',
    'identify', 'source', 'with_picture',
]

TABLE_SUFFIX: Final = '.csv'
_PLOT_SUFFIX: Final = '.svg'


class Source(Protocol):
    """What every kind reads of a bag, beside the samples."""

    @property
    def path(self) -> Path:
        """The bag."""

    @property
    def sample_period_s(self) -> float:
        """Sample period, seconds."""

    @property
    def lost(self) -> tuple[str, ...]:
        """Sentences that name the losses."""


_Source = TypeVar('_Source', bound=Source)


class Identified(NamedTuple):
    """
    What a kind makes of its bags.

    Attributes
    ----------
    files : mapping of Path to str
        The text of each file to write.
    verdict : Verdict or None
        How far the model may be trusted; None where the kind has no model of its own.
    report : callable or None
        Writes the page of the model into a directory and returns the file; None without a page.

    """

    files: Mapping[Path, str]
    verdict: Verdict | None = None
    report: Callable[[Path], Path] | None = None


def add_common_arguments(
    kind: argparse.ArgumentParser, *, bags: str | int = '+', report: bool = False,
    beside: tuple[str, ...] = (),
) -> None:
    """
    Describe the bags, how many there may be, the output and the part that is taken.

    Parameters
    ----------
    kind : argparse.ArgumentParser
        The parser of the kind.
    bags : str or int, optional
        How many bags there may be, as `argparse` has it.
    report : bool, optional
        Whether a page may be drawn.
    beside : tuple of str, optional
        Suffixes of further files beside the model and its picture.

    """
    kind.add_argument('bags', type=Path, nargs=bags, metavar='BAG')
    kind.add_argument(
        '-o', '--output', type=Path, action=OutputFile, beside=(_PLOT_SUFFIX, *beside),
        required=True, metavar='FILE', help='model file to write')
    kind.add_argument('--force', action='store_true', help='replace the file')
    if report:
        kind.add_argument(
            '--report', type=Path, action=OutputDirectory, metavar='DIR',
            help='draw fit, residuals and their whiteness: a page in this directory')
    add_bag_options(kind)
    kind.add_argument(
        '--from-s', type=TIME_S, default=0.0, metavar='T',
        help='leave out what was before this simulated time')
    kind.add_argument(
        '--to-s', type=TIME_S, default=math.inf, metavar='T',
        help='leave out what was from this simulated time on')


def add_verdict_arguments(kind: argparse.ArgumentParser) -> None:
    """Describe what is done with a model that does not explain its data."""
    kind.add_argument(
        '--accept-poor', action='store_true',
        help='exit 0 also where the verdict is "do not trust" (else 4; the file is written)')


def identify(
    make: Callable[[argparse.Namespace, list[_Source]], Identified], options: argparse.Namespace,
    *, read: Callable[[Recording, int, int], _Source] = Recording.part,  # type: ignore[assignment]
    hysteresis: bool = False, next_step: str = '',
) -> int:
    """
    Read the bags, make a model of them, write its files and return the exit code.

    Parameters
    ----------
    make : callable
        Returns the files and the verdict for the options and the runs.
    options : argparse.Namespace
        The arguments of the command.
    read : callable, optional
        Reads the samples of a recording from a first one to before a last one; `Recording.part`
        by default.
    hysteresis : bool, optional
        Whether voltage and displacement are all that is wanted, up to their first gap.
    next_step : str, optional
        Command that uses the model, with ``{model}`` in place of its file.

    """
    directory = getattr(options, 'report', None)
    try:
        runs = []
        for path in options.bags:
            with working(f'reading {path}'):
                runs.append(_with_losses(
                    read(*_opened(path, options, hysteresis)), options.allow_loss))
        _refuse_different_periods(runs)
        files, verdict, write_report = make(options, runs)
        if directory is not None:
            prepare_directory(directory, force=options.force)
        for path, text in files.items():
            write_atomically(path, text)
        report = None
        if directory is not None and write_report:
            with working('drawing the report'):
                report = write_report(directory)
    except PlanError:
        raise
    except (BagError, ValueError, OSError) as error:
        refuse_named_option(options, error)
        print(f'piezo: {failure_text(error)}', file=sys.stderr)
        return EXIT_FAILED
    print(f'model: {", ".join(map(str, files))}')
    if report is not None:
        print(f'report: {report}')
    if next_step:
        print(f'next: {next_step.format(model=options.output)}')
    lost = [f'{run.path}: {loss}' for run in runs for loss in run.lost]
    for loss in lost:
        print(f'piezo: {loss}', file=sys.stderr)
    return _exit_code(verdict, bool(lost), getattr(options, 'accept_poor', False))


def _exit_code(verdict: Verdict | None, is_lossy: bool, accept_poor: bool) -> int:
    if verdict is not None:
        print(f'verdict: {verdict}')
        if verdict.is_poor and not accept_poor:
            return EXIT_POOR
    return EXIT_LOSS if is_lossy else EXIT_DONE


def _opened(
    path: Path, options: argparse.Namespace, hysteresis: bool,
) -> tuple[Recording, int, int]:
    """Open a bag that may be longer than the memory; return what part of it is wanted."""
    recording = open_recording(
        path, **bag_options(options), keep_not_finite=True,  # the fits leave them out
        fill_gaps=not hysteresis)
    start, stop = (
        math.ceil(time_s / recording.sample_period_s) - recording.start_index
        if math.isfinite(time_s) else recording.samples
        for time_s in (options.from_s, options.to_s))
    start, stop = max(start, 0), min(stop, recording.samples)
    if start >= stop:
        first_s = recording.start_index * recording.sample_period_s
        last_s = first_s + (recording.samples - 1) * recording.sample_period_s
        raise BagError(
            f'{path} has no sample from --from-s {options.from_s:g} to --to-s {options.to_s:g}, '
            f'it lasts from {first_s:g} s to {last_s:g} s')
    return recording, start, stop


def _with_losses(run: _Source, allow_loss: bool) -> _Source:
    """Return a run that tells which of its samples are not finite, or refuse it."""
    if not isinstance(run, Run):  # the other kind of source tells of them itself
        return run
    sentences = run.not_finite()
    if sentences and not allow_loss:
        raise BagError(f'{run.path}: {"; ".join(sentences)}')
    return replace(run, lost=run.lost + sentences)


def _refuse_different_periods(runs: Sequence[Source]) -> None:
    for first, run in itertools.pairwise(runs):
        if run.sample_period_s != first.sample_period_s:
            raise BagError(
                f'{run.path} has the sample period {run.sample_period_s:g} s, {first.path} '
                f'{first.sample_period_s:g} s: they cannot be identified together')


def source(runs: Sequence[Source]) -> str:
    """Return where a model is from, for its file."""
    return ', '.join(str(run.path) for run in runs)


def with_picture(
    files: dict[Path, str], options: argparse.Namespace, figure: str, *arguments: Any,
) -> Mapping[Path, str]:
    """Add a picture beside the model; without matplotlib the model is all the same."""
    try:
        from piezo_ros.report.figures import identification_figure
        from piezo_ros.report.figures.export import svg
    except ImportError:
        return files
    files[options.output.with_suffix(_PLOT_SUFFIX)] = svg(
        getattr(identification_figure, figure)(*arguments), options.kind)
    return files
