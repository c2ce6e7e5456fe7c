"""The report of a set of runs: one self-contained page, its data, its table and its pictures."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from pathlib import Path
from re import sub
from typing import Final
from urllib.parse import quote

from matplotlib.figure import Figure

from piezo_ros.report.comparison import Case, agreement, cases, scheme_label
from piezo_ros.report.figures import (
    error_figure,
    hysteresis_figure,
    loop_picture,
    nrmse_figure,
    tracking_figure,
)
from piezo_ros.report.files import write_atomically
from piezo_ros.report.rendering import inline_svg, png, svg
from piezo_ros.report.score import ScoredRun
from piezo_ros.report.tables import COLUMNS, Column, write_csv

__all__ = ['FORMAT_VERSION', 'write_report']

FORMAT_VERSION: Final = 1

# Columns that the heading of a case already says.
_CASE_COLUMNS: Final = ('waveform', 'amplitude', 'frequency')
# A campaign has dozens of cases: beyond these the pictures are folded away.
_OPEN_CASES: Final = 3


@dataclass(frozen=True)
class _Picture:
    """One drawn figure: its file name without suffix, its caption and the inline element."""

    name: str
    caption: str
    element: str


def write_report(
    directory: str | Path,
    *,
    title: str,
    runs: Sequence[ScoredRun],
    software: Mapping[str, str],
    notes: Sequence[str] = (),
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
    directory = Path(directory)
    data = {
        'format_version': FORMAT_VERSION,
        'title': title,
        'runs': [run.record() for run in runs],
        'software': dict(software),
    }
    text = json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False)
    write_atomically(directory / 'report.json', f'{text}\n')
    write_csv(directory / 'runs.csv', runs)
    groups = cases(runs)
    sections = [
        _Section('results', 'Results', _results(groups)),
        _Section('loop', 'The loop', _loop()),
        *_nrmse_section(groups, directory),
        _Section('runs', 'Tracking, errors and hysteresis', _pictures(groups, directory)),
        *([_Section('notes', 'Notes', ''.join(f'<p>{escape(note)}</p>\n' for note in notes))]
          if notes else []),
        _Section('made', 'How this was made', _making(software, plan, command)),
    ]
    page = directory / 'report.html'
    write_atomically(page, _page(title, _summary(runs, groups), sections))
    return page


@dataclass(frozen=True)
class _Section:
    anchor: str
    title: str
    body: str


def _page(title: str, summary: str, sections: Sequence[_Section]) -> str:
    style = resources.files('piezo_ros.report').joinpath('report.css').read_text('utf-8')
    contents = ''.join(
        f'<li><a href="#{section.anchor}">{section.title}</a></li>\n' for section in sections)
    body = ''.join(
        f'<section id="{section.anchor}">\n<h2>{section.title}</h2>\n{section.body}</section>\n'
        for section in sections)
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
{summary}</header>
<nav aria-label="Contents">
<ol>
{contents}</ol>
</nav>
<main>
{body}</main>
</body>
</html>
"""


def _summary(runs: Sequence[ScoredRun], groups: Sequence[Case]) -> str:
    best = min(runs, key=lambda run: run.nrmse_percent)
    facts = [(str(len(runs)), 'run' if len(runs) == 1 else 'runs'),
             (str(len(groups)), 'reference' if len(groups) == 1 else 'references'),
             (f'{best.nrmse_percent:.2f} %', f'least NRMSE ({scheme_label(best.scheme)})')]
    compared = agreement(runs)
    if compared.median_deviation_percent is not None:
        what = 'published number' if compared.numbers == 1 else 'published numbers'
        facts.append((f'{compared.median_deviation_percent:.1f} %',
                      f'median deviation from {compared.numbers} {what}'))
    if compared.pairs:
        facts.append((f'{compared.same_winner} of {compared.pairs}',
                      'published verdicts on FF against FBFF confirmed'))
    items = ''.join(
        f'<div><dt>{escape(what)}</dt><dd>{escape(value)}</dd></div>\n' for value, what in facts)
    return f'<dl class="facts">\n{items}</dl>\n'


def _results(groups: Sequence[Case]) -> str:
    columns = [column for column in COLUMNS if column.title not in _CASE_COLUMNS]
    heads = ''.join(
        f'<th scope="col"{_alignment(column)}>{escape(column.title)}'
        f'{f"<small>{escape(column.unit)}</small>" if column.unit else ""}</th>'
        for column in columns)
    bodies = ''.join(
        f'<tbody>\n<tr><th class="case" scope="rowgroup" colspan="{len(columns) + 1}">'
        f'{escape(case.title)}</th></tr>\n'
        f'{"".join(_result_row(run, columns) for run in case.runs)}</tbody>\n'
        for case in groups)
    return f"""<p>NRMSE is the root mean square of desired minus measured displacement over the
last whole periods, divided by the peak-to-peak of the desired one. <em>Paper</em> is the number of
Table 4 in Liu, Shan and Gabbert (2015), <em>deviation</em> how far ours lies above it. The same
numbers in full precision: <a href="runs.csv">runs.csv</a>,
<a href="report.json">report.json</a>.</p>
<div class="wide"><table class="results">
<thead><tr>{heads}<th scope="col">bag</th></tr></thead>
{bodies}</table></div>
"""


def _result_row(run: ScoredRun, columns: Sequence[Column]) -> str:
    first, *others = columns
    cells = ''.join(f'<td{_alignment(column)}>{_cell(column, run)}</td>' for column in others)
    return (
        f'<tr><th scope="row"><span class="chip {_scheme_class(run)}"></span>'
        f'{escape(first.text(run))}</th>{cells}'
        f'<td class="bag"><a href="{escape(quote(run.bag))}">{escape(run.bag)}</a></td></tr>\n')


def _cell(column: Column, run: ScoredRun) -> str:
    text = escape(column.text(run))
    return text.replace('-', '\N{MINUS SIGN}') if column.is_number else text


def _alignment(column: Column) -> str:
    return ' class="number"' if column.is_number else ''


def _scheme_class(run: ScoredRun) -> str:
    """Return the scheme as a class name of report.css, unknown ones without a colour."""
    return sub(r'[^a-z0-9]+', '-', run.scheme)


def _loop() -> str:
    return f"""<figure>
{loop_picture()}
<figcaption>Each arrow is a topic of blocks of samples. The plant answers voltage <i>u</i>[<i>k</i>]
with displacement <i>y</i>[<i>k</i> + 1]; the demand of the consumer keeps the trajectory from
running ahead. With FF the feedback path is cut, with FB the feedforward is left out.</figcaption>
</figure>
"""


def _nrmse_section(groups: Sequence[Case], directory: Path) -> list[_Section]:
    """Return the section on NRMSE over frequency, empty unless some waveform has two."""
    figures = []
    for waveform in dict.fromkeys(case.waveform for case in groups):
        mine = [case for case in groups if case.waveform == waveform]
        if len({case.frequency_hz for case in mine}) < 2:
            continue
        caption = f'{waveform.capitalize()}: NRMSE over frequency; one panel for each amplitude.'
        runs = [run for case in mine for run in case.runs]
        figures.append(_figure(_draw(nrmse_figure, runs, f'nrmse-{waveform}', caption, directory)))
    return [_Section('nrmse', 'NRMSE over frequency', ''.join(figures))] if figures else []


def _pictures(groups: Sequence[Case], directory: Path) -> str:
    parts = []
    for number, case in enumerate(groups):
        name = f'{case.waveform}-{case.amplitude_um:g}um-{case.frequency_hz:g}Hz'
        drawn = (
            _draw(tracking_figure, case.runs, f'tracking-{name}',
                  'Desired and measured displacement, and below their difference.', directory),
            _draw(error_figure, case.runs, f'error-{name}',
                  'Error of each run; rows far apart in size have their own scale.', directory),
            _draw(hysteresis_figure, case.runs, f'hysteresis-{name}',
                  'Displacement over the voltage at the input of the amplifier.', directory))
        is_open = ' open' if number < _OPEN_CASES else ''
        parts.append(
            f'<details class="case"{is_open}>\n<summary><h3>{escape(case.title)}</h3></summary>\n'
            f'{"".join(_figure(picture) for picture in drawn)}</details>\n')
    return ''.join(parts)


def _draw(
    figure_of: Callable[[Sequence[ScoredRun]], Figure], runs: Sequence[ScoredRun], name: str,
    caption: str, directory: Path,
) -> _Picture:
    """Draw a figure into its two files and return it for the page."""
    stem = sub(r'[^A-Za-z0-9.]+', '-', name)
    figure = figure_of(runs)
    document = svg(figure, stem)
    write_atomically(directory / 'figures' / f'{stem}.svg', document)
    write_atomically(directory / 'figures' / f'{stem}.png', png(figure))
    return _Picture(stem, caption, inline_svg(document, escape(caption)))


def _figure(picture: _Picture) -> str:
    files = ', '.join(
        f'<a href="figures/{picture.name}.{kind}">{kind.upper()}</a>' for kind in ('svg', 'png'))
    return (
        f'<figure class="plot">\n{picture.element}\n'
        f'<figcaption>{escape(picture.caption)} <span class="files">{files}</span></figcaption>\n'
        '</figure>\n')


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
