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

"""The pages of identified models: fit, residuals and their whiteness, poles, coherence, loops."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification import DynamicsFit, FrequencyResponse, HysteresisFit
from piezo_ros.identification.verdict import Verdict
from piezo_ros.report.analysis.loop_deviation import (
    ModelResidual,
    loop_deviation_figure,
    model_comparison_figure,
)
from piezo_ros.report.analysis.panel_figure import chart_picture
from piezo_ros.report.analysis.pole_zero import pole_zero_figure
from piezo_ros.report.analysis.residuals import autocorrelation
from piezo_ros.report.figures.identification_figure import fitted_response_figure
from piezo_ros.report.figures.style import INK, SERIES
from piezo_ros.report.page.chart import Line, Panel, Trace
from piezo_ros.report.page.content import (
    Column,
    Content,
    Facts,
    Paragraph,
    Picture,
    Section,
    Table,
)
from piezo_ros.report.page.page_writer import write_page

__all__ = ['write_dynamics_page', 'write_hysteresis_page']

_FREQUENCY: Final = 'frequency (Hz)'
_MODEL_POINTS: Final = 400
_POINTS: Final[dict[str, Any]] = {'colour': SERIES[0], 'style': 'none', 'marker': 'open'}
_WHITENESS: Final = (
    'Autocorrelation of the residual; of white noise, 95 % of the lags are between the dashed '
    'lines. What is outside is a part that the model leaves unexplained.')

_Floats = NDArray[np.float64]


def write_dynamics_page(
    directory: Path, *, title: str, response: FrequencyResponse, fit: DynamicsFit,
    verdict: Verdict, software: Mapping[str, str], command: str = '',
) -> Path:
    """
    Write report.html, report.json, tables/ and figures/ of identified dynamics.

    Parameters
    ----------
    directory : Path
        Where to write.
    title : str
        Heading.
    response : FrequencyResponse
        The measured points.
    fit : DynamicsFit
        The model.
    verdict : Verdict
        How far it may be trusted.
    software, command
        As for `write_page`.

    Returns
    -------
    Path
        The written report.html.

    Raises
    ------
    OSError
        If a file cannot be written.

    """
    validation = fit.validation
    order = np.argsort(response.frequency_hz, kind='stable')
    points = response.select(order)
    facts = Facts([
        (f'{validation.held_out_fit_percent:.4g} %', 'fit of points left out in turn'),
        (f'{fit.reduced_chi_squared:.3g}', 'reduced χ²; 1 where noise alone is left'),
        ('white' if validation.residual_is_white else 'not white', 'residuals'),
        (f'{validation.usable_to_hz:.4g} Hz', 'usable up to'),
        (f'{fit.points}', 'points')])
    numerator, denominator = fit.polynomials
    return write_page(
        directory, title=title, lead=[facts, Paragraph(f'Verdict: {verdict}.')],
        software=software, command=command,
        data={
            'verdict': str(verdict), 'held_out_fit_percent': validation.held_out_fit_percent,
            'residual_is_white': bool(validation.residual_is_white),
            'usable_to_hz': validation.usable_to_hz},
        sections=[
            Section('response', 'Response and model', [Picture(
                'response', 'Measured points and model; bars and band are intervals of 95 % '
                'confidence.', lambda: fitted_response_figure(response, fit))]),
            Section('residuals', 'What the model leaves', _residual_pictures(points, fit)),
            Section('poles', 'Poles and zeros', [
                Picture('pole-zero', 'Poles (crosses) and zeros (circles) of G(s), without its '
                        'delay.', lambda: pole_zero_figure(
                            np.roots(denominator), np.roots(numerator))),
                _parameter_table(fit)]),
            *_quality_sections(points), *_candidate_sections(fit)])


def _residual_pictures(points: FrequencyResponse, fit: DynamicsFit) -> list[Content]:
    low_hz, high_hz = fit.frequency_range_hz
    inside = (points.frequency_hz >= low_hz) & (points.frequency_hz <= high_hz)
    used = points.select(inside)
    modelled = fit.sampled_response(used.frequency_hz)
    residual = used.response - modelled
    frequency_hz = np.geomspace(low_hz, high_hz, _MODEL_POINTS)
    size = np.abs(fit.sampled_response(frequency_hz))
    pictures: list[Content] = [chart_picture(
        'residual', 'Deviation of each point from the model with the 95 % confidence of the point, '
        'and the 95 % confidence of the model; in percent of the model.', [
            Panel(_FREQUENCY, 'deviation (%)', [
                Trace('|measured − model|', used.frequency_hz,
                      100.0 * np.abs(residual / modelled), **_POINTS),
                Trace('95 % of the point', used.frequency_hz,
                      100.0 * used.confidence_radius / np.abs(modelled), SERIES[3], 'dotted'),
                Trace('95 % of the model', frequency_hz,
                      100.0 * fit.response_confidence_radius(frequency_hz) / size, INK, 'dashed')],
                log_x=True, log_y=True)])]
    known = np.isfinite(used.variance) & (used.variance > 0.0)
    whiteness = autocorrelation(residual[known] / np.sqrt(used.variance[known]))
    if whiteness is not None:
        pictures.append(chart_picture(
            'whiteness', f'{_WHITENESS} Residuals over their standard errors, lags along the '
            'frequency.', [_whiteness_panel('lag (points)', whiteness.lag, whiteness)]))
    return pictures


def _whiteness_panel(label: str, lag: _Floats, whiteness: Any) -> Panel:
    limit = whiteness.limit
    highest = max(1.3 * limit, 1.1 * float(np.max(np.abs(whiteness.value))))
    return Panel(
        label, 'autocorrelation', [Trace(
            f'residual, {whiteness.outside_percent:.0f} % outside', lag, whiteness.value,
            SERIES[0], 'solid', 'filled')],
        lines=[Line(limit, 'limit of white noise'), Line(-limit, ''), Line(0.0, '')],
        y_range=(-highest, highest), height_px=200)


def _parameter_table(fit: DynamicsFit) -> Table:
    return Table(
        [Column('parameter'), Column('value', '', '.6g'), Column('standard error', '', '.2g')],
        [[name, fit.values[name], error if np.isfinite(error) else None]
         for name, error in fit.standard_errors.items()], name='parameters')


def _quality_sections(points: FrequencyResponse) -> list[Section]:
    panels = []
    coherent = np.isfinite(points.coherence)
    if np.any(coherent):
        panels.append(Panel(_FREQUENCY, 'coherence', [Trace(
            'groups of periods', points.frequency_hz[coherent], points.coherence[coherent],
            **_POINTS)], log_x=True, height_px=200))
    distorted = np.isfinite(points.distortion) & (points.distortion > 0.0)
    if np.any(distorted):
        panels.append(Panel(_FREQUENCY, 'distortion (%)', [Trace(
            'not at the excited lines', points.frequency_hz[distorted],
            100.0 * points.distortion[distorted], SERIES[3], 'none', 'filled')],
            log_x=True, log_y=True, height_px=200))
    if not panels:
        return []
    return [Section('coherence', 'How good the points are', [chart_picture(
        'coherence', 'Coherence, 1 without noise; and distortion, the output that is not at the '
        'excited lines, of hysteresis and noise.', panels)])]


def _candidate_sections(fit: DynamicsFit) -> list[Section]:
    if not fit.candidates:
        return []
    return [Section('candidates', 'Structures that were tried', [Table(
        [Column('orders'), Column('Bayesian criterion', '', '.1f')],
        [[candidate.name, candidate.criterion] for candidate in fit.candidates],
        'The lower, the better; the simplest of about equal ones is taken.')])]


def write_hysteresis_page(
    directory: Path, *, title: str, fit: HysteresisFit, sample_period_s: float,
    compared: Sequence[ModelResidual], software: Mapping[str, str], command: str = '',
) -> Path:
    """
    Write report.html, report.json, tables/ and figures/ of an identified hysteresis.

    Parameters
    ----------
    directory : Path
        Where to write.
    title : str
        Heading.
    fit : HysteresisFit
        The model.
    sample_period_s : float
        Time between the samples of the fit, seconds.
    compared : sequence of ModelResidual
        Other models of the same record; may be empty.
    software, command
        As for `write_page`.

    Returns
    -------
    Path
        The written report.html.

    Raises
    ------
    OSError
        If a file cannot be written.

    """
    finite = np.isfinite(fit.displacement_um) & np.isfinite(fit.residual_um)
    voltage_v, displacement_um, residual_um = (
        values[finite] for values in (fit.voltage_v, fit.displacement_um, fit.residual_um))
    time_s = np.asarray(sample_period_s * np.flatnonzero(finite), dtype=np.float64)
    validation = fit.validation
    label = f'MRC, {fit.elements} elements'
    span_um = float(np.ptp(displacement_um))
    facts = Facts([
        (f'{validation.fit_percent:.4g} %', 'fit of loops held out'),
        (f'{1e3 * fit.rms_um:.3g} nm', 'residual, rms'),
        (f'{100.0 * fit.rms_um / span_um:.2g} %', 'of the span of the displacement'),
        (f'{validation.whiteness:.2f}', 'noise over residual; 1 where noise alone is left'),
        (str(fit.elements), 'elements')])
    sections = [
        Section('loops', 'The hysteresis without its straight line', [
            Picture('loops', 'Deviation of measured and modelled loops from their common straight '
                    'line, and the residual on a scale of its own.',
                    lambda: loop_deviation_figure(voltage_v, displacement_um, residual_um, label)),
            _level_table(fit)]),
        Section('residuals', 'What the model leaves', _residuals_over_time(time_s, residual_um)),
        *([_comparison_section(compared)] if compared else []),
        Section('elements', 'Elements', [_element_table(fit)])]
    return write_page(
        directory, title=title, lead=[facts, Paragraph(f'Verdict: {fit.verdict}.')],
        software=software, command=command,
        data={
            'verdict': str(fit.verdict), 'fit_percent': validation.fit_percent,
            'rms_um': fit.rms_um, 'models': [model._asdict() for model in compared]},
        sections=sections)


def _level_table(fit: HysteresisFit) -> Table:
    return Table(
        [Column('amplitude'), Column('left of the loop', '%', '.3f'),
         Column('uncertainty', '%', '.3f')],
        [[f'{level.amplitude_v:.4g} V', level.percent, level.uncertainty_percent]
         for level in fit.validation.levels],
        'What the model leaves of loops that the fit has not seen, percent of their span.')


def _residuals_over_time(time_s: _Floats, residual_um: _Floats) -> list[Content]:
    pictures: list[Content] = [chart_picture(
        'residual-time', 'Residual over time: a slope is drift or creep, a pattern that repeats '
        'with the loops is hysteresis that the model has not.', [
            Panel('time (s)', 'residual (nm)', [Trace(
                'measured − model', time_s, 1e3 * residual_um, SERIES[3])])])]
    whiteness = autocorrelation(residual_um)
    if whiteness is not None:
        pictures.append(chart_picture(
            'whiteness', _WHITENESS,
            [_whiteness_panel('lag (samples)', whiteness.lag, whiteness)]))
    return pictures


def _comparison_section(compared: Sequence[ModelResidual]) -> Section:
    return Section('models', 'Other models of the same loops', [
        Picture('models', 'Residual of the fit (filled) and of samples held out (open) of each '
                'model; far apart, the model describes the noise.',
                lambda: model_comparison_figure(compared)),
        Table([Column('model'), Column('parameters', '', 'd'), Column('residual', 'nm', '.3g'),
               Column('of samples held out', 'nm', '.3g')],
              [list(model) for model in compared])])


def _element_table(fit: HysteresisFit) -> Table:
    parameters = fit.parameters
    widths = (*parameters.saturation_v, None)
    width_errors = (*fit.saturation_standard_error_v, None)
    return Table(
        [Column('element'), Column('saturation', 'V', '.4g'), Column('standard error', 'V', '.2g'),
         Column('slope κ', 'µm/V', '.4g'), Column('standard error', 'µm/V', '.2g')],
        [[str(k), _known(width), _known(width_error), kappa, _known(kappa_error)]
         for k, (width, width_error, kappa, kappa_error) in enumerate(zip(
             widths, width_errors, parameters.kappa_um_per_v,
             fit.kappa_standard_error_um_per_v, strict=True))],
        'The last one has no limit.')


def _known(value: Any) -> float | None:
    return float(value) if value is not None and np.isfinite(value) else None
