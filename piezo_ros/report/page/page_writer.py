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

"""Writes a page: report.html, self-contained, its data as report.json, and the files beside it."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from piezo_ros.report.files import write_atomically
from piezo_ros.report.page.chart import chart_library
from piezo_ros.report.page.content import Content, Section
from piezo_ros.report.page.elements import ElementRenderer
from piezo_ros.report.page.rendering import render

__all__ = ['FORMAT_VERSION', 'write_page']

FORMAT_VERSION: Final = 1


def write_page(
    directory: str | Path,
    *,
    title: str,
    lead: Sequence[Content],
    sections: Sequence[Section],
    software: Mapping[str, str],
    command: str = '',
    plan: str = '',
    data: Mapping[str, Any],
    files: Mapping[str, str | bytes] | None = None,
) -> Path:
    """
    Write report.html, report.json, tables/ (CSV) and figures/ (SVG and PNG).

    The same arguments give the same bytes. All content is made before the first file is written;
    each file is then replaced atomically, report.html last.

    Parameters
    ----------
    directory : str or Path
        Where to write; made when missing.
    title : str
        Heading of the page.
    lead : sequence of Content
        Content between the heading and the list of contents.
    sections : sequence of Section
        The body. A last section, ``made``, says how the page was made.
    software : mapping of str to str
        Name to version, of everything that the numbers may depend on.
    command, plan : str, optional
        The command line and the text of the plan that made the numbers.
    data : mapping
        The numbers, for report.json: JSON types, and finite.
    files : mapping of str to (str or bytes), optional
        Further files, by their path below the directory.

    Returns
    -------
    Path
        The written report.html.

    Raises
    ------
    ValueError
        If a number is not finite, if an anchor is malformed or used twice, or if two files have the
        same name.
    TypeError
        If the data contain an object that JSON cannot represent.
    OSError
        If a file cannot be written.

    """
    directory = Path(directory)
    _require_finite(data, 'report.json')
    record = {'format_version': FORMAT_VERSION, 'title': title, **data, 'software': dict(software)}
    text = json.dumps(record, indent=2, ensure_ascii=False, allow_nan=False)
    how_made = render('how_made', software=software, plan=plan, command=command)
    sections = [*sections, Section('made', 'How this was made', [how_made])]
    _require_anchors(sections)
    elements = ElementRenderer(files or {})
    lead_html = elements.render(lead, 'lead')
    bodies = [elements.render(section.content, section.anchor) for section in sections]
    page = render(
        'page', title=title, lead=lead_html,
        sections=[
            {'anchor': section.anchor, 'title': section.title, 'content': body}
            for section, body in zip(sections, bodies, strict=True)],
        charts=chart_library() if elements.has_charts else None)
    write_atomically(directory / 'report.json', f'{text}\n')
    for path, content in elements.files.items():
        write_atomically(directory / path, content)
    write_atomically(directory / 'report.html', page)
    return directory / 'report.html'


def _require_anchors(sections: Sequence[Section]) -> None:
    anchors = [section.anchor for section in sections]
    for section in sections:
        if not re.fullmatch(r'[A-Za-z][\w-]*', section.anchor, re.ASCII):
            raise ValueError(
                f'anchor of section {section.title!r} is {section.anchor!r}, it must be of '
                'letters, digits, - and _, and begin with a letter')
        if anchors.count(section.anchor) > 1:
            raise ValueError(
                f'anchor {section.anchor!r} is that of {anchors.count(section.anchor)} sections')


def _require_finite(data: Any, where: str) -> None:
    """Refuse a number that is not finite, and name its place in the data."""
    if isinstance(data, float) and not math.isfinite(data):
        raise ValueError(f'{where} is {data}, it must be finite; what is unknown is None')
    if isinstance(data, Mapping):
        for name, value in data.items():
            _require_finite(value, f'{where}: {name}' if ':' not in where else f'{where}.{name}')
    elif isinstance(data, (list, tuple)):
        for number, value in enumerate(data):
            _require_finite(value, f'{where}[{number}]')
