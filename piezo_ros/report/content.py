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

"""What a page of a report is made of, before anything of it is drawn or written."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Union

from matplotlib.figure import Figure

__all__ = [
    'Cell',
    'Column',
    'Content',
    'Facts',
    'Fold',
    'Heading',
    'Paragraph',
    'Picture',
    'Raw',
    'Section',
    'Table',
    'Value',
]

Value = str | int | float | None


@dataclass(frozen=True)
class Paragraph:
    """
    A paragraph.

    Attributes
    ----------
    text : str
        Plain text; it is escaped.

    """

    text: str


@dataclass(frozen=True)
class Raw:
    """
    A piece of HTML that is taken as it is.

    Attributes
    ----------
    html : str
        Well-formed, of trusted origin, nothing loaded from elsewhere.

    """

    html: str


@dataclass(frozen=True)
class Facts:
    """
    A few numbers in large type, for the head of a page or a section.

    Attributes
    ----------
    items : sequence of (str, str)
        A value and what it is.

    """

    items: Sequence[tuple[str, str]]


class Column(NamedTuple):
    """
    One column of a `Table`.

    Attributes
    ----------
    title, unit : str
        Heading; the unit is empty for names and counts.
    form : str
        Format of its numbers, such as ``'.2f'`` or ``'d'``; empty for a column of words, which is
        aligned to the left.

    """

    title: str
    unit: str = ''
    form: str = ''


@dataclass(frozen=True)
class Cell:
    """
    A value of a `Table` with something about it.

    Attributes
    ----------
    value : str, int, float or None
        As without it.
    scheme : str
        Control scheme whose colour goes before the value.
    link : str
        A file beside the page, or a section of it as ``'#anchor'``.
    strong : bool
        Whether to set it in bold.

    """

    value: Value
    scheme: str = ''
    link: str = ''
    strong: bool = False


@dataclass(frozen=True)
class Heading:
    """
    A row of a `Table` that names those below it.

    Attributes
    ----------
    text : str
        What they have in common.

    """

    text: str


@dataclass(frozen=True)
class Table:
    """
    A table, on the page with rounded numbers and as CSV in full precision.

    Attributes
    ----------
    columns : sequence of Column
        From left to right; the first names the row.
    rows : sequence of Heading or of sequences of values
        A value is a str, int, float, None (unknown, shown as a dash) or a `Cell`.
    caption : str
        Plain text above the table; may be empty.
    name : str
        Stem of the CSV file; that of the section by default.

    """

    columns: Sequence[Column]
    rows: Sequence[Heading | Sequence[Value | Cell]]
    caption: str = ''
    name: str = ''


@dataclass(frozen=True)
class Picture:
    """
    A picture, on the page and as files.

    Attributes
    ----------
    name : str
        Stem of its files.
    caption : str
        Plain text below it, and what readers hear who cannot see it.
    figure : Figure, callable or str
        A figure, or what draws it once it is needed: it becomes SVG and PNG files. An ``<svg>``
        element stays on the page.

    """

    name: str
    caption: str
    figure: Figure | Callable[[], Figure] | str


@dataclass(frozen=True)
class Fold:
    """
    Content under a title that opens and closes.

    Attributes
    ----------
    title : str
        Plain text.
    content : sequence of Content
        What it hides.
    is_open : bool
        Whether it is open at first.

    """

    title: str
    content: Sequence['Content']
    is_open: bool = False


# Of the typing module: a forward reference and | do not go together before Python 3.14.
Content = Union[Paragraph, Raw, Facts, Table, Picture, Fold]  # noqa: UP007


@dataclass(frozen=True)
class Section:
    """
    One section of a page, an entry of its contents.

    Attributes
    ----------
    anchor : str
        Its identifier on the page: letters, digits, ``-`` and ``_``.
    title : str
        Plain text.
    content : sequence of Content
        From top to bottom.

    """

    anchor: str
    title: str
    content: Sequence[Content]
