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

"""Turns a table of the page into HTML with rounded numbers, and into CSV with exact ones."""

import csv
import io
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from piezo_ros.report.columns import Column, Value, value_text
from piezo_ros.report.page.content import Cell, Heading, Table

__all__ = ['RowGroup', 'ShownCell', 'row_groups', 'table_csv']

_MINUS: Final = '\N{MINUS SIGN}'


class ShownCell(NamedTuple):
    """
    A cell as the template of tables shows it.

    Attributes
    ----------
    text : str
        The value, rounded.
    power_of_ten : str
        Exponent of a factor 10 that follows the text; empty without one.
    scheme, link : str
        As in `Cell`.
    strong : bool
        As in `Cell`.

    """

    text: str
    power_of_ten: str
    scheme: str
    link: str
    strong: bool


class RowGroup(NamedTuple):
    """
    Rows under one heading, or under none.

    Attributes
    ----------
    heading : str
        Title of the rows; empty without one.
    rows : list of list of (Column, ShownCell)
        The cells of each row with their columns.

    """

    heading: str
    rows: list[list[tuple[Column, ShownCell]]]


def row_groups(table: Table) -> list[RowGroup]:
    """
    Return the rows of a table as text, grouped by their headings.

    Parameters
    ----------
    table : Table
        The table.

    Returns
    -------
    list of RowGroup
        From top to bottom.

    Raises
    ------
    ValueError
        If a row has not one value for each column, or a number is not finite.

    """
    groups: list[RowGroup] = []
    for row in table.rows:
        if isinstance(row, Heading):
            groups.append(RowGroup(row.text, []))
            continue
        if not groups:
            groups.append(RowGroup('', []))
        groups[-1].rows.append(_shown_row(table, row))
    return groups


def table_csv(table: Table) -> str:
    """
    Return a table as CSV.

    Parameters
    ----------
    table : Table
        The table.

    Returns
    -------
    str
        Column titles with units, then the rows with exact numbers. The headings of rows, if there
        are any, become a first column ``group``.

    """
    text = io.StringIO(newline='')
    writer = csv.writer(text, lineterminator='\n')
    group = [''] if any(isinstance(row, Heading) for row in table.rows) else []
    titles = [
        f'{column.title} ({column.unit})' if column.unit else column.title
        for column in table.columns]
    writer.writerow([*(['group'] if group else []), *titles])
    for row in table.rows:
        if isinstance(row, Heading):
            group = [row.text]
        else:
            writer.writerow([
                *group, *(cell.value if isinstance(cell, Cell) else cell for cell in row)])
    return text.getvalue()


def _shown_row(
    table: Table, row: Sequence[Value | Cell],
) -> list[tuple[Column, ShownCell]]:
    if len(row) != len(table.columns):
        raise ValueError(
            f'table {table.caption!r} has {len(table.columns)} columns and a row of {len(row)}: '
            f'{list(row)}')
    return [
        (column, _shown_cell(table, column, value if isinstance(value, Cell) else Cell(value)))
        for column, value in zip(table.columns, row, strict=True)]


def _shown_cell(table: Table, column: Column, cell: Cell) -> ShownCell:
    text, power_of_ten = value_text(cell.value, column), ''
    if column.format_spec and isinstance(cell.value, int | float):
        if not math.isfinite(cell.value):
            raise ValueError(
                f'table {table.caption!r}, column {column.title!r} holds {cell.value}, it must be '
                'finite or None')
        text, _, exponent = text.partition('e')
        if exponent and int(exponent):
            power_of_ten = str(int(exponent)).replace('-', _MINUS)
        text = text.replace('-', _MINUS)
    return ShownCell(text, power_of_ten, cell.scheme, cell.link, cell.strong)
