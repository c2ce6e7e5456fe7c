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
Measured tables of other programs into bags: columns, units, scales, zeros and time base.

A sample of a stream is made of the number x of a row as (x f - z) s, with the factor f of its unit,
the zero z and the scale s: the streams of a bag are deviations from the operating point. Nothing of
this is guessed: a unit that neither the user nor the file tells is refused.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag.bag_writer import BagWriter
from piezo_ros.bag.tables.array_files import READERS
from piezo_ros.bag.tables.table import Column, Table, TableError
from piezo_ros.bag.tables.text_table import read_text_table
from piezo_ros.bag.tables.time_base import TimeBase, time_base
from piezo_ros.bag.tables.units import SENSOR_UNITS, TIME, unit_factor, units_text
from piezo_ros.parameters.errors import PlanError
from piezo_ros.streams import STREAMS
from piezo_ros.streams.names import label_of

__all__ = ['REST', 'TEXT_SUFFIXES', 'ImportChoice', 'ImportedBag', 'import_table', 'read_table']

TEXT_SUFFIXES: Final = ('.csv', '.tsv', '.txt', '.dat', '.asc', '.lvm')
REST: Final = 'rest'  # a zero: the mean before the voltage begins to move
_TIME: Final = 'time'
_FEWEST_AT_REST: Final = 10
# Share of the span of the voltage within which it has not begun to move.
_REST_SHARE: Final = 1e-3
_BLOCK_SAMPLES: Final = 1000

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ImportChoice:
    """
    What of a table becomes which stream, and how.

    Attributes
    ----------
    columns : mapping of str to str
        Stream, or ``'time'``, to ``COLUMN`` or ``COLUMN:UNIT``. If empty, columns with the names of
        an exported bag are taken: ``time_s``, ``voltage_v``, ``displacement_um`` …
    scales : mapping of str to float
        Factor of a stream; of a displacement that is in volts the micrometres per volt.
    zeros : mapping of str to float or 'rest'
        What of a stream is 0 in the bag, in the unit of the stream, or of the sensor; ``'rest'``:
        its mean before the voltage begins to move.
    sample_period_s : float, optional
        Sample period, seconds, where no column of times is taken or to check it.
    resample : bool
        Whether to interpolate at even times.
    from_s, to_s : float
        Leave out the rows before and from these times of the file on.
    allow_loss : bool
        Whether samples of the displacement may be missing.

    """

    columns: Mapping[str, str] = field(default_factory=dict)
    scales: Mapping[str, float] = field(default_factory=dict)
    zeros: Mapping[str, float | str] = field(default_factory=dict)
    sample_period_s: float | None = None
    resample: bool = False
    from_s: float = -np.inf
    to_s: float = np.inf
    allow_loss: bool = False


class ImportedBag(NamedTuple):
    """
    What became of a table.

    Attributes
    ----------
    path : Path
        The bag.
    samples : int
        Number of samples.
    sample_period_s : float
        Sample period, seconds.
    streams : mapping of str to (str, float, float)
        Stream to the column that it is made of, and its smallest and largest sample.
    notes : tuple of str
        What a reader should know of it.
    lost : tuple of str
        Sentences that say what is missing.

    """

    path: Path
    samples: int
    sample_period_s: float
    streams: Mapping[str, tuple[str, float, float]]
    notes: tuple[str, ...]
    lost: tuple[str, ...]


class _Source(NamedTuple):
    """A column that becomes a stream or the time."""

    column: Column
    unit: str
    factor: float


def read_table(path: Path) -> Table:
    """
    Find the columns of a file, by its suffix.

    Raises
    ------
    PlanError
        If files of that suffix are not read.
    TableError
        If no table is in it, or the library for it is missing.
    OSError
        If it cannot be read.

    """
    suffix = path.suffix.lower()
    if suffix in READERS:
        with path.open('rb'):  # libraries word it in many ways that there is no such file
            pass
        return READERS[suffix](path)
    if suffix in TEXT_SUFFIXES:
        return read_text_table(path)
    raise PlanError(
        f'{path} ends in {suffix or "no suffix"!r}, allowed are '
        f'{", ".join([*TEXT_SUFFIXES, *READERS])}')


def import_table(path: Path, output: Path, choice: ImportChoice) -> ImportedBag:
    """
    Write the columns of a file as the streams of a bag.

    Parameters
    ----------
    path : Path
        CSV and other texts, MATLAB, HDF5, TDMS, NumPy or Parquet.
    output : Path
        Bag directory; must not exist.
    choice : ImportChoice
        Which columns, units, scales, zeros and time base.

    Returns
    -------
    ImportedBag
        What was written.

    Raises
    ------
    PlanError
        If there is no such column, or a unit, a scale or the time base is not told.
    TableError
        If the rows cannot be used: not even in time, missing, of unequal number.
    BagError
        If the bag exists or cannot be written.

    """
    table = read_table(path)
    sources = _sources(table, choice)
    times = sources.pop(_TIME, None)
    first_row, last_row = 0, None
    rows = {name: _values(table, source.column) for name, source in sources.items()}
    if times is not None:
        rows[_TIME] = _values(table, times.column)
    _check_lengths(table, sources, times, rows)
    if times is not None:
        time_s = rows.pop(_TIME) * times.factor
        first_row, last_row = _part(table, time_s, choice)
        base = time_base(
            str(path), time_s[first_row:last_row], lambda row: table.place(first_row + row),
            sample_period_s=choice.sample_period_s, resample=choice.resample)
    else:
        base, first_row, last_row = _told_base(table, sources, choice, rows)
    rows = {name: values[first_row:last_row] for name, values in rows.items()}
    lost = _check_finite(table, sources, rows, first_row, choice)
    notes = [base.note] if base.note else []
    if base.first_s:
        notes.append(f'0 s of the bag is {base.first_s:.9g} s of the file')
    streams, record = {}, _record(path, sources, times, choice, base)
    for name, source in sources.items():
        zero = _zero(table, name, rows, source, choice, notes)
        if name in choice.zeros:
            record[f'import.{name}'] += f', zero {zero:.17g}'
        streams[name] = base.values(
            _scaled(table, source, rows[name], first_row, zero, choice.scales.get(name, 1.0)))
    _write(output, streams, base.sample_period_s, record)
    return ImportedBag(
        output, base.samples, base.sample_period_s,
        {name: (
            f'{sources[name].column.name!r} in {sources[name].unit}', float(np.nanmin(values)),
            float(np.nanmax(values))) for name, values in streams.items()},
        tuple(notes), lost)


def _sources(table: Table, choice: ImportChoice) -> dict[str, _Source]:
    """Return the column, unit and factor of each stream that is asked for."""
    wanted = dict(choice.columns)
    if not wanted:
        exported = {_TIME: 'time_s', **{stream: label_of(stream) for stream in STREAMS}}
        wanted = {stream: name for stream, name in exported.items() if table.has(name)}
        if not set(wanted) - {_TIME}:
            raise PlanError(
                f'{table.path} has none of the columns {", ".join(exported.values())}; --columns '
                'tells which of its columns is which stream. It has '
                + ', '.join(repr(column.name) for column in table.columns[:12]))
    for name in wanted:
        if name != _TIME and name not in STREAMS:
            raise PlanError(
                f'--columns: {name!r} is no stream, allowed are {_TIME}, {", ".join(STREAMS)}')
    for option, values in (('--scale', choice.scales), ('--zero', choice.zeros)):
        for name in values:
            if name not in wanted or name == _TIME:
                raise PlanError(
                    f'{option}: {name!r} is no stream of --columns, allowed are '
                    f'{", ".join(stream for stream in wanted if stream != _TIME)}')
    if not set(wanted) - {_TIME}:
        raise PlanError('--columns names no stream beside the time')
    return {
        name: _source(table, name, text, choice.scales) for name, text in wanted.items()}


def _source(
    table: Table, name: str, text: str, scales: Mapping[str, float],
) -> _Source:
    """Return the column and the unit that ``COLUMN`` or ``COLUMN:UNIT`` means."""
    quantity = TIME if name == _TIME else STREAMS[name]
    column_name, told = text, None
    if not table.has(text) and ':' in text:
        column_name, _, told = text.rpartition(':')
    column = table.column(column_name)
    unit = told or column.unit
    if unit is None:
        raise PlanError(
            f'--columns: neither {name}={text} nor {table.path} tells the unit of the column '
            f'{column.name!r}; say {name}={text}:UNIT, allowed are {units_text(quantity)}')
    factor = unit_factor(quantity, unit)
    if factor is None and quantity == 'um' and unit in SENSOR_UNITS:
        factor = SENSOR_UNITS[unit]
        if name not in scales:
            raise PlanError(
                f'--columns: {name} is in {unit}, of the column {column.name!r}; --scale '
                f'{name}=FACTOR must tell the micrometres per volt')
    if factor is None:
        raise PlanError(
            f'--columns: the unit of {name}, of the column {column.name!r}, is {unit!r}, allowed '
            f'are {units_text(quantity)}')
    return _Source(column, unit, factor)


def _values(table: Table, column: Column) -> _Floats:
    try:
        return np.asarray(column.read(), dtype=np.float64).ravel()
    except (TypeError, ValueError, OverflowError) as error:
        if isinstance(error, TableError):
            raise
        raise TableError(
            f'{table.path}: the column {column.name!r} is no column of numbers: {error}') from None


def _check_lengths(
    table: Table, sources: Mapping[str, _Source], times: _Source | None,
    rows: Mapping[str, _Floats],
) -> None:
    lengths = {name: values.size for name, values in rows.items()}
    if len(set(lengths.values())) > 1:
        named = {**sources, _TIME: times}
        told = ', '.join(
            f'{source.column.name!r} {length}' for name, length in lengths.items()
            if (source := named[name]))
        raise TableError(f'{table.path}: columns of different length: {told} values')


def _part(table: Table, time_s: _Floats, choice: ImportChoice) -> tuple[int, int]:
    """Return the first row to take, and one past the last."""
    if not np.isfinite(time_s).any():
        raise TableError(f'{table.path}: no row has a time that is a number')
    kept = np.flatnonzero((time_s >= choice.from_s) & (time_s < choice.to_s))
    if not kept.size:
        raise PlanError(
            f'{table.path} has no row from --from-s {choice.from_s:g} to --to-s {choice.to_s:g}, '
            f'it lasts from {np.nanmin(time_s):g} s to {np.nanmax(time_s):g} s')
    # A row without a time is left out only where rows are.
    return (
        0 if choice.from_s == -np.inf else int(kept[0]),
        time_s.size if choice.to_s == np.inf else int(kept[-1]) + 1)


def _told_base(
    table: Table, sources: Mapping[str, _Source], choice: ImportChoice,
    rows: Mapping[str, _Floats],
) -> tuple[TimeBase, int, int]:
    """Return the time base of a table without a column of times, and which rows to take."""
    told = {
        source.column.sample_period_s for source in sources.values()
        if source.column.sample_period_s}
    if len(told) > 1:
        raise TableError(
            f'{table.path}: the columns have the sample periods '
            f'{", ".join(f"{period_s:g}" for period_s in sorted(told))} s, they must have one')
    period_s = choice.sample_period_s or next(iter(told), None)
    if period_s is None:
        raise PlanError(
            f'{table.path} tells no sample period: --columns time=COLUMN:UNIT, --sample-period-s '
            'or --sample-rate-hz must')
    if choice.resample:
        raise PlanError('--resample needs a column of times: --columns time=COLUMN:UNIT')
    size = next(iter(rows.values())).size
    first, last = _part(table, np.arange(size, dtype=np.float64) * period_s, choice)
    if last - first < 2:
        raise TableError(f'{table.path} has {last - first} rows, at least 2 are needed')
    return TimeBase(period_s, last - first, first * period_s), first, last


def _check_finite(
    table: Table, sources: Mapping[str, _Source], rows: Mapping[str, _Floats], first_row: int,
    choice: ImportChoice,
) -> tuple[str, ...]:
    """Refuse rows without a value; return sentences of those that may be missing."""
    lost = []
    for name, values in rows.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if not bad.size:
            continue
        sentence = (
            f'{table.path}: {table.place(first_row + int(bad[0]))} of the column '
            f'{sources[name].column.name!r} is {values[bad[0]]}, {bad.size} of {values.size} rows '
            'are no numbers')
        if name != 'displacement' or choice.resample:
            raise TableError(f'{sentence}; every {name} must be one')
        if not choice.allow_loss:
            raise TableError(f'{sentence}; --allow-loss leaves them out')
        if bad.size == values.size:
            raise TableError(sentence)
        lost.append(sentence)
    return tuple(lost)


def _zero(
    table: Table, name: str, rows: Mapping[str, _Floats], source: _Source, choice: ImportChoice,
    notes: list[str],
) -> float:
    """Return what of a stream is 0 in the bag, in its unit before the scale."""
    zero = choice.zeros.get(name, 0.0)
    if not isinstance(zero, str):
        return zero
    moving = rows.get('voltage')
    if moving is None:
        raise PlanError(f'--zero {name}={REST} needs a voltage among --columns')
    moved = np.flatnonzero(np.abs(moving - moving[0]) > _REST_SHARE * np.ptp(moving))
    count = int(moved[0]) if moved.size else moving.size
    values = rows[name][:count] * source.factor
    values = values[np.isfinite(values)]
    if values.size < _FEWEST_AT_REST:
        raise TableError(
            f'{table.path}: the voltage begins to move after {values.size} rows, --zero '
            f'{name}={REST} needs {_FEWEST_AT_REST}; give the value: --zero {name}=VALUE')
    mean = float(np.mean(values))
    unit = 'V' if source.unit in SENSOR_UNITS else STREAMS[name]
    notes.append(
        f'{name}: zero is {mean:.6g} {unit}, the mean of {values.size} rows before the voltage '
        f'moves (standard deviation {np.std(values):.3g} {unit})')
    return mean


def _scaled(
    table: Table, source: _Source, values: _Floats, first_row: int, zero: float, scale: float,
) -> _Floats:
    """Return values in the unit of the stream, which a wrong unit or scale may take too far."""
    with np.errstate(over='ignore'):  # refused with the row
        scaled = (values * source.factor - zero) * scale
    beyond = np.flatnonzero(np.isinf(scaled))
    if beyond.size:
        raise TableError(
            f'{table.path}: {table.place(first_row + int(beyond[0]))} of the column '
            f'{source.column.name!r} is {values[beyond[0]]:g}, which is beyond all numbers in its '
            'unit and with its scale')
    return np.asarray(scaled)


def _record(
    path: Path, sources: Mapping[str, _Source], times: _Source | None, choice: ImportChoice,
    base: TimeBase,
) -> dict[str, str]:
    """Return the entries that say where the samples of a bag come from."""
    record = {'imported_from': path.name, 'sample_period_s': str(base.sample_period_s)}
    if times is not None:
        record['import.time'] = f'{times.column.name} in {times.unit}'
    if base.note:
        record['import.resampled'] = base.note
    for name, source in sources.items():
        scale = choice.scales.get(name, 1.0)
        record[f'import.{name}'] = f'{source.column.name} in {source.unit}' + (
            f', scale {scale:.17g}' if name in choice.scales else '')
    return record


def _write(
    output: Path, streams: Mapping[str, _Floats], sample_period_s: float,
    record: Mapping[str, str],
) -> None:
    topics = {stream: f'/{stream}' for stream in STREAMS if stream in streams}
    longest = max(values.size for values in streams.values())
    with BagWriter(output, topics=topics, metadata=record) as writer:
        for start in range(0, longest, _BLOCK_SAMPLES):
            for stream in topics:
                block = streams[stream][start:start + _BLOCK_SAMPLES]
                writer.write_block(stream, start, sample_period_s, block)
        for stream in topics:
            writer.write_block(stream, longest, sample_period_s, [])
