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

"""The record of a benchmark: values and ratios, written as JSON, continued, compared, printed."""

import datetime
import json
import os
import platform
import statistics
from collections.abc import Iterable, Mapping, Set
from pathlib import Path
from typing import Any, Final, NamedTuple

from benchmarks.measurement import BenchmarkError, Measurement, Ratio, Readings
from piezo_ros.parameters.provenance import software_versions

__all__ = [
    'Change',
    'benchmark_record',
    'changes',
    'check_continues',
    'joined',
    'read_record',
    'record_table',
]

FORMAT_VERSION: Final = 2
TOLERANCE: Final = 0.15  # share by which a median must be worse to be called so
_KEYS: Final = ('median', 'minimum', 'maximum')


class Change(NamedTuple):
    """
    How a ratio compares with an earlier one.

    Attributes
    ----------
    name : str
        The ratio.
    before, now : float
        Its medians.
    worse : bool
        Whether it is worse by more than `TOLERANCE`.

    """

    name: str
    before: float
    now: float
    worse: bool


def benchmark_record(
    measurements: Iterable[Measurement], ratios: Iterable[Ratio], readings: Readings, rounds: int,
) -> dict[str, Any]:
    """
    Return results, ratios, machine and software of a benchmark, ready for JSON.

    Parameters
    ----------
    measurements : iterable of Measurement
        The measurements of the rounds.
    ratios : iterable of Ratio
        Ratios to form where both quantities have values.
    readings : Readings
        The values of the rounds.
    rounds : int
        Number of rounds.

    """
    values = readings.values
    results = {
        quantity.name: {
            'group': entry.group, 'unit': quantity.unit,
            'higher_is_better': quantity.higher_is_better, **_summary(values[quantity.name])}
        for entry in measurements for quantity in entry.quantities if quantity.name in values}
    return {
        'format_version': FORMAT_VERSION,
        'date': datetime.datetime.now(datetime.timezone.utc).isoformat(timespec='seconds'),
        'machine': _machine(),
        'software': software_versions(),
        'rounds': rounds,
        'results': results,
        # Round by round, because the speed of the machine drifts from one round to the next.
        'ratios': {
            ratio.name: {
                'over': ratio.over, 'under': ratio.under,
                'higher_is_better': ratio.higher_is_better,
                **_summary([
                    a / b for a, b in zip(values[ratio.over], values[ratio.under], strict=False)])}
            for ratio in ratios if ratio.over in values and ratio.under in values},
        'skipped': readings.skipped,
        'failed': readings.failed,
    }


def joined(
    earlier: Mapping[str, Any], measurements: Iterable[Measurement], readings: Readings,
) -> Readings:
    """
    Return the readings of an earlier benchmark with those of further rounds appended.

    Parameters
    ----------
    earlier : mapping
        As `read_record` returns it.
    measurements : iterable of Measurement
        The measurements of the further rounds.
    readings : Readings
        Their values.

    Raises
    ------
    BenchmarkError
        If the machine or the quantities differ.

    """
    _check_same(earlier, readings.values.keys())
    before = {name: row['values'] for name, row in earlier['results'].items()}
    return readings._replace(values={
        quantity.name: before[quantity.name] + readings.values[quantity.name]
        for entry in measurements for quantity in entry.quantities
        if quantity.name in before})


def check_continues(earlier: Mapping[str, Any], measurements: Iterable[Measurement]) -> None:
    """
    Check, before minutes of measuring, that `joined` will accept the further rounds.

    Parameters
    ----------
    earlier : mapping
        As `read_record` returns it.
    measurements : iterable of Measurement
        The measurements of the further rounds.

    Raises
    ------
    BenchmarkError
        If the machine or the quantities differ.

    """
    _check_same(earlier, {
        quantity.name for entry in measurements if not entry.missing()
        for quantity in entry.quantities})


def _check_same(earlier: Mapping[str, Any], names: Set[str]) -> None:
    if earlier['machine'] != _machine():
        raise BenchmarkError(
            f'the earlier rounds are of another machine: {earlier["machine"]}, not {_machine()}')
    different = earlier['results'].keys() ^ names
    if different:
        raise BenchmarkError(
            f'the earlier rounds are of other measurements: {", ".join(sorted(different))}')


def read_record(path: Path) -> dict[str, Any]:
    """
    Return the record of a benchmark from its JSON file.

    Raises
    ------
    BenchmarkError
        If the file cannot be read or is not a benchmark of this format.

    """
    try:
        record = json.loads(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise BenchmarkError(f'cannot read {path}: {error.strerror}') from None
    except ValueError as error:
        raise BenchmarkError(f'{path} is no JSON: {error}') from None
    version = record.get('format_version') if isinstance(record, dict) else None
    if version != FORMAT_VERSION:
        raise BenchmarkError(
            f'{path} has the format_version {version!r}, only {FORMAT_VERSION} is known')
    return dict(record)


def changes(now: Mapping[str, Any], before: Mapping[str, Any]) -> list[Change]:
    """
    Compare the medians of the ratios that two benchmarks share.

    Absolute values depend on the machine and its load and are not compared.

    Parameters
    ----------
    now, before : mapping
        As `benchmark_record` returns them.

    """
    found = []
    for name, ratio in now['ratios'].items():
        if name not in before['ratios']:
            continue
        median, earlier = ratio['median'], before['ratios'][name]['median']
        if ratio['higher_is_better']:
            worse = median < earlier * (1.0 - TOLERANCE)
        else:
            worse = median > earlier * (1.0 + TOLERANCE)
        found.append(Change(name, earlier, median, worse))
    return found


def record_table(record: Mapping[str, Any]) -> str:
    """Return results and ratios as a table of text."""
    lines = [f'{"":36}' + ''.join(f'{key:>12}' for key in _KEYS)]
    group = ''
    for name, row in record['results'].items():
        if row['group'] != group:
            group = row['group']
            lines.append(group)
        numbers = ''.join(f'{row[key]:12.4g}' for key in _KEYS)
        lines.append(f'  {name:34}{numbers}  {row["unit"]}')
    if record['ratios']:
        lines.append('ratios within a round')
    for name, row in record['ratios'].items():
        numbers = ''.join(f'{row[key]:12.3g}' for key in _KEYS)
        good = 'higher' if row['higher_is_better'] else 'lower'
        lines.append(f'  {name:34}{numbers}  {good} is better')
    for name, reason in record['skipped'].items():
        lines.append(f'skipped: {name}: {reason}')
    for name, reason in record['failed'].items():
        lines.append(f'failed: {name}: {reason}')
    return '\n'.join(lines)


def _summary(values: list[float]) -> dict[str, Any]:
    return {
        'median': statistics.median(values), 'minimum': min(values), 'maximum': max(values),
        'values': values}


def _machine() -> dict[str, Any]:
    return {
        'processor': _processor(), 'cores': os.cpu_count(), 'memory_gb': _memory_gb(),
        'system': f'{platform.system()} {platform.machine()}', 'python': platform.python_version()}


def _processor() -> str:
    try:
        for line in Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines():
            if line.startswith('model name'):
                return line.partition(':')[2].strip()
    except OSError:
        pass
    return platform.processor()


def _memory_gb() -> float:
    try:
        return round(os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE') / 1e9, 1)
    except (OSError, ValueError):
        return 0.0
