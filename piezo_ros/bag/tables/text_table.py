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
Tables in text: CSV of any instrument, by comma, semicolon, tab or blanks, decimal comma or point.

Where the numbers begin is found from the end of the first lines: upwards, as long as the lines have
as many fields, and numbers where the last of them has. What stands above are names and units. A
line with numbers in some of these fields is a row with a fault, which is refused.
"""

import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag.tables.table import Column, Table, TableError
from piezo_ros.bag.tables.units import unit_of_name

__all__ = ['read_text_table']

_PROBED_LINES: Final = 400
_DELIMITERS: Final = (';', '\t', ',', None)  # None: blanks
_COMMENTS: Final = ('#', '%')
_UNIT: Final = re.compile(r'\s*[\[(]?\s*([A-Za-zµμÅ%°]+(?:/[A-Za-z]+)?)\s*[\])]?\s*')
_NOT_MEASURED: Final = ('', 'nan', '-nan', 'na', 'n/a', '--', '-')
_DECIMAL_POINT: Final = re.compile(r'\s*[-+]?\d*\.\d+([eE][-+]?\d+)?\s*')
_FRACTION: Final = re.compile(r'0\d+([eE][-+]?\d+)?\s*')
_OTHER_DELIMITER: Final = re.compile(r'.*\d\s*[;\t]\s*[-+.\d]')  # between two numbers
_DECIMAL_COMMA: Final = re.compile(r'\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*')


class _Form(NamedTuple):
    """How the lines of a table are to be read."""

    delimiter: str | None
    decimal_comma: bool
    start: int  # line of the first row, counted from 0
    fields: int
    numeric: tuple[int, ...]  # which of the fields are numbers


def read_text_table(path: Path) -> Table:
    """
    Find the columns of a text file; their values are read when they are asked for.

    Parameters
    ----------
    path : Path
        The file, in UTF-8, UTF-16 or Latin-1.

    Raises
    ------
    TableError
        If no line of numbers is in it.
    OSError
        If it cannot be read.

    """
    lines = _text(path).splitlines()
    form = _form(path, lines)
    names, units = _header(lines, form)
    numbers = [
        number for number, line in enumerate(lines[form.start:], start=form.start + 1)
        if line.strip() and not line.lstrip().startswith(_COMMENTS)]
    cells: dict[int, NDArray[np.float64]] = {}

    def read(column: int) -> NDArray[Any]:
        if not cells:
            cells.update(_values(path, lines, numbers, form))
        return cells[column]

    return Table(path, tuple(
        Column(names[column], lambda column=column: read(column), units[column])  # type: ignore[misc]
        for column in form.numeric), form.start + 1, 'line', numbers)


def _text(path: Path) -> str:
    content = path.read_bytes()
    for mark, encoding in ((b'\xff\xfe', 'utf-16'), (b'\xfe\xff', 'utf-16')):
        if content.startswith(mark):
            return content.decode(encoding)
    if b'\0' in content[:4096]:
        raise TableError(f'{path} is no text: it has bytes of value 0')
    try:
        return content.decode('utf-8-sig')
    except UnicodeDecodeError:
        return content.decode('latin-1')


def _split(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    if '"' in line:
        return next(csv.reader([line], delimiter=delimiter), [])
    return line.split(delimiter)


def _number(cell: str, decimal_comma: bool) -> float | None:
    """Return the value of a cell, NaN for one that says it has none, None for a text."""
    text = cell.strip().strip('"')
    if text.lower() in _NOT_MEASURED:
        return float('nan')
    if decimal_comma and '.' in text:
        return None  # of thousands: 1.234 would be read as a number a thousand times smaller
    try:
        return float(text.replace(',', '.') if decimal_comma else text)
    except ValueError:
        return None


def _form(path: Path, lines: Sequence[str]) -> _Form:
    """Return how to read the lines: the delimiter that gives the most columns of numbers."""
    probe = lines[:_PROBED_LINES]
    forms = [
        form for delimiter in _DELIMITERS for decimal_comma in (False, True)
        if (form := _form_by(probe, delimiter, decimal_comma))]
    if not forms:
        raise TableError(
            f'{path} has no table: no lines with numbers by comma, semicolon, tab or blanks')
    form = max(forms, key=lambda each: (len(each.numeric), len(each.numeric) == each.fields))
    for number, line in enumerate(probe[:form.start], start=1):
        cells = _split(line, form.delimiter)
        if len(cells) == form.fields and all(
                _number(cells[column], form.decimal_comma) is not None
                for column in form.numeric) and _numbers(cells, form.decimal_comma):
            raise TableError(
                f'{path}: line {number} is a row of the table as well, and what stands between it '
                f'and line {form.start + 1} is none; import one table at a time')
    _refuse_unclear_decimals(path, probe, form)
    return form


def _refuse_unclear_decimals(path: Path, probe: Sequence[str], form: _Form) -> None:
    """Refuse a table of which commas or points may be decimal ones, or something else."""
    rows = [_split(line, form.delimiter) for line in probe[form.start:] if line.strip()]
    cells = [cell for row in rows for cell in row]
    point = next((cell for cell in cells if _DECIMAL_POINT.fullmatch(cell)), None)
    if form.delimiter != ',':
        comma = next((cell for cell in cells if _DECIMAL_COMMA.fullmatch(cell)), None)
        if comma and point:
            raise TableError(
                f'{path} has numbers with a comma, {comma.strip()!r}, and with a point, '
                f'{point.strip()!r}: which of them is the decimal one is not known')
        return
    above = [line for line in probe[:form.start] if line.strip()]
    names = len(_split(above[-1], ',')) if above else 0
    # 0,05 has the part 05, which is no whole number as people write it.
    is_fraction = not above and any(_FRACTION.fullmatch(cell) for row in rows for cell in row[1:])
    if point is None and not form.decimal_comma and (
            is_fraction or 0 < names < form.fields <= 2 * names):
        raise TableError(
            f'{path}: line {form.start + 1} has {form.fields} whole numbers, or fewer with decimal '
            'commas, and commas between them: which of these is meant is not known; write it with '
            'decimal points, or with semicolons')


def _form_by(probe: Sequence[str], delimiter: str | None, decimal_comma: bool) -> _Form | None:
    rows: list[list[str]] = [
        [] if not line.strip() or line.lstrip().startswith(_COMMENTS)
        else _split(line, delimiter) for line in probe]
    last = max((i for i, row in enumerate(rows) if row), default=-1)
    while last >= 0 and not _numbers(rows[last], decimal_comma):
        last -= 1
    if last < 0:
        return None
    if delimiter == ',' and any(map(_OTHER_DELIMITER.match, rows[last])):
        return None
    if decimal_comma and not any(_DECIMAL_COMMA.fullmatch(cell) for cell in rows[last]):
        return None
    numeric, start = _numbers(rows[last], decimal_comma), last
    fields = len(rows[last])
    for i in range(last - 1, -1, -1):
        if not rows[i]:
            continue
        above = [
            column for column in numeric if column < len(rows[i])
            and rows[i][column].strip() and _number(rows[i][column], decimal_comma) is not None]
        if len(rows[i]) != fields or not above:
            break
        start = i
    return _Form(delimiter, decimal_comma, start, fields, tuple(numeric))


def _numbers(row: Sequence[str], decimal_comma: bool) -> list[int]:
    """Return which fields of a row are numbers; none where no field has a value."""
    values = [_number(cell, decimal_comma) for cell in row]
    if all(value is None or value != value for value in values):
        return []
    # The end of a line may have one delimiter more.
    return [
        column for column, (value, cell) in enumerate(zip(values, row, strict=True))
        if value is not None and (cell.strip() or column < len(row) - 1)]


def _header(lines: Sequence[str], form: _Form) -> tuple[list[str], list[str | None]]:
    """Return the names and the units of all fields, from the lines above the first row."""
    names = [str(column + 1) for column in range(form.fields)]
    units: list[str | None] = [None] * form.fields
    above = _cells_above(lines, form)
    if above and _are_units(above[0]):
        told = above.pop(0)
        for column, cell in enumerate(told[:form.fields]):
            found = _UNIT.fullmatch(cell)
            units[column] = found[1] if found else None
    if above and len(above[0]) >= form.fields:
        for column, cell in enumerate(above[0][:form.fields]):
            names[column] = cell.strip().strip('"') or names[column]
    return names, [unit or unit_of_name(name) for unit, name in zip(units, names, strict=True)]


def _cells_above(lines: Sequence[str], form: _Form) -> list[list[str]]:
    """Return the fields of the two lines above the first row, the nearest first."""
    above: list[list[str]] = []
    for line in reversed(lines[:form.start]):
        text = line.strip()
        if text.startswith(_COMMENTS):
            text = text.lstrip('#% ')
            cells = _split(text, form.delimiter)
        else:
            cells = _split(line if form.delimiter == '\t' else text, form.delimiter)
        if not text:
            if above:
                break
            continue
        if len(cells) < form.fields:
            break
        above.append(cells)
        if len(above) == 2:
            break
    return above


def _are_units(cells: Sequence[str]) -> bool:
    """Return whether every field is a unit, such as ``(ms)``; a name may look like one."""
    from piezo_ros.bag.tables.units import FACTORS
    known = {unit for units in FACTORS.values() for unit in units}
    found = [_UNIT.fullmatch(cell) for cell in cells if cell.strip()]
    return bool(found) and all(found) and any(each and each[1] in known for each in found)


def _values(
    path: Path, lines: Sequence[str], numbers: Sequence[int], form: _Form,
) -> dict[int, NDArray[np.float64]]:
    """Return the columns: by NumPy's reader where every cell is a number, else one by one."""
    body = [lines[number - 1] for number in numbers]
    if not form.decimal_comma:
        try:
            table = np.loadtxt(
                io.StringIO('\n'.join(body)), delimiter=form.delimiter, usecols=form.numeric,
                ndmin=2, comments=None, dtype=np.float64)
        except ValueError:
            pass
        else:
            if table.shape[0] == len(body):
                return {column: table[:, i] for i, column in enumerate(form.numeric)}
    return _values_one_by_one(path, body, numbers, form)


def _values_one_by_one(
    path: Path, body: Sequence[str], numbers: Sequence[int], form: _Form,
) -> dict[int, NDArray[np.float64]]:
    columns: dict[int, list[float]] = {column: [] for column in form.numeric}
    for number, line in zip(numbers, body, strict=True):
        cells = _split(line, form.delimiter)
        for column, values in columns.items():
            cell = cells[column] if column < len(cells) else ''
            value = _number(cell, form.decimal_comma)
            if value is None:
                raise TableError(
                    f'{path}: line {number}, column {column + 1} is {cell.strip()!r}, it must be '
                    'a number, or empty where nothing was measured')
            values.append(value)
    return {column: np.array(values) for column, values in columns.items()}
