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

"""The page of a sweep: distributions of the scores, what they depend on, the worst draws."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from piezo_ros.report.analysis.draw_statistics import (
    FEWEST_DRAWS,
    Dependence,
    dependences,
    quantile,
    scalar_draws,
)
from piezo_ros.report.analysis.panel_figure import chart_picture
from piezo_ros.report.analysis.tornado import tornado_figure
from piezo_ros.report.figures.style import LINE_STYLES, SERIES
from piezo_ros.report.page.chart import Panel, Trace
from piezo_ros.report.page.content import (
    Cell,
    Column,
    Content,
    Facts,
    Paragraph,
    Picture,
    Section,
    Table,
)
from piezo_ros.report.page.page_writer import write_page

__all__ = ['SweptRun', 'WorstDraw', 'write_sweep_page']

_QUANTILES: Final = (0.05, 0.5, 0.95, 0.99)
_WIDE_RANGE: Final = 30.0  # of an error, for a logarithmic axis
_MOST_SCATTERED: Final = 3000
_SHOWN_PARAMETERS: Final = 4  # in the scatter plots
# Key of a record, its name and unit.
_SCORES: Final = (('nrmse_percent', 'NRMSE', '%'), ('max_error_um', 'largest error', 'µm'))


@dataclass(frozen=True)
class SweptRun:
    """
    One run of the plan with all of its draws.

    Attributes
    ----------
    title : str
        What the draws have in common.
    records : sequence of mapping
        The records of the draws that succeeded, at least one.

    """

    title: str
    records: Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class WorstDraw:
    """
    A draw of large error.

    Attributes
    ----------
    record : mapping
        Its record.
    plan : str
        A plan of this run alone, a file beside the page.
    command : str
        The command that simulates it again.

    """

    record: Mapping[str, Any]
    plan: str
    command: str


def write_sweep_page(
    directory: Path, *, title: str, runs: Sequence[SweptRun], parameters: Sequence[str],
    worst: Sequence[WorstDraw], failed: Sequence[Mapping[str, Any]], software: Mapping[str, str],
    plan: str = '', command: str = '',
) -> Path:
    """
    Write report.html, report.json, tables/ and figures/ of a sweep.

    Parameters
    ----------
    directory : Path
        Where to write.
    title : str
        Heading.
    runs : sequence of SweptRun
        The runs of the plan.
    parameters : sequence of str
        Names of the drawn parameters.
    worst : sequence of WorstDraw
        The draws of largest error.
    failed : sequence of mapping
        The records of the runs that failed.
    software, plan, command
        As for `write_page`.

    Returns
    -------
    Path
        The written report.html.

    Raises
    ------
    ValueError
        If no run succeeded.
    OSError
        If a file cannot be written.

    """
    if not runs:
        raise ValueError('no run of the sweep succeeded, there is nothing to report')
    found = [_dependences(run, parameters) for run in runs]
    return write_page(
        directory, title=title, lead=[_facts(runs, failed)], software=software, plan=plan,
        command=command, data={
            'runs': [_summary(run, each) for run, each in zip(runs, found, strict=True)],
            'failed': len(failed), 'worst': [dict(each.record) for each in worst]},
        sections=[
            _distribution_section(runs), *_dependence_sections(runs, found, parameters),
            *([_worst_section(worst, parameters)] if worst else []),
            *([_failed_section(failed)] if failed else [])])


def _facts(runs: Sequence[SweptRun], failed: Sequence[Any]) -> Facts:
    done = sum(len(run.records) for run in runs)
    facts = [(str(done), 'runs'), (str(max(len(run.records) for run in runs)), 'draws')]
    for run in runs[:4]:
        median = quantile(_scores(run, 'nrmse_percent'), 0.5)
        facts.append((f'{median.value:.3g} %', f'median NRMSE, {run.title}'))
    if failed:
        facts.append((str(len(failed)), 'runs failed'))
    return Facts(facts)


def _scores(run: SweptRun, key: str) -> list[float]:
    return [float(record[key]) for record in run.records]


def _summary(run: SweptRun, found: Sequence[Dependence]) -> dict[str, Any]:
    return {
        'run': run.title, 'draws': len(run.records),
        'quantiles': {
            key: [quantile(_scores(run, key), share)._asdict() for share in _QUANTILES]
            for key, _, _ in _SCORES},
        'nrmse_depends_on': [each._asdict() for each in found]}


def _distribution_section(runs: Sequence[SweptRun]) -> Section:
    columns = [Column('run'), Column('score'), Column('draws', '', 'd')]
    for share in _QUANTILES:
        columns += [Column(f'{share:.0%}', '', '.4g'), Column('95 % confidence')]
    columns += [Column('largest', '', '.4g')]
    rows = []
    for run in runs:
        for key, name, unit in _SCORES:
            scores = _scores(run, key)
            row: list[Any] = [run.title, f'{name}, {unit}', len(scores)]
            for share in _QUANTILES:
                one = quantile(scores, share)
                row += [one.value, _interval(one.low, one.high)]
            rows.append([*row, max(scores)])
    panels = [
        Panel(
            f'{name} ({unit})', 'share of the draws', [
                _ecdf(run.title, number, _scores(run, key)) for number, run in enumerate(runs)],
            log_x=_spans_decades([_scores(run, key) for run in runs]), y_range=(0.0, 1.0))
        for key, name, unit in _SCORES]
    return Section('distribution', 'How large the errors are', [
        chart_picture(
            'distribution', 'Share of the draws of which the error is not larger (empirical '
            'distribution); a steep curve is an error that hardly depends on the draw.', panels),
        Table(columns, rows, 'Quantiles of the scores over the draws, with the interval in which '
              'each lies with 95 % confidence; a dash where the draws are too few to say.')])


def _spans_decades(scores: Sequence[Sequence[float]]) -> bool:
    low, high = min(map(min, scores)), max(map(max, scores))
    return 0.0 < _WIDE_RANGE * low < high


def _ecdf(label: str, number: int, scores: Sequence[float]) -> Trace:
    ordered = np.sort(np.asarray(scores))
    share = np.arange(1, ordered.size + 1) / ordered.size
    # Steps: each value twice, before and behind its step.
    return Trace(
        label, np.repeat(ordered, 2), np.column_stack([share - share[0], share]).ravel(),
        SERIES[number % len(SERIES)], LINE_STYLES[number % len(LINE_STYLES)], width_px=1.8)


def _interval(low: float | None, high: float | None) -> str:
    return f'{"–" if low is None else f"{low:.4g}"} … {"–" if high is None else f"{high:.4g}"}'


def _dependences(run: SweptRun, parameters: Sequence[str]) -> tuple[Dependence, ...]:
    return dependences(_scores(run, 'nrmse_percent'), _draws(run, parameters))


def _draws(run: SweptRun, parameters: Sequence[str]) -> dict[str, Any]:
    return {
        label: values for name in parameters
        for label, values in scalar_draws(run.records, name).items()}


def _dependence_sections(
    runs: Sequence[SweptRun], found: Sequence[Sequence[Dependence]], parameters: Sequence[str],
) -> list[Section]:
    sections = []
    for number, (run, each) in enumerate(zip(runs, found, strict=True)):
        content: list[Content] = []
        if not each:
            content.append(Paragraph(
                f'Nothing is said of what the error depends on: that takes {FEWEST_DRAWS} draws '
                f'with different errors, and a drawn number; here are {len(run.records)} draws.'))
        else:
            content += [
                _tornado(f'tornado-{number}', each),
                _scatter(f'scatter-{number}', run, each, parameters),
                _dependence_table(f'sensitivity-{number}', each)]
        sections.append(Section(
            f'sensitivity-{number}', f'What the NRMSE depends on: {run.title}', content))
    return sections


def _tornado(name: str, found: Sequence[Dependence]) -> Picture:
    return Picture(
        name, 'Median NRMSE over the tenth of the draws in which a parameter is lowest (open mark) '
        'and highest (filled mark); the vertical line is the median of all draws. Both marks on '
        'one side: either sign of the deviation costs accuracy.', lambda: tornado_figure(found))


def _scatter(
    name: str, run: SweptRun, found: Sequence[Dependence], parameters: Sequence[str],
) -> Picture:
    scores = np.asarray(_scores(run, 'nrmse_percent'))
    draws = _draws(run, parameters)
    panels = []
    for number, parameter in enumerate(each.name for each in found[:_SHOWN_PARAMETERS]):
        values = draws[parameter]
        order = np.argsort(values, kind='stable')
        order = order[::-(-order.size // _MOST_SCATTERED)]
        panels.append(Panel(parameter, 'NRMSE (%)', [Trace(
            f'draws of {parameter}', values[order], scores[order],
            SERIES[number % len(SERIES)], 'none', 'open')], height_px=200))
    return chart_picture(
        name, 'NRMSE of each draw over the parameters that it depends on most.', panels)


def _dependence_table(name: str, found: Sequence[Dependence]) -> Table:
    columns = [
        Column('parameter'), Column('rank correlation', '', '.2f'), Column('95 % confidence'),
        Column('share of variance', '%', '.0f'), Column('NRMSE at lowest', '%', '.3g'),
        Column('NRMSE at highest', '%', '.3g')]
    return Table(columns, [
        [each.name, each.rank_correlation, f'{each.low:.2f} … {each.high:.2f}',
         100.0 * each.variance_share, each.at_lowest, each.at_highest] for each in found],
        'Spearman rank correlation of NRMSE and parameter; share of the variance of its ranks that '
        'the parameter alone explains, rising or not; median NRMSE over the tenth of the draws at '
        'either end. A correlation of which the interval includes 0 may be chance.', name)


def _worst_section(worst: Sequence[WorstDraw], parameters: Sequence[str]) -> Section:
    columns = [
        Column('draw', '', 'd'), Column('run'), Column('NRMSE', '%', '.4g'),
        Column('largest error', 'µm', '.4g'), Column('plan'), Column('simulate it again'),
        *map(Column, parameters)]
    rows = [
        [each.record['draw'], each.record['name'], each.record['nrmse_percent'],
         each.record['max_error_um'], Cell(each.plan, link=each.plan), each.command,
         *(_drawn_text(each.record[name]) for name in parameters)] for each in worst]
    return Section('worst', 'The worst draws', [Table(
        columns, rows, 'The draws of largest NRMSE. The command gives the same samples again, with '
        'bag and report.')])


def _drawn_text(value: Any) -> str:
    if isinstance(value, list):
        return ', '.join(map(_drawn_text, value))
    return f'{value:.4g}' if isinstance(value, float) else str(value)


def _failed_section(failed: Sequence[Mapping[str, Any]]) -> Section:
    return Section('failed', 'Runs that failed', [
        Paragraph(f'{len(failed)} runs have no score and are left out of all numbers above.'),
        Table([Column('draw', '', 'd'), Column('why')], [
            [record['draw'], record['error']] for record in failed[:20]])])
