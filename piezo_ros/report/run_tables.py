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

"""Tables of scored runs: aligned text for a terminal, CSV for other programs."""

import csv
import io
from collections.abc import Sequence
from typing import Final

from piezo_ros.report.columns import Column, Value, value_text
from piezo_ros.report.labels import scheme_label
from piezo_ros.report.score import ScoredRun

__all__ = ['SCORE_COLUMNS', 'csv_table', 'score_values', 'text_table']

# What identifies a run, then its scores.
_RUN_COLUMNS: Final = (
    Column('scheme'),
    Column('waveform'),
    Column('amplitude', 'µm', 'g'),
    Column('frequency', 'Hz', 'g'),
)
_OFFSET: Final = Column('offset', 'µm', 'g')
SCORE_COLUMNS: Final = (
    Column('m', '', 'd'),
    Column('NRMSE', '%', '.2f'),
    Column('paper', '%', '.2f'),
    Column('deviation', '%', '+.1f'),
    Column('max error', 'µm', '.3f'),
    Column('condition'),
    Column('samples', '', 'd'),
    Column('wall time', 's', '.2f'),
    Column('rate', 'samples/s', '.0f'),
)

# The published number keeps its place where no run has it.
_CSV_NAMES: Final = (
    'scheme', 'waveform', 'amplitude_um', 'frequency_hz', 'harmonics', 'nrmse_percent',
    'max_error_um', 'bag', 'samples', 'wall_seconds', 'paper_nrmse_percent')


def score_values(run: ScoredRun) -> list[Value]:
    """Return the values of a run in the order of `SCORE_COLUMNS`."""
    return [
        run.harmonics, run.nrmse_percent, run.paper_nrmse_percent, run.deviation_percent,
        run.max_error_um, run.condition.words, run.samples,
        run.wall_seconds or None, run.samples_per_wall_second]


def text_table(runs: Sequence[ScoredRun]) -> str:
    """
    Return the scores of runs as aligned plain text.

    Parameters
    ----------
    runs : sequence of ScoredRun
        One row each.

    Returns
    -------
    str
        A heading, a line of units, a rule and the rows; every line ends in a line feed.

    """
    has_offsets = any(run.offset_um for run in runs)
    columns = (*_RUN_COLUMNS, *((_OFFSET,) if has_offsets else ()), *SCORE_COLUMNS)
    rows = [[column.title for column in columns], [column.unit for column in columns]]
    for run in runs:
        values = [
            scheme_label(run.scheme), run.waveform, run.amplitude_um, run.frequency_hz,
            *((run.offset_um,) if has_offsets else ()), *score_values(run)]
        rows.append([
            value_text(value, column) for value, column in zip(values, columns, strict=True)])
    widths = [max(map(len, texts)) for texts in zip(*rows, strict=True)]
    rows.insert(2, ['-' * width for width in widths])
    return ''.join(
        '  '.join(
            text.rjust(width) if column.format_spec else text.ljust(width)
            for column, text, width in zip(columns, row, widths, strict=True)).rstrip() + '\n'
        for row in rows)


def csv_table(runs: Sequence[ScoredRun]) -> str:
    """
    Return the scores of runs as CSV, numbers in full precision.

    Parameters
    ----------
    runs : sequence of ScoredRun
        One row each, the columns named as in report.json.

    Returns
    -------
    str
        A heading and the rows; every line ends in a line feed. A run without a published number
        has an empty field for it.

    """
    text = io.StringIO(newline='')
    names = list(dict.fromkeys([*_CSV_NAMES, *(name for run in runs for name in run.record())]))
    writer = csv.DictWriter(text, names, restval='', lineterminator='\n')
    writer.writeheader()
    writer.writerows(run.record() for run in runs)
    return text.getvalue()
