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

"""The results as a table: aligned text for a terminal, CSV for everything else."""

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Final, NamedTuple

from piezo_ros.report.comparison import scheme_label
from piezo_ros.report.files import write_atomically
from piezo_ros.report.score import ScoredRun

__all__ = ['COLUMNS', 'RunColumn', 'csv_table', 'text_table', 'write_csv']

_ABSENT: Final = '–'


class RunColumn(NamedTuple):
    """
    One column of a table of runs.

    Attributes
    ----------
    title, unit : str
        Heading; the unit is empty for names and counts.
    text : callable
        Formats the column's value of one run.
    is_number : bool
        Numbers are aligned to the right.

    """

    title: str
    unit: str
    text: Callable[[ScoredRun], str]
    is_number: bool = True


def _or_absent(value: float | None, form: str) -> str:
    return _ABSENT if value is None else format(value, form)


COLUMNS: Final = (
    RunColumn('scheme', '', lambda run: scheme_label(run.scheme), is_number=False),
    RunColumn('waveform', '', lambda run: run.waveform, is_number=False),
    RunColumn('amplitude', 'µm', lambda run: f'{run.amplitude_um:g}'),
    RunColumn('frequency', 'Hz', lambda run: f'{run.frequency_hz:g}'),
    RunColumn('m', '', lambda run: str(run.harmonics)),
    RunColumn('NRMSE', '%', lambda run: f'{run.nrmse_percent:.2f}'),
    RunColumn('paper', '%', lambda run: _or_absent(run.paper_nrmse_percent, '.2f')),
    RunColumn('deviation', '%', lambda run: _or_absent(run.deviation_percent, '+.1f')),
    RunColumn('max error', 'µm', lambda run: f'{run.max_error_um:.3f}'),
    RunColumn('samples', '', lambda run: str(run.samples)),
    RunColumn('wall time', 's', lambda run: _or_absent(run.wall_seconds or None, '.2f')),
    RunColumn('rate', 'samples/s', lambda run: _or_absent(run.samples_per_wall_second, '.0f')),
)


def text_table(runs: Sequence[ScoredRun]) -> str:
    """
    Return the results as aligned plain text.

    Parameters
    ----------
    runs : sequence of ScoredRun
        One row each.

    Returns
    -------
    str
        A heading, a line of units, a rule and the rows; every line ends in a line feed.

    """
    rows = [
        [column.title for column in COLUMNS],
        [column.unit for column in COLUMNS],
        *([column.text(run) for column in COLUMNS] for run in runs)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(COLUMNS))]

    def line(row: Sequence[str]) -> str:
        return '  '.join(
            text.rjust(width) if column.is_number else text.ljust(width)
            for column, text, width in zip(COLUMNS, row, widths, strict=True)).rstrip()

    rule = '  '.join('-' * width for width in widths)
    return ''.join(f'{text}\n' for text in (
        line(rows[0]), line(rows[1]), rule, *(line(row) for row in rows[2:])))


def csv_table(runs: Sequence[ScoredRun]) -> str:
    """
    Return the results as CSV, numbers in full precision.

    Parameters
    ----------
    runs : sequence of ScoredRun
        One row each, the columns named as in report.json; an absent published number is empty.

    Returns
    -------
    str
        A heading and the rows; every line ends in a line feed.

    """
    text = io.StringIO(newline='')
    names = [field.name for field in fields(ScoredRun) if field.compare]
    writer = csv.DictWriter(text, names, restval='', lineterminator='\n')
    writer.writeheader()
    writer.writerows(run.record() for run in runs)
    return text.getvalue()


def write_csv(path: Path, runs: Sequence[ScoredRun]) -> None:
    """
    Write the results as CSV.

    Parameters
    ----------
    path : Path
        The file; replaced atomically.
    runs : sequence of ScoredRun
        As for `csv_table`.

    Raises
    ------
    OSError
        If the file cannot be written.

    """
    write_atomically(path, csv_table(runs))
