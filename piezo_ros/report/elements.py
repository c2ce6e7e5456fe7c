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

"""From the content of a page to its HTML and to the files beside it."""

import csv
import io
import math
import re
from collections.abc import Sequence
from html import escape
from itertools import count
from typing import Final
from urllib.parse import quote

from matplotlib.figure import Figure

from piezo_ros.report.content import (
    Cell,
    Column,
    Content,
    Facts,
    Heading,
    Paragraph,
    Picture,
    Raw,
    Section,
    Table,
    Value,
)
from piezo_ros.report.rendering import inline_svg, png, svg

__all__ = ['Renderer', 'table_html']

_ABSENT: Final = '–'
_MINUS: Final = '\N{MINUS SIGN}'
# A table of fewer columns, pulled to the width of the page, is hard to read along.
_FULL_WIDTH_COLUMNS: Final = 7


class Renderer:
    """
    Turns sections into HTML and gathers the files that go with them.

    Attributes
    ----------
    files : dict of str to (str or bytes)
        Path below the directory of the page to content: ``figures/`` and ``tables/``.

    """

    def __init__(self) -> None:
        self.files: dict[str, str | bytes] = {}

    def section(self, section: Section) -> str:
        """
        Return a section as HTML.

        Raises
        ------
        ValueError
            If its anchor is not one, a table is ragged or holds a number that is not finite, or
            a picture or table is named as an earlier one.

        """
        if not re.fullmatch(r'[A-Za-z][\w-]*', section.anchor, re.ASCII):
            raise ValueError(
                f'anchor of section {section.title!r} is {section.anchor!r}, it must be of '
                'letters, digits, - and _, and begin with a letter')
        return (f'<section id="{section.anchor}">\n<h2>{escape(section.title)}</h2>\n'
                f'{self.content(section.content, section.anchor)}</section>\n')

    def content(self, content: Sequence[Content], anchor: str) -> str:
        """Return what is inside of the section with an anchor as HTML."""
        return ''.join(self._element(item, anchor) for item in content)

    def _element(self, item: Content, anchor: str) -> str:
        if isinstance(item, Paragraph):
            return f'<p>{escape(item.text)}</p>\n'
        if isinstance(item, Raw):
            return item.html
        if isinstance(item, Facts):
            return _facts(item)
        if isinstance(item, Table):
            return self._table(item, anchor)
        if isinstance(item, Picture):
            return self._picture(item)
        is_open = ' open' if item.is_open else ''
        return (f'<details class="case"{is_open}>\n<summary><h3>{escape(item.title)}</h3>'
                f'</summary>\n{self.content(item.content, anchor)}</details>\n')

    def _table(self, table: Table, anchor: str) -> str:
        path = f'tables/{_stem(table.name)}.csv' if table.name else next(
            name for number in count(1)
            if (name := f'tables/{anchor}{f"-{number}" if number > 1 else ""}.csv')
            not in self.files)
        element = table_html(table)
        self._add(path, _table_csv(table))
        caption = f'{escape(table.caption)} ' if table.caption else ''
        return (f'<figure class="table">\n<figcaption>{caption}{_file_links({"CSV": path})}'
                f'</figcaption>\n{element}</figure>\n')

    def _picture(self, picture: Picture) -> str:
        stem = _stem(picture.name)
        caption, links = escape(picture.caption), ''
        if isinstance(picture.figure, str):
            element = picture.figure
        else:
            figure = picture.figure if isinstance(picture.figure, Figure) else picture.figure()
            document = svg(figure, stem)
            element = inline_svg(document, caption)
            paths = {kind.upper(): f'figures/{stem}.{kind}' for kind in ('svg', 'png')}
            self._add(paths['SVG'], document)
            self._add(paths['PNG'], png(figure))
            links = f' {_file_links(paths)}'
        return (f'<figure class="plot">\n{element}\n<figcaption>{caption}{links}</figcaption>\n'
                '</figure>\n')

    def _add(self, path: str, content: str | bytes) -> None:
        if path in self.files:
            raise ValueError(f'two pictures or tables would be {path}, each needs its own name')
        self.files[path] = content


def table_html(table: Table) -> str:
    """
    Return a table as HTML without caption and files.

    Parameters
    ----------
    table : Table
        The table.

    Returns
    -------
    str
        A ``<table>`` in a box that scrolls when it is too wide.

    Raises
    ------
    ValueError
        If a row has not one value for each column, or a number is not finite.

    """
    heads = ''.join(
        f'<th scope="col"{_alignment(column)}>{escape(column.title)}'
        f'{f"<small>{escape(column.unit)}</small>" if column.unit else ""}</th>'
        for column in table.columns)
    body, is_new = '', True
    for row in table.rows:
        if isinstance(row, Heading):
            body += '' if is_new else '</tbody>\n<tbody>\n'
            body += (f'<tr><th class="case" scope="rowgroup" colspan="{len(table.columns)}">'
                     f'{escape(row.text)}</th></tr>\n')
        else:
            body += _row(table, row)
        is_new = False
    width = ' full' if len(table.columns) >= _FULL_WIDTH_COLUMNS else ''
    return (f'<div class="wide"><table class="results{width}">\n<thead><tr>{heads}</tr></thead>\n'
            f'<tbody>\n{body}</tbody>\n</table></div>\n')


def _row(table: Table, row: Sequence[Value | Cell]) -> str:
    _require_whole(table, row)
    first, *others = [
        _cell_html(table, column, value) for column, value in zip(table.columns, row, strict=True)]
    cells = ''.join(
        f'<td{_alignment(column, value)}>{text}</td>'
        for column, value, text in zip(table.columns[1:], row[1:], others, strict=True))
    return f'<tr><th scope="row"{_alignment(table.columns[0])}>{first}</th>{cells}</tr>\n'


def _cell_html(table: Table, column: Column, value: Value | Cell) -> str:
    cell = value if isinstance(value, Cell) else Cell(value)
    text = escape(_text(table, column, cell.value))
    if column.form and not isinstance(cell.value, str):
        text = re.sub(r'e\+00$', '', text)
        text = re.sub(
            r'e([+−])0?(\d+)$',
            lambda found: f' · 10<sup>{found[1].strip("+")}{found[2]}</sup>', text)
    if cell.strong:
        text = f'<strong>{text}</strong>'
    if cell.link:
        # A colon makes a scheme of what is before it: quoted, it is part of a file name.
        link = cell.link if cell.link.startswith('#') else quote(cell.link)
        text = f'<a href="{escape(link)}">{text}</a>'
    if cell.scheme:
        text = f'<span class="chip {re.sub(r"[^a-z0-9]+", "-", cell.scheme)}"></span>{text}'
    return text


def _text(table: Table, column: Column, value: Value) -> str:
    if value is None:
        return _ABSENT
    if isinstance(value, str) or not column.form:
        return str(value)
    if not math.isfinite(value):
        where = f'{table.caption!r}, column {column.title!r}'
        raise ValueError(f'table {where} holds {value}, it must be finite or None')
    return format(value, column.form).replace('-', _MINUS)


def _table_csv(table: Table) -> str:
    """Return a table as CSV; headings of rows become a column of their own, the first."""
    text = io.StringIO(newline='')
    writer = csv.writer(text, lineterminator='\n')
    group = '' if any(isinstance(row, Heading) for row in table.rows) else None
    heads = [f'{column.title} ({column.unit})' if column.unit else column.title
             for column in table.columns]
    writer.writerow(heads if group is None else ['group', *heads])
    for row in table.rows:
        if isinstance(row, Heading):
            group = row.text
            continue
        values = [cell.value if isinstance(cell, Cell) else cell for cell in row]
        writer.writerow(values if group is None else [group, *values])
    return text.getvalue()


def _require_whole(table: Table, row: Sequence[Value | Cell]) -> None:
    if len(row) != len(table.columns):
        raise ValueError(
            f'table {table.caption!r} has {len(table.columns)} columns and a row of {len(row)}: '
            f'{list(row)}')


def _facts(facts: Facts) -> str:
    items = ''.join(
        f'<div><dt>{escape(what)}</dt><dd>{escape(value)}</dd></div>\n'
        for value, what in facts.items)
    return f'<dl class="facts">\n{items}</dl>\n'


def _file_links(paths: dict[str, str]) -> str:
    links = ', '.join(f'<a href="{path}">{kind}</a>' for kind, path in paths.items())
    return f'<span class="files">{links}</span>'


def _stem(name: str) -> str:
    return re.sub(r'[^A-Za-z0-9.]+', '-', name)


def _alignment(column: Column, value: Value | Cell = None) -> str:
    if isinstance(value, Cell) and value.link and not column.form:
        return ' class="link"'
    return ' class="number"' if column.form else ''
