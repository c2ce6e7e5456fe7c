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

"""
What a benchmark is: measurements as data, taken in rounds, and ratios of those of one round.

The speed of a machine drifts while one measures. Every round therefore takes each measurement once,
one after the other, and what is compared between two benchmarks are ratios within their rounds.
"""

import datetime
import json
import math
import os
import platform
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from piezo_ros.experiment.errors import CampaignError
from piezo_ros.experiment.provenance import software_versions

__all__ = [
    'BenchmarkError',
    'Change',
    'Measurement',
    'Quantity',
    'Ratio',
    'Readings',
    'benchmark_record',
    'changes',
    'check_continues',
    'chosen',
    'joined',
    'read_record',
    'record_table',
    'take_rounds',
]

FORMAT_VERSION: Final = 2
TOLERANCE: Final = 0.15  # a median may be worse by that much before it counts
_KEYS: Final = ('median', 'minimum', 'maximum')


class BenchmarkError(ValueError):
    """A choice that names nothing, or a file that is no benchmark."""


class Quantity(NamedTuple):
    """
    One number that a measurement gives.

    Attributes
    ----------
    name, unit : str
        What it is called, and its unit.
    higher_is_better : bool
        Which way is the good one.

    """

    name: str
    unit: str
    higher_is_better: bool


def _nothing_is_missing() -> str:
    return ''


@dataclass(frozen=True)
class Measurement:
    """
    Something to measure.

    Attributes
    ----------
    group : str
        Group to which it belongs, for `chosen`.
    quantities : tuple of Quantity
        What it gives.
    measure : callable
        Takes the measurement once and returns the value of each quantity.
    missing : callable
        Says why it cannot be done here; '' where it can.

    """

    group: str
    quantities: tuple[Quantity, ...]
    measure: Callable[[], Sequence[float]]
    missing: Callable[[], str] = _nothing_is_missing

    @property
    def title(self) -> str:
        """Group and names, for who waits."""
        return f'{self.group}: {", ".join(quantity.name for quantity in self.quantities)}'


class Ratio(NamedTuple):
    """
    One quantity over another one of the same round.

    Attributes
    ----------
    name : str
        What it is called.
    over, under : str
        The quantities.
    higher_is_better : bool
        Which way is the good one.

    """

    name: str
    over: str
    under: str
    higher_is_better: bool


class Readings(NamedTuple):
    """
    What came of some rounds.

    Attributes
    ----------
    values : dict of str to list of float
        Quantity to its values, one for each round.
    skipped : dict of str to str
        Quantity to the reason why it could not be measured here.
    failed : dict of str to str
        Quantity to what went wrong; it was given up from that round on.

    """

    values: dict[str, list[float]]
    skipped: dict[str, str]
    failed: dict[str, str]


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


def chosen(measurements: Iterable[Measurement], names: Sequence[str]) -> list[Measurement]:
    """
    Return the measurements of some groups or with some quantities; all without names.

    Parameters
    ----------
    measurements : iterable of Measurement
        To choose from.
    names : sequence of str
        Groups and quantities.

    Raises
    ------
    BenchmarkError
        If a name is neither.

    """
    table = list(measurements)
    known = {entry.group for entry in table} | {
        quantity.name for entry in table for quantity in entry.quantities}
    for name in names:
        if name not in known:
            raise BenchmarkError(
                f'{name!r} is no measurement and no group; there are {", ".join(sorted(known))}')
    return [
        entry for entry in table
        if not names or entry.group in names
        or any(quantity.name in names for quantity in entry.quantities)]


def take_rounds(
    measurements: Sequence[Measurement], rounds: int,
    announce: Callable[[str], None] = lambda text: None,
) -> Readings:
    """
    Take every measurement once in each round, one after the other.

    A measurement that fails is given up; the others go on.

    Parameters
    ----------
    measurements : sequence of Measurement
        What to measure.
    rounds : int
        How often.
    announce : callable, optional
        Is told of each measurement before it begins.

    """
    readings = Readings({}, {}, {})
    possible: list[Measurement] = []
    for entry in measurements:
        reason = entry.missing()
        if reason:
            readings.skipped.update((quantity.name, reason) for quantity in entry.quantities)
        else:
            possible.append(entry)
    for number in range(1, rounds + 1):
        for entry in list(possible):
            announce(f'round {number}/{rounds}: {entry.title}')
            try:
                values = [float(value) for value in entry.measure()]
                if not all(map(math.isfinite, values)):
                    raise CampaignError(f'the values are {values}, they must be finite')
            except (CampaignError, OSError, ValueError) as error:
                possible.remove(entry)
                readings.failed.update(
                    (quantity.name, f'round {number}: {error}') for quantity in entry.quantities)
                continue
            for quantity, value in zip(entry.quantities, values, strict=True):
                readings.values.setdefault(quantity.name, []).append(value)
    return readings


def benchmark_record(
    measurements: Iterable[Measurement], ratios: Iterable[Ratio], readings: Readings, rounds: int,
) -> dict[str, Any]:
    """
    Return everything about a benchmark, ready for JSON.

    Parameters
    ----------
    measurements : iterable of Measurement
        What was measured.
    ratios : iterable of Ratio
        Which ratios to form, as far as both quantities are there.
    readings : Readings
        What came of it.
    rounds : int
        How many rounds were asked for.

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
        # Pair by pair, so that a machine whose speed drifts compares like with like.
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
    Return the readings of an earlier benchmark and of more rounds of the same measurements.

    Parameters
    ----------
    earlier : mapping
        As `read_record` returns it.
    measurements : iterable of Measurement
        What was measured now.
    readings : Readings
        What came of it.

    Raises
    ------
    BenchmarkError
        If it is another machine, or something else was measured.

    """
    _check_same(earlier, readings.values.keys())
    before = {name: row['values'] for name, row in earlier['results'].items()}
    return readings._replace(values={
        quantity.name: before[quantity.name] + readings.values[quantity.name]
        for entry in measurements for quantity in entry.quantities
        if quantity.name in before})


def check_continues(earlier: Mapping[str, Any], measurements: Iterable[Measurement]) -> None:
    """
    Refuse to measure more rounds for an earlier benchmark that `joined` would not take.

    Parameters
    ----------
    earlier : mapping
        As `read_record` returns it.
    measurements : iterable of Measurement
        What is to be measured.

    Raises
    ------
    BenchmarkError
        If it is another machine, or something else was measured.

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
    Return a benchmark out of the JSON that `benchmark_record` became.

    Raises
    ------
    BenchmarkError
        If the file cannot be read or is no benchmark of this format.

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
    Compare the ratios that two benchmarks share.

    Absolute values belong to their machine and its mood and are not compared.

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
