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

"""A report: one self-contained page, its data, and its tables and pictures as files."""

import json
import math
from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any, Final

from piezo_ros.report.content import (
    Cell,
    Column,
    Content,
    Facts,
    Fold,
    Heading,
    Paragraph,
    Picture,
    Raw,
    Section,
    Table,
)
from piezo_ros.report.elements import Renderer
from piezo_ros.report.files import write_atomically
from piezo_ros.report.run_sections import (
    harmonics_sections,
    loop_section,
    nrmse_sections,
    pictures_section,
    results_section,
    run_facts,
)
from piezo_ros.report.score import ScoredRun
from piezo_ros.report.tables import csv_table

__all__ = [
    'FORMAT_VERSION',
    'Cell',
    'Column',
    'Facts',
    'Fold',
    'Heading',
    'Paragraph',
    'Picture',
    'Raw',
    'Section',
    'Table',
    'write_page',
    'write_report',
]

FORMAT_VERSION: Final = 1


def write_report(
    directory: str | Path,
    *,
    title: str,
    runs: Sequence[ScoredRun],
    software: Mapping[str, str],
    notes: Sequence[str] = (),
    predictions: Mapping[str, Mapping[str, Any]] | None = None,
    plan: str = '',
    command: str = '',
) -> Path:
    """
    Write report.html, report.json, runs.csv and figures/ (SVG and PNG).

    The same arguments give the same bytes. Each file is replaced atomically, report.html last.

    Parameters
    ----------
    directory : str or Path
        Where to write; made when missing.
    title : str
        Heading of the report.
    runs : sequence of ScoredRun
        What was scored, in the order of the tables.
    software : mapping of str to str
        Name to version, of everything the numbers may depend on.
    notes : sequence of str, optional
        Paragraphs for the reader: what was lost, what to be careful with.
    predictions : mapping of str to mapping, optional
        Bag of a run to what was predicted of it: ``nrmse_percent`` and ``by_harmonics``, number of
        harmonics to NRMSE in percent.
    plan, command : str, optional
        Text of the plan and the command line that made the runs.

    Returns
    -------
    Path
        The written report.html.

    Raises
    ------
    ValueError
        If there is no run, or a number is not finite.
    OSError
        If a file cannot be written.

    """
    if not runs:
        raise ValueError('runs is empty, a report needs at least one run')
    predicted = predictions or {}
    remarks = [Section('notes', 'Notes', [Paragraph(note) for note in notes])] if notes else []
    return write_page(
        directory, title=title, lead=[run_facts(runs)], software=software, command=command,
        plan=plan, data={'runs': [
            {**run.record(), **({'prediction': dict(predicted[run.bag])}
                                if run.bag in predicted else {})}
            for run in runs]},
        files={'runs.csv': csv_table(runs)},
        sections=[results_section(runs, 'runs.csv'), loop_section(), *nrmse_sections(runs),
                  *harmonics_sections(runs, {
                      bag: {int(m): float(percent) for m, percent in record['by_harmonics'].items()}
                      for bag, record in predicted.items()}),
                  pictures_section(runs), *remarks])


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

    The same arguments give the same bytes. Everything is made before anything is written; each
    file is then replaced atomically, report.html last.

    Parameters
    ----------
    directory : str or Path
        Where to write; made when missing.
    title : str
        Heading of the page.
    lead : sequence of Content
        What stands between the heading and the contents list.
    sections : sequence of Section
        The body; a section on how the page was made, ``made``, follows.
    software : mapping of str to str
        Name to version, of everything the numbers may depend on.
    command, plan : str, optional
        The command line and the text of the plan that made the numbers.
    data : mapping
        The numbers, for report.json: what JSON knows, and finite.
    files : mapping of str to (str or bytes), optional
        Further files, by their path below the directory.

    Returns
    -------
    Path
        The written report.html.

    Raises
    ------
    ValueError
        If a number is not finite, two sections have one anchor, or two files one name.
    TypeError
        If the data hold what JSON does not know.
    OSError
        If a file cannot be written.

    """
    directory = Path(directory)
    _require_finite(data, 'report.json')
    whole = {'format_version': FORMAT_VERSION, 'title': title, **data, 'software': dict(software)}
    text = json.dumps(whole, indent=2, ensure_ascii=False, allow_nan=False)
    all_sections = [*sections, Section('made', 'How this was made', [
        Raw(_making(software, plan, command))])]
    anchors = [section.anchor for section in all_sections]
    for anchor in anchors:
        if anchors.count(anchor) > 1:
            raise ValueError(f'anchor {anchor!r} is that of {anchors.count(anchor)} sections')
    renderer = Renderer()
    renderer.files.update(files or {})
    page = _page(title, all_sections, lead, renderer)
    write_atomically(directory / 'report.json', f'{text}\n')
    for path, content in renderer.files.items():
        write_atomically(directory / path, content)
    write_atomically(directory / 'report.html', page)
    return directory / 'report.html'


def _page(
    title: str, sections: Sequence[Section], lead: Sequence[Content], renderer: Renderer,
) -> str:
    style = resources.files('piezo_ros.report').joinpath('report.css').read_text('utf-8')
    contents = ''.join(
        f'<li><a href="#{section.anchor}">{escape(section.title)}</a></li>\n'
        for section in sections)
    head = renderer.content(lead, 'lead')
    body = ''.join(renderer.section(section) for section in sections)
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{escape(title)}</title>
<style>
{style}</style>
</head>
<body>
<header>
<h1>{escape(title)}</h1>
{head}</header>
<nav aria-label="Contents">
<ol>
{contents}</ol>
</nav>
<main>
{body}</main>
</body>
</html>
"""


def _making(software: Mapping[str, str], plan: str, command: str) -> str:
    rows = ''.join(
        f'<tr><th scope="row">{escape(name)}</th><td>{escape(version)}</td></tr>\n'
        for name, version in software.items())
    parts = []
    if command:
        parts.append(f'<p>The command:</p>\n<pre><code>{escape(command)}</code></pre>\n')
    if plan:
        parts.append(f'<p>The plan:</p>\n<pre><code>{escape(plan)}</code></pre>\n')
    if rows:
        parts.append(f'<p>The software:</p>\n<table class="software">\n{rows}</table>\n')
    return ''.join(parts)


def _require_finite(data: Any, where: str) -> None:
    """Refuse a number that is not finite, and say where in the data it is."""
    if isinstance(data, float) and not math.isfinite(data):
        raise ValueError(f'{where} is {data}, it must be finite; what is unknown is None')
    if isinstance(data, Mapping):
        for name, value in data.items():
            _require_finite(value, f'{where}: {name}' if ':' not in where else f'{where}.{name}')
    elif isinstance(data, (list, tuple)):
        for number, value in enumerate(data):
            _require_finite(value, f'{where}[{number}]')
