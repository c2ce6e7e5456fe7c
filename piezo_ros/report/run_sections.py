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

"""The sections of a report that speak of scored runs: table, pictures, facts."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Final

from piezo_ros.report.comparison import Case, agreement, cases, scheme_label
from piezo_ros.report.content import (
    Cell,
    Column,
    Content,
    Facts,
    Fold,
    Heading,
    Picture,
    Raw,
    Section,
    Table,
    Value,
)
from piezo_ros.report.elements import table_html
from piezo_ros.report.figures import (
    error_figure,
    hysteresis_figure,
    loop_picture,
    nrmse_figure,
    tracking_figure,
)
from piezo_ros.report.score import ScoredRun
from piezo_ros.report.tracking_figures import HarmonicsCurve, harmonics_figure

__all__ = [
    'harmonics_sections',
    'loop_section',
    'nrmse_sections',
    'pictures_section',
    'results_section',
    'run_facts',
]

# A campaign has dozens of cases: beyond these the pictures are folded away.
_OPEN_CASES: Final = 3
_COLUMNS: Final = (
    Column('scheme'),
    Column('m', '', 'd'),
    Column('NRMSE', '%', '.2f'),
    Column('paper', '%', '.2f'),
    Column('deviation', '%', '+.1f'),
    Column('max error', 'µm', '.3f'),
    Column('samples', '', 'd'),
    Column('wall time', 's', '.2f'),
    Column('rate', 'samples/s', '.0f'),
    Column('bag'),
)


def run_facts(runs: Sequence[ScoredRun]) -> Facts:
    """
    Return the facts for the head of a report.

    Parameters
    ----------
    runs : sequence of ScoredRun
        At least one.

    Returns
    -------
    Facts
        Counts, the least error, and how the runs compare with the published numbers.

    """
    best = min(runs, key=lambda run: run.nrmse_percent)
    groups = cases(runs)
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
    return Facts(facts)


def results_section(runs: Sequence[ScoredRun], csv_path: str) -> Section:
    """
    Return the table of runs, grouped by what they tracked.

    Parameters
    ----------
    runs : sequence of ScoredRun
        The runs.
    csv_path : str
        Where the same numbers stand in full precision, beside the page.

    Returns
    -------
    Section
        With the anchor ``results``.

    """
    rows: list[Heading | Sequence[Value | Cell]] = []
    for case in cases(runs):
        rows.append(Heading(case.title))
        rows.extend(_row(run) for run in case.runs)
    introduction = f"""<p>NRMSE is the root mean square of desired minus measured displacement over
the last whole periods, divided by the peak-to-peak of the desired one. <em>Paper</em> is the number
of Table 4 in Liu, Shan and Gabbert (2015), <em>deviation</em> how far ours lies above it. The same
numbers in full precision: <a href="{csv_path}">{csv_path}</a>,
<a href="report.json">report.json</a>.</p>
"""
    # With a CSV file of more than the columns shown here, the table needs no second one.
    return Section('results', 'Results', (Raw(introduction + table_html(Table(_COLUMNS, rows))),))


def loop_section() -> Section:
    """Return the block diagram of the loop, with the anchor ``loop``."""
    return Section('loop', 'The loop', (Raw(f"""<figure>
{loop_picture()}
<figcaption>Each arrow is a topic of blocks of samples. The plant answers voltage <i>u</i>[<i>k</i>]
with displacement <i>y</i>[<i>k</i> + 1]; the demand of the consumer keeps the trajectory from
running ahead. With FF the feedback path is cut, with FB the feedforward is left out.</figcaption>
</figure>
"""),))


def nrmse_sections(runs: Sequence[ScoredRun]) -> list[Section]:
    """
    Return the section on NRMSE over frequency.

    Parameters
    ----------
    runs : sequence of ScoredRun
        The runs.

    Returns
    -------
    list of Section
        With the anchor ``nrmse``; empty unless some waveform has two frequencies.

    """
    pictures: list[Content] = []
    for waveform in dict.fromkeys(run.waveform for run in runs):
        mine = [run for case in cases(runs) if case.waveform == waveform for run in case.runs]
        if len({run.frequency_hz for run in mine}) < 2:
            continue
        caption = f'{waveform.capitalize()}: NRMSE over frequency; one panel for each amplitude.'
        pictures.append(Picture(f'nrmse-{waveform}', caption, partial(nrmse_figure, mine)))
    return [Section('nrmse', 'NRMSE over frequency', pictures)] if pictures else []


def harmonics_sections(
    runs: Sequence[ScoredRun], predicted: Mapping[str, Mapping[int, float]],
) -> list[Section]:
    """
    Return the picture of the error over the number of harmonics, predicted and measured.

    Parameters
    ----------
    runs : sequence of ScoredRun
        The runs.
    predicted : mapping of str to mapping
        Bag of a run to the predicted NRMSE, percent, of each number of harmonics. Runs of the same
        scan under the same scheme are what was measured.

    Returns
    -------
    list of Section
        None where no run has more than one number of harmonics to choose from.

    """
    curves = [
        _harmonics_curve(run, predicted[run.bag], runs) for run in runs
        if len(predicted.get(run.bag, ())) > 1 and run.harmonics in predicted[run.bag]]
    if not curves:
        return []
    return [Section('harmonics', 'The number of harmonics', [Picture(
        'harmonics', 'Error over the number of harmonics, predicted before the runs and measured.',
        partial(harmonics_figure, curves))])]


def _harmonics_curve(
    run: ScoredRun, predicted: Mapping[int, float], runs: Sequence[ScoredRun],
) -> HarmonicsCurve:
    measured = {
        other.harmonics: other.nrmse_percent for other in runs if _scan(other) == _scan(run)}
    return HarmonicsCurve(
        f'{scheme_label(run.scheme)}, {run.amplitude_um:g} µm, {run.frequency_hz:g} Hz',
        list(predicted), list(predicted.values()),
        [measured.get(m, math.nan) for m in predicted], run.harmonics)


def _scan(run: ScoredRun) -> tuple[str, str, float, float]:
    return run.scheme, run.waveform, run.amplitude_um, run.frequency_hz


def pictures_section(runs: Sequence[ScoredRun]) -> Section:
    """
    Return tracking, errors and hysteresis of every case.

    Parameters
    ----------
    runs : sequence of ScoredRun
        The runs.

    Returns
    -------
    Section
        With the anchor ``runs``; the first cases are open, the others folded away.

    """
    return Section('runs', 'Tracking, errors and hysteresis', [
        Fold(case.title, _pictures(case), is_open=number < _OPEN_CASES)
        for number, case in enumerate(cases(runs))])


def _pictures(case: Case) -> list[Picture]:
    name = f'{case.waveform}-{case.amplitude_um:g}um-{case.frequency_hz:g}Hz'
    return [
        Picture(f'tracking-{name}', 'Desired and measured displacement, and below their '
                'difference.', partial(tracking_figure, case.runs)),
        Picture(f'error-{name}', 'Error of each run; rows far apart in size have their own scale.',
                partial(error_figure, case.runs)),
        Picture(f'hysteresis-{name}', 'Displacement over the voltage at the input of the '
                'amplifier.', partial(hysteresis_figure, case.runs))]


def _row(run: ScoredRun) -> list[Value | Cell]:
    return [
        Cell(scheme_label(run.scheme), scheme=run.scheme), run.harmonics, run.nrmse_percent,
        run.paper_nrmse_percent, run.deviation_percent, run.max_error_um, run.samples,
        run.wall_seconds or None, run.samples_per_wall_second, Cell(run.bag, link=run.bag)]
