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

r"""
Tables of a frequency response, of this package and of others, as named columns of numbers.

A table has one line per frequency. Its columns are named by a header, which may be a comment, and
their units by the names: ``frequency_hz``, ``Frequency (Hz)``, ``omega [rad/s]``, ``mag_db``,
``phase_deg``, ``Re(H)``. Touchstone files, with one port or with two (S21), are read too.

Examples
--------
>>> table = parse_table('# f (kHz);Mag (dB);Phase (rad)\n1,5;20,0;0,0\n', 'a.csv')
>>> table.columns['frequency'].tolist(), table.columns['real'].tolist()
([1500.0], [10.0])

"""

import csv
import math
import re
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ['ResponseTable', 'parse_table']

_COMMENTS: Final = ('#', '%', '!', '//')
_ALLOWED: Final = (
    'allowed are frequency_hz (or rad/s, kHz), gain or magnitude (linear or dB) with phase_deg or '
    'phase_rad, or real and imaginary; and standard_error, coherence, amplitude, offset')
# Words of a name, in lower case and without unit, to the quantity.
_QUANTITIES: Final = {
    'frequency': ('frequency', 'freq', 'f', 'omega', 'w', 'ω'),
    'magnitude': ('magnitude', 'mag', 'gain', 'abs', '|h|', '|g|', 'modulus', 'abs(h)', 'abs(g)'),
    'phase': ('phase', 'ph', 'angle', 'arg', 'arg(h)', 'arg(g)'),
    'real': ('real', 're', 're(h)', 're(g)'),
    'imaginary': ('imaginary', 'imag', 'im', 'im(h)', 'im(g)'),
    'standard_error': ('standard_error', 'stderr', 'std', 'sigma', 'se'),
    'confidence_radius': ('confidence_radius',),
    'coherence': ('coherence', 'coh', 'gamma2', 'γ2', 'γ²'),
    'distortion': ('distortion',),
    'amplitude': ('amplitude',),
    'offset': ('offset',),
    'sample_period': ('sample_period',),
    'left_out': ('left_out',),
}
_QUANTITY_OF: Final = {name: key for key, names in _QUANTITIES.items() for name in names}
_UNITS: Final = {  # to hertz, radians, linear, micrometres or volts
    'hz': ('hz', 1.0), 'khz': ('hz', 1e3), 'ghz': ('hz', 1e9), 'rad/s': ('rad/s', 1.0),
    'deg': ('deg', 1.0), 'degree': ('deg', 1.0), 'degrees': ('deg', 1.0), '°': ('deg', 1.0),
    'rad': ('rad', 1.0), 'radian': ('rad', 1.0), 'radians': ('rad', 1.0), 'db': ('db', 1.0),
    'um/um': ('um/um', 1.0), 'nm/nm': ('um/um', 1.0), 'm/m': ('um/um', 1.0),
    'um/v': ('um/v', 1.0), 'nm/v': ('um/v', 1e-3), 'm/v': ('um/v', 1e6),
    'um': ('um', 1.0), 'nm': ('um', 1e-3), 'v': ('v', 1.0), 'mv': ('v', 1e-3), 's': ('s', 1.0),
    'linear': ('', 1.0), 'lin': ('', 1.0), '1': ('', 1.0), '-': ('', 1.0), '': ('', 1.0),
}
_PHYSICAL: Final = ('', 'db', 'um/um', 'um/v')
_UNITS_OF: Final = {
    'frequency': ('', 'hz', 'rad/s'), 'magnitude': _PHYSICAL, 'phase': ('', 'deg', 'rad'),
    'real': _PHYSICAL, 'imaginary': _PHYSICAL, 'standard_error': _PHYSICAL,
    'confidence_radius': _PHYSICAL, 'amplitude': ('', 'um', 'v'), 'offset': ('', 'um', 'v'),
    'sample_period': ('', 's'),
}
_NUMBER: Final = re.compile(r'[-+]?(\d+[.,]?\d*|[.,]\d+)([eEdD][-+]?\d+)?|[-+]?(nan|inf\w*)', re.I)
_TOUCHSTONE: Final = re.compile(
    r'#\s*(?P<frequency>hz|khz|mhz|ghz)\s+[syzhg]\s+(?P<form>db|ma|ri)\b', re.I)
_TOUCHSTONE_HERTZ: Final = {'hz': 1.0, 'khz': 1e3, 'mhz': 1e6, 'ghz': 1e9}
_TOUCHSTONE_COLUMNS: Final = {
    'db': ('magnitude_db', 'phase_deg'), 'ma': ('magnitude', 'phase_deg'),
    'ri': ('real', 'imaginary')}
_TWO_PORT_COLUMNS: Final = 9


class ResponseTable(NamedTuple):
    """
    The columns of a table, in hertz, micrometres, volts and seconds, NaN where a cell is empty.

    Attributes
    ----------
    columns : dict of str to ndarray, shape (N,)
        By quantity; ``frequency``, ``real`` and ``imaginary`` are always there.
    lines : tuple of int
        Number of the line of each row, from 1.
    left_out : tuple of str
        Why a row has been left out, '' for the others.
    input_unit : str
        ``'um'`` or ``'v'``, '' where no column says it.
    sample_period_s : float
        As a comment says it, else 0.

    """

    columns: dict[str, NDArray[np.float64]]
    lines: tuple[int, ...]
    left_out: tuple[str, ...]
    input_unit: str
    sample_period_s: float


class _Column(NamedTuple):
    name: str  # as in the file
    quantity: str
    unit: str
    factor: float


class _Row(NamedTuple):
    line: int
    cells: list[str]


def parse_table(text: str, name: str) -> ResponseTable:
    """
    Return the columns of a table.

    Parameters
    ----------
    text : str
        Content of the file.
    name : str
        Name of the file, for errors.

    Raises
    ------
    ValueError
        If a column or a value is not one of a frequency response; the message says where.

    """
    rows, comments = _rows(text)
    columns, rows = _header(rows, comments, name)
    if not rows:
        raise ValueError(f'{name} has no line with numbers')
    values: dict[str, list[float]] = {
        column.quantity: [] for column in columns if column.quantity not in ('', 'left_out')}
    reasons = []
    for row in rows:
        if len(row.cells) != len(columns):
            raise ValueError(
                f'{name}, line {row.line} has {len(row.cells)} values, the header has '
                f'{len(columns)} columns')
        reason = ''
        for column, cell in zip(columns, row.cells, strict=True):
            if column.quantity == 'left_out':
                reason = cell
            elif column.quantity:
                values[column.quantity].append(
                    column.factor * _value(cell, column, row.line, name))
        reasons.append(reason)
    arrays = {key: np.array(column) for key, column in values.items()}
    units = {column.quantity: column.unit for column in columns}
    response_units = {units[key] for key in ('magnitude', 'real') if key in units}
    input_unit = (
        'v' if 'um/v' in response_units or units.get('amplitude') == 'v'
        else 'um' if 'um/um' in response_units or units.get('amplitude') == 'um' else '')
    return ResponseTable(
        _standard(arrays, units, rows, name), tuple(row.line for row in rows), tuple(reasons),
        input_unit, _commented_period_s(comments))


def _rows(text: str) -> tuple[list[_Row], list[_Row]]:
    """Return the lines that are no comments, split into cells, and those that are, whole."""
    rows: list[_Row] = []
    comments: list[_Row] = []
    separator: str | None = None
    for number, line in enumerate(text.lstrip('\ufeff').splitlines(), start=1):
        stripped = line.strip()
        if stripped.startswith(_COMMENTS):
            comments.append(_Row(number, [stripped]))
        elif stripped:
            if not rows:
                separator = _separator(stripped)
            # A Touchstone comment may follow the numbers of a line.
            rows.append(_Row(number, _cells(stripped.partition(' !')[0], separator)))
    return rows, comments


def _separator(line: str) -> str | None:
    """Return what separates the cells of the first line, None for blanks."""
    for separator in (';', '\t', ','):
        if separator in line and not (separator == ',' and _decimal_comma(line)):
            return separator
    return None


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    (cells,) = csv.reader([line], delimiter=separator, skipinitialspace=True)
    return [cell.strip() for cell in cells]


def _decimal_comma(line: str) -> bool:
    """Whether the commas of a line without other separators than blanks are decimal ones."""
    words = line.split()
    return len(words) > 1 and all(re.fullmatch(r'[-+]?\d+(,\d+)?(e[-+]?\d+)?', word, re.I)
                                  for word in words)


def _header(
    rows: list[_Row], comments: list[_Row], name: str,
) -> tuple[list[_Column], list[_Row]]:
    """Return the columns, and the rows below the header."""
    for comment in comments:
        option = _TOUCHSTONE.match(comment.cells[0])
        if option and rows:
            return _touchstone(option, rows, name)
    if rows and not all(_NUMBER.fullmatch(cell) for cell in rows[0].cells if cell):
        return _columns(rows[0], name), rows[1:]
    for comment in reversed(comments):
        if not rows or comment.line > rows[0].line:
            continue
        words = _header_cells(comment.cells[0].lstrip('#%!/ '), len(rows[0].cells))
        if words is not None:
            return _columns(_Row(comment.line, words), name), rows
    first = rows[0].line if rows else 1
    raise ValueError(f'{name}, line {first}: no header names the columns; {_ALLOWED}')


def _header_cells(text: str, count: int) -> list[str] | None:
    """Return the names of a header in a comment, None if it is an ordinary comment."""
    candidates = [
        _cells(text, _separator(text)), re.split(r'\s{2,}', text),
        re.findall(r'\S+(?:\s*[(\[][^)\]]*[)\]])?', text)]
    for cells in candidates:
        if len(cells) == count and any(_split(cell)[0] == 'frequency' for cell in cells):
            return cells
    return None


def _touchstone(
    option: 're.Match[str]', rows: list[_Row], name: str,
) -> tuple[list[_Column], list[_Row]]:
    count = len(rows[0].cells)
    if count not in (3, _TWO_PORT_COLUMNS):
        raise ValueError(
            f'{name}, line {rows[0].line} has {count} values, of a Touchstone file 3 (one port) '
            f'or {_TWO_PORT_COLUMNS} (two ports, of which S21 is taken) are read')
    wanted = [
        _column(each, option.string, name) for each in _TOUCHSTONE_COLUMNS[option['form'].lower()]]
    ignored = _Column('', '', '', 1.0)
    before = 0 if count == 3 else 2
    frequency = _Column(
        'frequency', 'frequency', 'hz', _TOUCHSTONE_HERTZ[option['frequency'].lower()])
    return [
        frequency, *[ignored] * before, *wanted, *[ignored] * (count - 3 - before)], rows


def _columns(row: _Row, name: str) -> list[_Column]:
    columns = [_column(cell, f'line {row.line}', name) for cell in row.cells]
    known = [column.quantity for column in columns]
    if not {'magnitude', 'real'} & set(known) and 'amplitude' in known:
        # Without another one, the amplitude is that of the response.
        columns = [column._replace(quantity='magnitude') if column.quantity == 'amplitude'
                   else column for column in columns]
        known = [column.quantity for column in columns]
    for quantity in set(known) - {''}:
        if known.count(quantity) > 1:
            twice = [column.name for column in columns if column.quantity == quantity]
            # A response may be told twice, by parts and by magnitude: one of each is enough.
            raise ValueError(
                f'{name}, line {row.line}: the columns {", ".join(twice)} are all the {quantity}, '
                'allowed is one')
    missing = [] if 'frequency' in known else ['frequency']
    if not ({'real', 'imaginary'} <= set(known) or {'magnitude', 'phase'} <= set(known)):
        missing.append('response')
    if missing:
        raise ValueError(
            f'{name}, line {row.line}: no column for the {" and the ".join(missing)} among '
            f'{", ".join(row.cells)}; {_ALLOWED}')
    return columns


def _split(cell: str) -> tuple[str, str]:
    """Return quantity and unit of a name, '' for a quantity that is not known."""
    text = cell.strip().strip('"').replace('µ', 'u').replace('μ', 'u')
    bracket = re.fullmatch(r'(.*?)\s*[(\[]([^()\[\]]*)[)\]]', text)
    if bracket and bracket[2].lower() not in ('h', 'g'):
        body, unit = bracket[1], bracket[2]
    else:
        body, unit = text, ''
        lowered = text.lower().replace('_per_', '/')
        for candidate in sorted(_UNITS, key=len, reverse=True):
            if len(candidate) > 0 and lowered.endswith(('_' + candidate, ' ' + candidate)):
                body, unit = lowered[:-len(candidate) - 1], candidate
                break
    unit = unit.strip()
    if unit == 'MHz':
        return _QUANTITY_OF.get(_word(body), ''), 'MHz'
    word = _word(body)
    quantity = _QUANTITY_OF.get(word, '')
    if not unit and word in ('omega', 'w', 'ω'):
        unit = 'rad/s'
    return quantity, unit.lower().replace(' ', '').replace('_per_', '/')


def _word(body: str) -> str:
    return re.sub(r'[\s_]+', '_', body.strip().lower()).strip('_.')


def _column(cell: str, where: str, name: str) -> _Column:
    quantity, unit = _split(cell)
    if not quantity:
        return _Column(cell, '', '', 1.0)
    if unit == 'MHz':
        return _Column(cell, quantity, 'hz', 1e6)
    standard = _UNITS.get(unit)
    allowed = _UNITS_OF.get(quantity, ('',))
    if standard is None or standard[0] not in allowed:
        raise ValueError(
            f'{name}, {where}: the column {cell!r} has the unit {unit!r}, allowed for the '
            f'{quantity} are {", ".join(each or "none" for each in allowed)}')
    return _Column(cell, quantity, *standard)


def _value(cell: str, column: _Column, line: int, name: str) -> float:
    if not cell:
        return math.nan
    if not _NUMBER.fullmatch(cell):
        raise ValueError(
            f'{name}, line {line}, column {column.name!r}: the value {cell!r} is no number')
    return float(cell.replace(',', '.').replace('d', 'e').replace('D', 'e'))


def _standard(
    arrays: dict[str, NDArray[np.float64]], units: dict[str, str], rows: list[_Row], name: str,
) -> dict[str, NDArray[np.float64]]:
    """Return frequency in hertz, real and imaginary part in place of what the table has."""
    columns = dict(arrays)
    if units['frequency'] == 'rad/s':
        columns['frequency'] = columns['frequency'] / (2.0 * np.pi)
    for row, value in zip(rows, columns['frequency'].tolist(), strict=True):
        if not (math.isfinite(value) and value >= 0.0):
            raise ValueError(
                f'{name}, line {row.line}: the frequency is {value:g} Hz, it must be at least 0 '
                'and finite')
    if not {'real', 'imaginary'} <= columns.keys():
        magnitude = columns['magnitude']
        if units['magnitude'] == 'db':
            magnitude = 10.0**(magnitude / 20.0)
        elif (magnitude < 0.0).any():
            row = rows[int(np.argmax(magnitude < 0.0))]
            raise ValueError(
                f'{name}, line {row.line}: the magnitude is {np.nanmin(magnitude):g}, it must be '
                'at least 0; name the column magnitude_db if it is in decibel')
        phase = columns['phase']
        if units['phase'] == 'deg':
            phase = np.deg2rad(phase)
        elif units['phase'] == '':
            if not np.nanmax(np.abs(phase), initial=0.0) > 4.0 * np.pi:
                raise ValueError(
                    f'{name}: the phase has no unit, and its values up to '
                    f'{np.nanmax(np.abs(phase), initial=0.0):.3g} may be degrees or radians; '
                    'allowed names are phase_deg and phase_rad')
            phase = np.deg2rad(phase)
        columns['real'] = magnitude * np.cos(phase)
        columns['imaginary'] = magnitude * np.sin(phase)
    for key in ('magnitude', 'phase'):
        columns.pop(key, None)
    return columns


def _commented_period_s(comments: list[_Row]) -> float:
    for comment in comments:
        found = re.search(r'sample[ _]period(?:_s)?\s*[:=]?\s*([\d.]+(?:e[-+]?\d+)?)',
                          comment.cells[0], re.I)
        if found:
            return float(found[1])
    return 0.0
