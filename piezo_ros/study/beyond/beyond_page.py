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

"""The page of the study: Table 4 as published, re-identified, planned and learned."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from piezo_ros.report.page.content import Cell, Column, Facts, Paragraph, Picture, Section, Table
from piezo_ros.report.page.page_writer import write_page
from piezo_ros.study.beyond.beyond_figures import (
    bars_figure,
    certificate_figure,
    learning_figure,
    prediction_figure,
)
from piezo_ros.study.beyond.beyond_record import beyond_record
from piezo_ros.study.beyond.beyond_results import BeyondResults
from piezo_ros.study.beyond.targets import targets
from piezo_ros.study.page_elements import Rows, known

__all__ = ['beyond_summary', 'write_beyond_page']


def beyond_summary(results: BeyondResults) -> str:
    """Return the outcome in a few lines for the terminal."""
    factors = results.column('factor')
    spans = {
        'Table 4, better of FF and FBFF in the paper': results.column('paper_percent'),
        'on this rig as published': results.column('published_percent'),
        'with re-identified models, m = 9': results.column('identified_percent'),
        'planned, first run':
            [cell.scan.runs[0].measured_percent for cell in results.cells],
        'learned, at most two runs more':
            [cell.scan.learned.measured_percent for cell in results.cells]}
    lines = [f'{name:46}{_span(values)} %' for name, values in spans.items()]
    lines.append(
        f'{"paper over learned":46}{factors.min():.1f} … {factors.max():.1f}, '
        f'median {np.median(factors):.1f}')
    found = targets(results)
    lines += [
        f'{"yes" if target.holds else "NO ":3}  {target.name}: {target.value:.3g} '
        f'({"at least" if target.is_least else "at most"} {target.limit:.3g})'
        for target in found]
    return '\n'.join(lines)


def _span(values: Any) -> str:
    array = np.asarray(values)
    return f'{array.min():.2f} … {array.max():.2f}, median {np.median(array):.2f}'


def write_beyond_page(
    directory: Path, results: BeyondResults, *, title: str, software: Mapping[str, str],
    plan: str, command: str,
) -> Path:
    """
    Write report.html, report.json, tables and figures of the study.

    Parameters
    ----------
    directory : Path
        Where to write.
    results : BeyondResults
        The study.
    title : str
        Heading.
    software : mapping of str to str
        Name to version.
    plan, command : str
        What made it.

    Returns
    -------
    Path
        The written report.html.

    """
    factors = results.column('factor')
    found = targets(results)
    return write_page(
        directory, title=title, lead=[
            Facts([
                (f'{np.median(factors):.1f}', 'times better than the paper, median'),
                (f'{factors.min():.1f} … {factors.max():.1f}', 'over all conditions'),
                (f'{max(cell.scan.plan.certificate.gamma for cell in results.cells):.2f}',
                 'largest gamma before any run'),
                (f'{sum(target.holds for target in found)} of {len(found)}',
                 'figures of merit as they are to be')]),
            Paragraph(
                'The same stage, amplifier and sensor as in the paper, simulated. The better of '
                'FF and FBFF as published, and with models that were identified from bags of this '
                'rig; a voltage that is planned on these models at the limit of the amplifier '
                'current; and what at most two runs of learning make of it. True errors are '
                'against the displacement without the noise of the sensor.')],
        sections=[
            _cells_section(results), _learning_section(results), _prediction_section(results),
            _certificate_section(results), _robustness_section(results),
            _average_section(results), _targets_section(results)],
        software=software, command=command, plan=plan, data=beyond_record(results))


def _cells_section(results: BeyondResults) -> Section:
    rows: Rows = [
        [f'{cell.amplitude_um:g} µm, {cell.frequency_hz:g} Hz', cell.paper_percent,
         cell.published_percent, cell.identified_percent, cell.scan.runs[0].measured_percent,
         cell.scan.runs[0].true_percent, Cell(cell.scan.learned.measured_percent, strong=True),
         cell.scan.learned.true_percent, known(cell.best_known_percent), cell.factor]
        for cell in results.cells]
    unknown = all(math.isnan(cell.best_known_percent) for cell in results.cells)
    return Section('table-4', 'Table 4, planned and learned', [
        Picture('bars', 'Measured NRMSE by amplitude and frequency.',
                lambda: bars_figure(results.cells)),
        Table([
            Column('condition'), Column('paper', '%', '.2f'), Column('as published', '%', '.2f'),
            Column('re-identified', '%', '.2f'), Column('planned', '%', '.3f'),
            Column('planned, true', '%', '.3f'), Column('learned', '%', '.3f'),
            Column('learned, true', '%', '.3f'), Column('best known, true', '%', '.3f'),
            Column('paper / learned', '', '.1f')], rows, name='table-4'),
        Paragraph(
            'The best known voltage was searched with full knowledge of the rig, without noise, '
            'by sequential quadratic programming from several starts and in bands up to the '
            'Nyquist frequency (piezo_ros.study.beyond.optimum).' if not unknown else
            'The best known voltages that the package has are of another rig; '
            'python -m piezo_ros.study.beyond.optimum finds those of this one.')])


def _learning_section(results: BeyondResults) -> Section:
    return Section('learning', 'Error over the runs', [
        Paragraph(
            'Run 0 plays the plan; each further one moves the voltage by a step of the model, '
            'from the error of the period average. The circle is the run that the learning takes '
            'for the best, by what it measured.'),
        Picture('learning', 'True NRMSE over the runs; dotted: best known.',
                lambda: learning_figure(results.cells))])


def _prediction_section(results: BeyondResults) -> Section:
    rows: Rows = [
        [f'{cell.amplitude_um:g} µm, {cell.frequency_hz:g} Hz',
         plan.measured_nrmse_percent, cell.scan.runs[0].measured_percent,
         plan.highest_nrmse_percent, plan.truncation_percent, plan.limits_percent,
         plan.accuracy.uncertainty_percent, plan.noise_percent]
        for cell in results.cells for plan in [cell.scan.plan]]
    return Section('prediction', 'Predicted against measured', [
        Paragraph(
            'Before the first run the plan tells what it will measure: what the band of the '
            'voltage leaves, what the limits of the amplifier leave, and the noise of the sensor. '
            'The bar reaches to what is left where the model is as wrong as its W allows.'),
        Picture('prediction', 'Predicted by the plan over measured in its first run.',
                lambda: prediction_figure(results.cells)),
        Table([
            Column('condition'), Column('predicted', '%', '.3f'), Column('measured', '%', '.3f'),
            Column('at most', '%', '.3f'), Column('truncation', '%', '.3f'),
            Column('limits', '%', '.3f'), Column('uncertainty', '%', '.3f'),
            Column('noise', '%', '.3f')], rows, name='prediction')])


def _certificate_section(results: BeyondResults) -> Section:
    below = sum(
        cell.scan.true_gamma <= cell.scan.plan.certificate.gamma for cell in results.cells)
    return Section('certificate', 'Is learning certain to help?', [
        Paragraph(
            'gamma is what a step of the model leaves, at most, of the distance to the best '
            'voltage: below 1 it comes nearer. It is computed before the first run, from the '
            'regularisation, from elements that slip at other times at voltages about the plan, '
            'and from W. It is no proof: the crosses are what the true slope of the simulated '
            'stage gives; in '
            f'{below} of {len(results.cells)} conditions they are below the certificate.'),
        Picture('certificate', 'gamma before the first run; crosses: with the true slope.',
                lambda: certificate_figure(results.cells))])


def _robustness_section(results: BeyondResults) -> Section:
    rows: Rows = [
        [f'{row.fault}, {row.amplitude_um:g} µm, {row.frequency_hz:g} Hz',
         row.scan.plan.certificate.gamma, row.scan.true_gamma, row.scan.begin_percent,
         row.scan.end_percent, row.nominal_percent, len(row.scan.runs), row.scan.best]
        for row in results.robustness]
    return Section('robustness', 'With a wrong model, under noise and drift', [
        Paragraph(
            'Planned and learned as above, at most five runs, but with a model that is wrong or a '
            'stage that changes. W of a wrong model is what the bags of the identification tell '
            'of it; where gamma is 1 or more, learning is not certain to help, and the accept and '
            'stop rules must do. Both errors are on the stage as it is at the end.'),
        Table([
            Column('fault'), Column('gamma', '', '.2f'), Column('true gamma', '', '.2f'),
            Column('plan, true', '%', '.3f'), Column('best run, true', '%', '.3f'),
            Column('nominal, true', '%', '.3f'), Column('runs', '', 'd'),
            Column('best run', '', 'd')], rows, name='robustness')])


def _average_section(results: BeyondResults) -> Section:
    rows: Rows = [
        [f'{each.amplitude_um:g} µm, {each.frequency_hz:g} Hz',
         1e-3 * each.run.average_slew_v_per_s, each.plan.measured_nrmse_percent,
         each.run.measured_percent]
        for each in results.average_current]
    return Section('average-current', 'Within an average current', [
        Paragraph(
            'Many amplifiers give half of their peak current on the average. The rig has no such '
            f'limit unless it is told; {len(rows)} of {len(results.cells)} plans ask for more '
            f'than {1e-3 * results.average_slew_v_per_s:.3g} V/ms. Planned within it as well, '
            'they leave this:'),
        Table([
            Column('condition'), Column('average', 'V/ms', '.2f'),
            Column('predicted', '%', '.3f'), Column('measured', '%', '.3f')], rows,
            name='average-current')])


def _targets_section(results: BeyondResults) -> Section:
    rows: Rows = [
        [target.name, target.value, f'{"≥" if target.is_least else "≤"} {target.limit:.3g}',
         'yes' if target.holds else 'no']
        for target in targets(results)]
    return Section('merit', 'Figures of merit', [
        Table([Column('the worst of all conditions'), Column('found', '', '.3f'),
               Column('to be'), Column('holds')], rows, name='merit')])
