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

"""Turns the content of a page into HTML, and collects the files that belong to it."""

import re
from collections.abc import Mapping, Sequence
from itertools import count

from markupsafe import Markup
from matplotlib.figure import Figure

from piezo_ros.report.figures.export import png, svg
from piezo_ros.report.page.chart import chart_json
from piezo_ros.report.page.content import Content, Facts, Paragraph, Picture, Table
from piezo_ros.report.page.inline_svg import inline_svg
from piezo_ros.report.page.rendering import render
from piezo_ros.report.page.tables import row_groups, table_csv

__all__ = ['ElementRenderer']


class ElementRenderer:
    """
    Renders content and collects its tables and figures as files.

    Parameters
    ----------
    files : mapping of str to (str or bytes)
        Files that the page has already.

    Attributes
    ----------
    files : dict of str to (str or bytes)
        Path below the directory of the page -> content: the given files, ``figures/`` and
        ``tables/``.
    has_charts : bool
        Whether a picture that was rendered has an interactive chart.

    """

    def __init__(self, files: Mapping[str, str | bytes]) -> None:
        self.files = dict(files)
        self.has_charts = False

    def render(self, content: Sequence[Content], anchor: str) -> Markup:
        """
        Return content as HTML.

        Parameters
        ----------
        content : sequence of Content
            From top to bottom.
        anchor : str
            Anchor of the section; its tables without a name are named after it.

        Returns
        -------
        Markup
            The HTML.

        Raises
        ------
        ValueError
            If a table has a row of wrong length or a number that is not finite, or if two
            pictures or tables have the same name.

        """
        return Markup('').join(self._element(item, anchor) for item in content)

    def _element(self, item: Content, anchor: str) -> Markup:
        if isinstance(item, Markup):
            return item
        if isinstance(item, Paragraph):
            return render('paragraph', text=item.text)
        if isinstance(item, Facts):
            return render('facts', items=item.items)
        if isinstance(item, Table):
            return self._table(item, anchor)
        if isinstance(item, Picture):
            return self._picture(item)
        return render(
            'fold', title=item.title, is_open=item.is_open,
            content=self.render(item.content, anchor))

    def _table(self, table: Table, anchor: str) -> Markup:
        path = f'tables/{_stem(table.name)}.csv' if table.name else self._next_path(anchor)
        self._add(path, table_csv(table))
        return render(
            'table', caption=table.caption, columns=table.columns, groups=row_groups(table),
            files={'CSV': path})

    def _picture(self, picture: Picture) -> Markup:
        stem = _stem(picture.name)
        figure = picture.figure if isinstance(picture.figure, Figure) else picture.figure()
        document = svg(figure, stem)
        files = {'SVG': f'figures/{stem}.svg', 'PNG': f'figures/{stem}.png'}
        self._add(files['SVG'], document)
        self._add(files['PNG'], png(figure))
        panels = picture.panels() if callable(picture.panels) else picture.panels
        self.has_charts |= bool(panels)
        return render(
            'picture', drawing=inline_svg(document, picture.caption), caption=picture.caption,
            chart=chart_json(stem, picture.caption, panels) if panels else '', files=files)

    def _next_path(self, anchor: str) -> str:
        names = (anchor if number == 1 else f'{anchor}-{number}' for number in count(1))
        return next(
            path for name in names if (path := f'tables/{name}.csv') not in self.files)

    def _add(self, path: str, content: str | bytes) -> None:
        if path in self.files:
            raise ValueError(f'two pictures or tables would be {path}, each needs its own name')
        self.files[path] = content


def _stem(name: str) -> str:
    return re.sub(r'[^A-Za-z0-9.]+', '-', name)
