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

"""The results of a sweep as tables: a file with every run, a summary for the terminal."""

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from piezo_ros.report.files import put_in_place

__all__ = ['by_run', 'run_title', 'summary_table', 'write_table']

_QUANTILES: Final = (0.05, 0.5, 0.95)


def write_table(directory: Path, results: Sequence[Mapping[str, Any]]) -> Path:
    """
    Write one row for each run: Parquet where pyarrow is installed, else CSV.

    Parameters
    ----------
    directory : Path
        Where results.parquet or results.csv goes.
    results : sequence of mapping
        The records of the runs.

    Returns
    -------
    Path
        The written file.

    """
    columns = list(dict.fromkeys(name for record in results for name in record))
    # Lists become text in either form, so that both say the same.
    rows = [
        [json.dumps(value) if isinstance(value, list) else value
         for value in (record.get(name) for name in columns)]
        for record in results]
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        path = directory / 'results.csv'
        with (
            put_in_place(path) as unfinished,
            unfinished.open('w', encoding='utf-8', newline='') as file,
        ):
            writer = csv.writer(file)
            writer.writerow(columns)
            writer.writerows(rows)
        return path
    path = directory / 'results.parquet'
    with put_in_place(path) as unfinished:
        parquet.write_table(
            pyarrow.table({name: [row[k] for row in rows] for k, name in enumerate(columns)}),
            unfinished)
    return path


def summary_table(results: Sequence[Mapping[str, Any]]) -> str:
    """Return quantiles of the tracking error over the draws, one line for each run of the plan."""
    heads = ''.join(f'{f"{quantile:.0%}":>10}' for quantile in _QUANTILES)
    lines = [f'{"NRMSE %":44}{"draws":>8}{heads}']
    for group in by_run(results).values():
        values = np.quantile([result['nrmse_percent'] for result in group], _QUANTILES)
        numbers = ''.join(f'{value:10.3f}' for value in values)
        lines.append(f'{run_title(group):44}{len(group):8}{numbers}')
    return '\n'.join(lines)


def by_run(results: Sequence[Mapping[str, Any]]) -> dict[int, list[Mapping[str, Any]]]:
    """Return the number of each run of the plan, and the records of its draws without error."""
    groups: dict[int, list[Mapping[str, Any]]] = {}
    for result in results:
        if not result['error']:
            groups.setdefault(result['run'], []).append(result)
    return dict(sorted(groups.items()))


def run_title(group: Sequence[Mapping[str, Any]]) -> str:
    """Return what all draws of a run have in common."""
    forms = {
        'scheme': '{}', 'waveform': '{}', 'amplitude_um': '{:g} um', 'frequency_hz': '{:g} Hz',
        'harmonics': 'm = {}'}
    return ' '.join(
        form.format(group[0][name]) for name, form in forms.items()
        if all(result[name] == group[0][name] for result in group))
