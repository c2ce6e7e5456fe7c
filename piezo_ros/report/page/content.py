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
What a page of a report is made of, before anything is drawn or written.

A page has sections, a section has content: paragraphs, facts, tables, pictures, folds, and HTML
from templates of this package (`markupsafe.Markup`). All other text is escaped.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Union

from markupsafe import Markup
from matplotlib.figure import Figure

from piezo_ros.report.columns import Column, Value
from piezo_ros.report.page.chart import Panel
from piezo_ros.report.page.curve_panel import CurvePanel

__all__ = [
    'Cell',
    'Column',
    'Content',
    'Facts',
    'Fold',
    'Heading',
    'Paragraph',
    'Picture',
    'Section',
    'Table',
    'Value',
]

Panels = Sequence[Panel | CurvePanel]


@dataclass(frozen=True)
class Paragraph:
    """
    A paragraph.

    Attributes
    ----------
    text : str
        Plain text.

    """

    text: str


@dataclass(frozen=True)
class Facts:
    """
    A few numbers in large type, for the head of a page or a section.

    Attributes
    ----------
    items : sequence of (str, str)
        A value and its meaning.

    """

    items: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Cell:
    """
    A value of a `Table` with a link, a colour or in bold.

    Attributes
    ----------
    value : str, int, float or None
        The value; None is unknown.
    scheme : str
        Control scheme; a patch of its colour stands before the value.
    link : str
        A file beside the page, or a section of the page as ``'#anchor'``.
    strong : bool
        Whether to set the value in bold.

    """

    value: Value
    scheme: str = ''
    link: str = ''
    strong: bool = False


@dataclass(frozen=True)
class Heading:
    """
    A row of a `Table` that is the title of the rows below it.

    Attributes
    ----------
    text : str
        What the rows have in common.

    """

    text: str


@dataclass(frozen=True)
class Table:
    """
    A table: rounded numbers on the page, full precision in a CSV file.

    Attributes
    ----------
    columns : sequence of Column
        From left to right; the first has the name of the row.
    rows : sequence of Heading or of sequences of values
        A value is a str, int, float, None (unknown, shown as a dash) or a `Cell`.
    caption : str
        Plain text above the table; may be empty.
    name : str
        Stem of the CSV file; by default that of the section.

    """

    columns: Sequence[Column]
    rows: Sequence[Heading | Sequence[Value | Cell]]
    caption: str = ''
    name: str = ''


@dataclass(frozen=True)
class Picture:
    """
    A figure, drawn on the page and written as SVG and PNG files; a chart where it has panels.

    Attributes
    ----------
    name : str
        Stem of the files.
    caption : str
        Plain text below the figure; screen readers read it in place of the figure.
    figure : Figure or callable
        The figure, or a function that draws it when the page is written.
    panels : sequence of Panel or CurvePanel, or callable
        The same as an interactive chart, or a function that makes it. It takes the place of the
        figure on a screen; the figure is printed, and written as files. Empty without a chart.

    """

    name: str
    caption: str
    figure: Figure | Callable[[], Figure]
    panels: Panels | Callable[[], Panels] = ()


@dataclass(frozen=True)
class Fold:
    """
    Content under a title that the reader can open and close.

    Attributes
    ----------
    title : str
        Plain text.
    content : sequence of Content
        From top to bottom.
    is_open : bool
        Whether the content is visible at first.

    """

    title: str
    content: Sequence['Content']
    is_open: bool = False


# Of the typing module: a forward reference and | do not go together before Python 3.14.
Content = Union[Paragraph, Facts, Table, Picture, Fold, Markup]  # noqa: UP007


@dataclass(frozen=True)
class Section:
    """
    One section of a page, with an entry in the list of contents.

    Attributes
    ----------
    anchor : str
        Its identifier on the page: letters, digits, ``-`` and ``_``, beginning with a letter.
    title : str
        Plain text.
    content : sequence of Content
        From top to bottom.

    """

    anchor: str
    title: str
    content: Sequence[Content]
