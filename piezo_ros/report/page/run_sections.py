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

"""The sections of a report of scored runs: results, block diagram, and figures of each case."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Final

from piezo_ros.report.comparison import Case, agreement, cases
from piezo_ros.report.figures.error_spectrum_figure import (
    NM_PER_UM,
    error_spectrum_figure,
    run_error_harmonics,
)
from piezo_ros.report.figures.harmonics_figure import HarmonicsCurve, harmonics_figure
from piezo_ros.report.figures.hysteresis_figure import hysteresis_figure
from piezo_ros.report.figures.nrmse_figure import nrmse_figure
from piezo_ros.report.figures.tracking_figure import error_figure, tracking_figure
from piezo_ros.report.figures.voltage_figure import voltage_figure
from piezo_ros.report.labels import run_label, scheme_label
from piezo_ros.report.page.content import (
    Cell,
    Column,
    Content,
    Facts,
    Fold,
    Heading,
    Picture,
    Section,
    Table,
    Value,
)
from piezo_ros.report.page.rendering import render
from piezo_ros.report.page.run_charts import (
    error_panels,
    hysteresis_panels,
    spectrum_panels,
    starts_of,
    tracking_panels,
    voltage_panels,
)
from piezo_ros.report.page.tables import row_groups
from piezo_ros.report.run_tables import SCORE_COLUMNS, score_values
from piezo_ros.report.score import ScoredRun

__all__ = [
    'harmonics_sections',
    'loop_section',
    'nrmse_sections',
    'pictures_section',
    'results_section',
    'run_facts',
]

# A campaign has dozens of cases: the figures of the later ones are folded at first.
_OPEN_CASES: Final = 3
_FEW_RUNS: Final = 12
_COLUMNS: Final = (Column('scheme'), *SCORE_COLUMNS, Column('bag'))


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
        Number of runs and references, the least error, and the agreement with the published
        numbers.

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
    Return the table of runs, grouped by reference.

    Parameters
    ----------
    runs : sequence of ScoredRun
        The runs.
    csv_path : str
        File beside the page with the same numbers in full precision.

    Returns
    -------
    Section
        With the anchor ``results``.

    """
    rows: list[Heading | Sequence[Value | Cell]] = []
    for case in cases(runs):
        rows.append(Heading(case.title))
        rows.extend(_row(run) for run in case.runs)
    # A template of its own: the file at csv_path has more columns than a file of this table would.
    return Section('results', 'Results', [render(
        'results', csv_path=csv_path, columns=_COLUMNS,
        groups=row_groups(Table(_COLUMNS, rows, 'Results'))),
        Fold('Gains and dates', [_setup_table(runs)], is_open=len(runs) <= _FEW_RUNS)])


def loop_section() -> Section:
    """Return the block diagram of the loop, with the anchor ``loop``."""
    return Section('loop', 'The loop', [render('loop')])


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
        selected = [run for case in cases(runs) if case.waveform == waveform for run in case.runs]
        if len({run.frequency_hz for run in selected}) < 2:
            continue
        caption = f'{waveform.capitalize()}: NRMSE over frequency; one panel for each amplitude.'
        pictures.append(Picture(f'nrmse-{waveform}', caption, partial(nrmse_figure, selected)))
    return [Section('nrmse', 'NRMSE over frequency', pictures)] if pictures else []


def harmonics_sections(
    runs: Sequence[ScoredRun], predicted: Mapping[str, Mapping[int, float]],
) -> list[Section]:
    """
    Return the section on the error over the number of harmonics, predicted and measured.

    Parameters
    ----------
    runs : sequence of ScoredRun
        The runs.
    predicted : mapping of str to mapping
        Bag of a run -> predicted NRMSE, percent, for each number of harmonics. The measured NRMSE
        comes from the runs with the same reference and scheme.

    Returns
    -------
    list of Section
        With the anchor ``harmonics``; empty if no run has a prediction for several numbers of
        harmonics.

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


def _scan(run: ScoredRun) -> tuple[str, str, float, float, float]:
    return run.scheme, run.waveform, run.amplitude_um, run.frequency_hz, run.offset_um


def pictures_section(runs: Sequence[ScoredRun]) -> Section:
    """
    Return the figures of tracking, errors and hysteresis of every case.

    Parameters
    ----------
    runs : sequence of ScoredRun
        The runs.

    Returns
    -------
    Section
        With the anchor ``runs``; the first cases are open, the others folded.

    """
    return Section('runs', 'Tracking, errors and hysteresis', [
        Fold(case.title, _pictures(case), is_open=number < _OPEN_CASES)
        for number, case in enumerate(cases(runs))])


def _pictures(case: Case) -> list[Picture]:
    name, runs = case.name, case.runs
    pictures = [
        Picture(f'tracking-{name}', 'Desired and measured displacement, and below them the errors.',
                partial(tracking_figure, runs), partial(tracking_panels, runs)),
        Picture(f'error-{name}', 'Error of each run; rows far apart in size have their own scale.',
                partial(error_figure, runs), partial(error_panels, runs)),
        Picture(f'spectrum-{name}', _spectrum_caption(runs),
                partial(error_spectrum_figure, runs), partial(spectrum_panels, runs)),
        Picture(f'voltage-{name}', 'Voltage at the input of the amplifier, as a deviation from the '
                'operating point; marked where the amplifier slews or is at a rail.',
                partial(voltage_figure, runs), partial(voltage_panels, runs)),
        Picture(f'hysteresis-{name}', 'Displacement over the voltage at the input of the '
                'amplifier.', partial(hysteresis_figure, runs), partial(hysteresis_panels, runs))]
    starts = starts_of(runs)
    if starts:
        pictures.append(Picture(
            f'start-{name}', 'The transient: displacement and error over the first periods, which '
            'are not scored.', partial(tracking_figure, starts), partial(tracking_panels, starts)))
    return pictures


def _spectrum_caption(runs: Sequence[ScoredRun]) -> str:
    rests = ', '.join(
        f'{run_label(run, runs)} {NM_PER_UM * run_error_harmonics(run).rest_rms_um:.3g} nm'
        for run in runs)
    return (
        'Amplitude of the error at each harmonic of the reference. RMS of what is at none of them '
        f'(noise, drift, higher harmonics): {rests}.')


def _setup_table(runs: Sequence[ScoredRun]) -> Table:
    """Return gains and dates of the runs; a column that no run knows is left out."""
    columns = [
        Column('scheme'), Column('kP', '', '.4g'), Column('kI', '1/s', '.4g'),
        Column('recorded', 'UTC'), Column('changes during the run'), Column('bag')]
    rows: list[list[Value | Cell] | Heading] = []
    for case in cases(runs):
        rows.append(Heading(case.title))
        rows.extend([
            Cell(scheme_label(run.scheme), scheme=run.scheme), run.setup.proportional_gain,
            run.setup.integral_gain_per_s, run.setup.recorded or None, run.setup.changes or None,
            Cell(run.bag, link=run.bag)] for run in case.runs)
    kept = [
        number for number in range(len(columns))
        if any(row[number] is not None for row in rows if not isinstance(row, Heading))]
    return Table(
        [columns[number] for number in kept],
        [row if isinstance(row, Heading) else [row[number] for number in kept] for row in rows],
        'Gains of the feedback and time of recording, as the bags tell them.', 'gains')


def _row(run: ScoredRun) -> list[Value | Cell]:
    return [
        Cell(scheme_label(run.scheme), scheme=run.scheme), *score_values(run),
        Cell(run.bag, link=run.bag)]
