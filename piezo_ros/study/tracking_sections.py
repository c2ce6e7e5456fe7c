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

"""The sections of the study's page on tracking: Tables 3 and 4, Fig. 10 and 11."""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from markupsafe import Markup

from piezo_ros import paper
from piezo_ros.report.figures.crossing_figure import CrossingRow, crossing_figure
from piezo_ros.report.figures.harmonics_figure import HarmonicsCurve, harmonics_figure
from piezo_ros.report.figures.nrmse_figure import TableCell, table_4_figure
from piezo_ros.report.figures.tracking_figure import error_figure, tracking_figure
from piezo_ros.report.page.content import (
    Cell,
    Column,
    Fold,
    Paragraph,
    Picture,
    Section,
    Table,
)
from piezo_ros.report.page.rendering import render
from piezo_ros.report.page.run_charts import error_panels, tracking_panels
from piezo_ros.report.score import ScoredRun, score
from piezo_ros.study.page_elements import PERCENT, Rows, known
from piezo_ros.study.record import (
    agreement_of,
    recommendations,
    rows_outside,
    rows_within,
    within_published_band,
)
from piezo_ros.study.results import HarmonicsTrial, PaperResults
from piezo_ros.study.table_4 import published_errors

__all__ = [
    'harmonics_section',
    'improved_section',
    'largest_error_deviations',
    'scans_section',
    'scored_scans',
    'table_3_section',
    'table_4_section',
    'warming_section',
]

# The largest motion of Fig. 7, 2.5 V behind the inverse, where no limit touches it.
_FIG_7_UM: Final = 2.5 * paper.KAPPA_UM_PER_V[-1]
_FIG_7_HZ: Final = 1000.0


def table_4_section(results: PaperResults) -> Section:
    """Return Table 4 as published."""
    published = published_errors(results.cells)
    rows: Rows = [
        [f'{amplitude_um:g} µm, {frequency_hz:g} Hz', *map(float, ours), *map(float, theirs)]
        for (amplitude_um, frequency_hz), ours, theirs in zip(
            results.cells, results.table_4_published, published, strict=True)]
    unseen = agreement_of(results, results.table_4_published, unseen=True)
    return Section('table-4', 'Table 4 as published: tracking of triangles', [
        Paragraph(
            'Published compensator, gains and feedforward (m = 9) on the calibrated rig. The '
            'calibration saw the rows 0.5, 1.5 and 2.5 µm; on the others the median deviation is '
            f'{unseen.median_deviation:.1%}.'),
        _scheme_grid(results, results.table_4_published),
        Picture(
            'table-4', 'NRMSE over frequency for each amplitude: lines ours, open marks published.',
            lambda: table_4_figure(
                _cells(results, results.table_4_published), title='Table 4 as published')),
        Fold('The same numbers in one list', [Table(
            [Column('condition'), Column('FF', '%', '.2f'), Column('FBFF', '%', '.2f'),
             Column('FF paper', '%', '.2f'), Column('FBFF paper', '%', '.2f')], rows,
            name='table-4')])])


def improved_section(results: PaperResults) -> Section:
    """Return Table 4 with re-identified models and automatic harmonics."""
    published = published_errors(results.cells)
    rows: Rows = [
        [f'{point.amplitude_um:g} µm, {point.frequency_hz:g} Hz', *map(float, nine),
         point.harmonics['ff'], point.harmonics['fbff'], *map(float, automatic),
         float(theirs.min()), point.scheme.upper(),
         point.predicted_nrmse_percent[point.scheme]]
        for point, nine, automatic, theirs in zip(
            results.points, results.table_4_identified, results.table_4_automatic, published,
            strict=True)]
    right = recommendations(results)
    return Section('beyond', 'Beyond the paper: re-identified models, automatic harmonics', [
        Paragraph(
            'The same schemes with the hysteresis and the dynamics that our own identification '
            'made from bags of this rig. With m = 9 the true inverse asks for more than the '
            'amplifier gives where amplitude and frequency are high; the number of harmonics '
            'chosen from the predicted error avoids that.'),
        Picture(
            'table-4-automatic', 'Re-identified models and automatic m: lines ours, open '
            'marks published.', lambda: table_4_figure(
                _cells(results, results.table_4_automatic), title='Automatic harmonics',
                mark_winners=False)),
        Paragraph(
            'Scheme and number of harmonics were chosen before the runs, from the identified '
            'hysteresis, G and W, the spectrum of the triangle and the data sheet of the '
            f'amplifier. The scheme to use turned out to be the better one in {right} of '
            f'{len(results.points)} conditions.'),
        Table(
            [Column('condition'), Column('FF, m = 9', '%', '.2f'),
             Column('FBFF, m = 9', '%', '.2f'), Column('m of FF', '', 'd'),
             Column('m of FBFF', '', 'd'), Column('FF', '%', '.2f'), Column('FBFF', '%', '.2f'),
             Column('better published', '%', '.2f'), Column('use'),
             Column('predicted', '%', '.2f')], rows,
            name='table-4-identified')])


def harmonics_section(results: PaperResults) -> Section:
    """Return the error over the number of harmonics."""
    trials = results.trials
    measured = [
        dict(zip(trial.harmonics, trial.measured_percent, strict=True)) for trial in trials]
    rows: Rows = [
        [m, *(
            Cell(errors.get(m), strong=trial.point.harmonics['ff'] == m)
            for trial, errors in zip(trials, measured, strict=True))]
        for m in sorted({m for errors in measured for m in errors})]
    return Section('harmonics', 'The number of harmonics', [
        Paragraph(
            'Feedforward alone with the re-identified models. Each harmonic that is added lessens '
            'the truncation, and asks more of the amplifier until that is at its slew limit. '
            'W is part of what is predicted, hence a little more than what is measured.'),
        Picture(
            'harmonics', 'Error over the number of harmonics, predicted and measured.',
            lambda: harmonics_figure(list(map(_harmonics_curve, trials)))),
        Table(
            [Column('m', '', 'd'), *(
                Column(f'{trial.point.amplitude_um:g} µm, {trial.point.frequency_hz:g} Hz', '%',
                       '.2f')
                for trial in trials)], rows,
            caption='Measured; the chosen number in bold.', name='harmonics')])


def table_3_section(results: PaperResults) -> Section:
    """Return Table 3 and Fig. 10."""
    rows: Rows = [
        [f'{crossing.amplitude_um:g} µm', known(crossing.crossing_hz),
         known(crossing.predicted_hz), *map(float, paper.TABLE_3[crossing.amplitude_um]),
         'yes' if within_published_band(crossing) else 'no']
        for crossing in results.crossings]
    outside = rows_outside(results.crossings)
    return Section('table-3', 'Table 3 and Fig. 10: where feedback stops helping', [
        Paragraph(
            'Sines under FF and FBFF, all as published. Predicted is what the identified models '
            'foresee for the same runs.'),
        Picture('crossing', 'Errors of FF and FBFF over frequency; published bands shaded.',
                lambda: crossing_figure([
                    CrossingRow(
                        crossing.amplitude_um, crossing.frequency_hz, crossing.ff_percent,
                        crossing.fbff_percent, paper.TABLE_3[crossing.amplitude_um],
                        known(crossing.crossing_hz))
                    for crossing in results.crossings])),
        Table(
            [Column('amplitude'), Column('crossing', 'Hz', '.0f'),
             Column('predicted', 'Hz', '.0f'), Column('published from', 'Hz', '.0f'),
             Column('to', 'Hz', '.0f'), Column('within 50 Hz')], rows, name='table-3'),
        *([] if not outside else [Paragraph(
            f'Outside: {outside}. Behind an inverse that fits, with an amplifier that follows, the '
            'loop is linear, and the ratio of both errors is the same at every amplitude: the rig '
            'has one crossing. The published ones spread, so that something in the loop of the '
            'paper depended on the amplitude; the next section has a candidate.')])])


def warming_section(results: PaperResults) -> Section:
    """Return Tables 3 and 4 on the rig that warms."""
    warming = results.warming
    everywhere = agreement_of(results, warming.table_4)
    unseen = agreement_of(results, warming.table_4, unseen=True)
    rows: Rows = [
        [f'{linear.amplitude_um:g} µm', known(linear.crossing_hz), known(warm.crossing_hz),
         *map(float, paper.TABLE_3[warm.amplitude_um]),
         'yes' if within_published_band(warm) else 'no']
        for linear, warm in zip(results.crossings, warming.crossings, strict=True)]
    gain = warming.self_heating_gain
    growth, allowed = (
        gain * 0.5 * (2.0 * math.pi * _FIG_7_UM * _FIG_7_HZ * 1e-3) ** 2,
        float(paper.uncertainty_magnitude(np.array([_FIG_7_HZ]))[0]))
    return Section('warming', 'Tables 3 and 4 on a stage that warms', [
        Paragraph(
            'A stage warms by its losses, and its gain grows with its temperature: here by '
            f'{PERCENT * gain:.3g} % at a mean square speed of 1 (µm/ms)². Large and fast motions '
            'then have more gain, so that their crossings come earlier. This rig is '
            'config/rig_that_warms.yaml, by piezo calibrate --self-heating, fitted to the rows '
            '0.5, 1.5 and 2.5 µm of Table 4 and to the rows from 1.5 µm on of Table 3. All else is '
            'as published.'),
        Table(
            [Column('amplitude'), Column('without heat', 'Hz', '.0f'),
             Column('that warms', 'Hz', '.0f'), Column('published from', 'Hz', '.0f'),
             Column('to', 'Hz', '.0f'), Column('within 50 Hz')], rows, name='table-3-warming'),
        Paragraph(
            f'{rows_within(warming.crossings)} of {len(rows)} rows of Table 3 are within 50 Hz of '
            f'the published band. Table 4 deviates by {everywhere.median_deviation:.1%} in the '
            f'median, by {unseen.median_deviation:.1%} on the rows that the fit never saw, and the '
            f'better scheme agrees in {everywhere.verdicts} of {everywhere.conditions} '
            'conditions.'),
        _scheme_grid(results, warming.table_4),
        Paragraph(
            f'What stays open: {rows_outside(warming.crossings) or "nothing of Table 3"}. '
            'At small amplitudes the published crossings rise, which would need a gain that falls '
            'there, as of an inverse that overcompensates small loops; the paper prints no sign '
            'of it, and with it Table 4 is no longer met. And Fig. 7 speaks against so much heat: '
            f'the paper sees no dependence on the amplitude up to {_FIG_7_HZ:g} Hz, where a sine '
            f'of {_FIG_7_UM:.3g} µm would have {PERCENT * growth:.0f} % more gain, and the W of '
            f'(19) allows {PERCENT * allowed:.0f} %. Therefore the rig of all other sections, '
            'config/rig.yaml, does not warm.')])


def scans_section(results: PaperResults) -> Section:
    """Return Fig. 11."""
    runs = scored_scans(results)
    deviations = largest_error_deviations(runs)
    rows: Rows = [
        [run.scheme.upper(), run.nrmse_percent, run.max_error_um,
         paper.MAXIMUM_ERROR_300_HZ_UM.get(run.scheme),
         None if (deviation := deviations.get(run.scheme)) is None else PERCENT * deviation]
        for run in runs]
    return Section('fig-11', 'Fig. 11: a 2.5 µm, 300 Hz triangle', [
        Picture('tracking', 'Desired and measured displacement.', lambda: tracking_figure(runs),
                lambda: tracking_panels(runs)),
        Picture('errors', 'The errors.', lambda: error_figure(runs), lambda: error_panels(runs)),
        Table(
            [Column('scheme'), Column('NRMSE', '%', '.2f'), Column('largest error', 'µm', '.3f'),
             Column('paper', 'µm', '.2f'), Column('deviation', '%', '+.0f')], rows,
            name='fig-11')])


def largest_error_deviations(runs: Sequence[ScoredRun]) -> dict[str, float]:
    """Return by how much the largest errors of Fig. 11 lie above the published, as a fraction."""
    return {
        run.scheme: run.max_error_um / published - 1.0 for run in runs
        if (published := paper.MAXIMUM_ERROR_300_HZ_UM.get(run.scheme)) is not None}


def scored_scans(results: PaperResults) -> list[ScoredRun]:
    """Return the runs of Fig. 11 with their scores."""
    return [
        score(run, bag=f'bags/scan_{scheme}', wall_seconds=0.0)
        for scheme, run in results.scans.items()]


def _scheme_grid(results: PaperResults, errors: Any) -> Markup:
    """Return errors in the grid of Table 4: amplitudes below each other, frequencies in a row."""
    cells = {(cell.amplitude_um, cell.frequency_hz): cell for cell in _cells(results, errors)}
    frequencies_hz = sorted({frequency_hz for _, frequency_hz in cells})
    return render(
        'scheme_grid', label='Table 4', corner='amplitude',
        caption='NRMSE in percent, ours and in brackets the published; ✓ marks the better scheme, '
        'shaded is where it is another one than published.',
        columns=[f'{frequency_hz:g} Hz' for frequency_hz in frequencies_hz],
        rows=[
            (f'{amplitude_um:g} µm', [
                _grid_cell(cells[amplitude_um, frequency_hz]) for frequency_hz in frequencies_hz])
            for amplitude_um in sorted({amplitude_um for amplitude_um, _ in cells})])


def _grid_cell(cell: TableCell) -> dict[str, Any]:
    ff_is_better, ff_was_better = cell.ff < cell.fbff, cell.paper_ff < cell.paper_fbff
    return {'is_other': not cell.same_winner, 'entries': [
        {'scheme': 'ff', 'label': 'FF', 'percent': cell.ff, 'published_percent': cell.paper_ff,
         'is_better': ff_is_better, 'is_better_published': ff_was_better},
        {'scheme': 'fbff', 'label': 'FBFF', 'percent': cell.fbff,
         'published_percent': cell.paper_fbff, 'is_better': not ff_is_better,
         'is_better_published': not ff_was_better}]}


def _cells(results: PaperResults, errors: Any) -> list[TableCell]:
    return [
        TableCell(*cell, *map(float, ours), *map(float, theirs))
        for cell, ours, theirs in zip(
            results.cells, errors, published_errors(results.cells), strict=True)]


def _harmonics_curve(trial: HarmonicsTrial) -> HarmonicsCurve:
    measured = dict(zip(trial.harmonics, trial.measured_percent, strict=True))
    predicted = trial.predicted_percent
    return HarmonicsCurve(
        f'FF, {trial.point.amplitude_um:g} µm, {trial.point.frequency_hz:g} Hz', list(predicted),
        list(predicted.values()), [measured.get(m, math.nan) for m in predicted],
        trial.point.harmonics['ff'])
