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

"""The page of tuned gains: loop, margins, robustness, responses, and where to use which scheme."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification import OperatingPoint
from piezo_ros.identification.tuning.linear_plant import Bound, bound_magnitude
from piezo_ros.identification.tuning.loop_evidence import LoopEvidence
from piezo_ros.identification.tuning.loop_shape import LoopShape
from piezo_ros.identification.tuning.pi_tuning import PiTuning
from piezo_ros.identification.tuning.time_response import loop_response, settling_samples
from piezo_ros.report.analysis.nyquist import NyquistCurve, nyquist_figure, nyquist_panel
from piezo_ros.report.analysis.panel_figure import chart_picture
from piezo_ros.report.analysis.scheme_map import scheme_map_figure
from piezo_ros.report.figures.style import INK, LINE_STYLES, SERIES
from piezo_ros.report.page.chart import Line, Panel, Trace
from piezo_ros.report.page.content import (
    Cell,
    Column,
    Facts,
    Paragraph,
    Picture,
    Section,
    Table,
)
from piezo_ros.report.page.page_writer import write_page

__all__ = ['TunedLoop', 'write_tuning_page']

_FREQUENCY: Final = 'frequency (Hz)'
_COLOURS: Final = (INK, SERIES[0], SERIES[2], SERIES[4])
_LOWEST_DB: Final = -60.0

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class TunedLoop:
    """
    What was tuned, and on which grounds.

    Attributes
    ----------
    tuning : PiTuning
        The gains and their loops.
    published : LoopShape
        The loop with the gains of Table 2 in Liu 2015.
    evidence : LoopEvidence
        Measured points and the error of the model.
    bound : UncertaintyBound, control.TransferFunction, callable or None
        W(s).
    reference_um : ndarray, shape (N,), or None
        A scan to follow, micrometres, of the sample period of the loop.
    scan : str
        The scan in words.
    points : sequence of OperatingPoint
        The predicted operating points; may be empty.
    remarks : sequence of str
        How far all this may be trusted, one paragraph each.

    """

    tuning: PiTuning
    published: LoopShape
    evidence: LoopEvidence
    bound: Bound | None
    reference_um: _Floats | None
    scan: str
    points: Sequence[OperatingPoint]
    remarks: Sequence[str]

    @property
    def shapes(self) -> dict[str, LoopShape]:
        """Name to loop, the tuned one first."""
        return {'tuned': self.tuning.after, 'Table 2': self.published}


def write_tuning_page(
    directory: Path, *, title: str, tuned: TunedLoop, software: Mapping[str, str],
    command: str = '',
) -> Path:
    """
    Write report.html, report.json, tables/ and figures/ of tuned gains.

    Parameters
    ----------
    directory : Path
        Where to write.
    title : str
        Heading.
    tuned : TunedLoop
        What was tuned.
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
    sections = [
        Section('loop', 'The open loop', [_bode(tuned), _nyquist(tuned)]),
        Section('sensitivity', 'Sensitivity and robustness', [_sensitivity(tuned)]),
        *_response_sections(tuned), *_map_sections(tuned)]
    return write_page(
        directory, title=title, lead=[_facts(tuned), *map(Paragraph, tuned.remarks)],
        software=software, command=command,
        data={
            'loops': {name: shape.record() for name, shape in tuned.shapes.items()},
            'operating_points': [
                {'amplitude_um': point.amplitude_um, 'frequency_hz': point.frequency_hz,
                 **point.record()} for point in tuned.points]},
        sections=[Section('gains', 'Gains and margins', [_table(tuned)]), *sections])


def _facts(tuned: TunedLoop) -> Facts:
    shape = tuned.tuning.after
    promised = tuned.tuning.promised_sensitivity
    return Facts([
        (f'{shape.loop.proportional_gain:.4g}', 'kP'),
        (f'{shape.loop.integral_gain_per_s:.4g}', 'kI, 1/s'),
        (_decibels_text(shape.gain_margin), 'gain margin'),
        (f'{shape.phase_margin_deg:.3g}°', 'phase margin'),
        (f'{promised:.3g}', 'largest |S| on model, points and band'),
        (f'{shape.feedback_acceptable_frequency_hz:.4g} Hz', 'feedback lessens errors below')])


def _decibels_text(factor: float) -> str:
    return f'{20.0 * math.log10(factor):.3g} dB' if 0.0 < factor < math.inf else 'unlimited'


def _table(tuned: TunedLoop) -> Table:
    rows = (
        ('kP', '', 'proportional_gain'), ('kI', '1/s', 'integral_gain_per_s'),
        ('zero of the lead', 'Hz', 'lead_zero_hz'), ('pole of the lead', 'Hz', 'lead_pole_hz'),
        ('gain margin', '', 'gain_margin'), ('phase margin', '°', 'phase_margin_deg'),
        ('delay margin', 's', 'delay_margin_s'), ('bandwidth', 'Hz', 'bandwidth_hz'),
        ('feedback acceptable below', 'Hz', 'feedback_acceptable_frequency_hz'),
        ('max |S|', '', 'max_sensitivity'), ('max |W T|', '', 'weighted_peak'))
    loops = {'start': tuned.tuning.before, **tuned.shapes}
    records = [shape.record() for shape in loops.values()]
    of_all = ('proportional_gain', 'integral_gain_per_s', 'lead_zero_hz', 'lead_pole_hz')
    return Table(
        [Column('figure'), *(Column(name, '', '.4g') for name in loops), Column('unit')],
        [[title, *(
            record[key] if record['stable'] or key in of_all else None for record in records), unit]
         for title, unit, key in rows] + [
             ['stable', *('yes' if shape.stable else 'no' for shape in loops.values()), '']],
        'A dash: there is none, or the loop is not stable.')


def _look(number: int) -> dict[str, Any]:
    return {'colour': _COLOURS[number], 'style': LINE_STYLES[number], 'width_px': 1.9}


def _open_loop_points(tuned: TunedLoop) -> NDArray[np.complex128]:
    loop, evidence = tuned.tuning.after.loop, tuned.evidence
    return np.asarray(
        loop.controller_response(evidence.frequency_hz) * evidence.response
        * loop.measurement_response(evidence.frequency_hz))


def _bode(tuned: TunedLoop) -> Picture:
    magnitudes, phases = [], []
    for number, (name, shape) in enumerate(tuned.shapes.items()):
        response = shape.loop.loop(shape.frequency_hz)
        look = _look(number)
        magnitudes.append(Trace(name, shape.frequency_hz, _decibels(response), **look))
        phases.append(Trace(
            name, shape.frequency_hz, np.degrees(np.unwrap(np.angle(response))), **look))
    points = _open_loop_points(tuned)
    if points.size:
        look = {'colour': SERIES[1], 'style': 'none', 'marker': 'open'}
        frequency_hz = tuned.evidence.frequency_hz
        magnitudes.append(Trace('measured points', frequency_hz, _decibels(points), **look))
        first = tuned.tuning.after
        model_deg = np.interp(
            frequency_hz, first.frequency_hz, np.asarray(phases[0].y, dtype=np.float64))
        # On the branch of the model: unwrapped, points far apart would be a turn off.
        angle_deg = np.degrees(np.angle(points))
        phases.append(Trace(
            'measured points', frequency_hz,
            angle_deg + 360.0 * np.round((model_deg - angle_deg) / 360.0), **look))
    shape = tuned.tuning.after
    marks = [
        Line(shape.crossover_frequency_hz,
             f'|L| = 1, phase margin {shape.phase_margin_deg:.3g}°', 'x')]
    floor = max(_LOWEST_DB, min(float(np.min(np.asarray(each.y))) for each in magnitudes))
    ceiling = min(60.0, max(float(np.max(np.asarray(each.y))) for each in magnitudes))
    return chart_picture(
        'bode', f'Bode diagram of the open loop L; gain margin {_decibels_text(shape.gain_margin)},'
        f' phase margin {shape.phase_margin_deg:.3g}°.', [
            Panel(_FREQUENCY, '|L| (dB)', magnitudes, lines=[
                Line(0.0, '|L| = 1'), *marks,
                *([Line(-20.0 * math.log10(shape.gain_margin), 'gain margin')]
                  if shape.gain_margin < math.inf else [])],
                log_x=True, y_range=(floor - 3.0, ceiling + 3.0)),
            Panel(_FREQUENCY, 'phase of L (°)', phases, lines=[Line(-180.0, '−180°'), marks[0]],
                  log_x=True, y_range=(-400.0, 20.0))])


def _nyquist(tuned: TunedLoop) -> Picture:
    curves = [
        NyquistCurve(name, shape.frequency_hz, shape.loop.loop(shape.frequency_hz))
        for name, shape in tuned.shapes.items()]
    about = '' if tuned.bound is None else (
        ' No disc of |W L| may contain −1: then the loop stays stable for every uncertainty '
        'within W.')
    return Picture(
        'nyquist', 'Nyquist diagram. The curve stays outside of the circle about −1 where |S| is '
        f'within its limit {tuned.tuning.max_sensitivity:.3g}.{about}',
        lambda: nyquist_figure(
            curves, max_sensitivity=tuned.tuning.max_sensitivity, bound=_magnitude(tuned.bound),
            points=_open_loop_points(tuned)),
        [nyquist_panel(
            curves, max_sensitivity=tuned.tuning.max_sensitivity, bound=_magnitude(tuned.bound),
            points=(tuned.evidence.frequency_hz, _open_loop_points(tuned)))])


def _magnitude(bound: Bound | None) -> Callable[[_Floats], _Floats] | None:
    return None if bound is None else lambda frequency_hz: bound_magnitude(bound, frequency_hz)


def _sensitivity(tuned: TunedLoop) -> Picture:
    sensitivities, complements = [], []
    for number, (name, shape) in enumerate(tuned.shapes.items()):
        look = _look(number)
        frequency_hz = shape.frequency_hz
        sensitivities.append(Trace(
            name, frequency_hz, _decibels(shape.loop.sensitivity(frequency_hz)), **look))
        complements.append(Trace(
            name, frequency_hz, _decibels(shape.loop.complementary(frequency_hz)), **look))
    evidence, loop = tuned.evidence, tuned.tuning.after.loop
    if evidence.frequency_hz.size:
        sensitivities.append(Trace(
            'measured points', evidence.frequency_hz,
            _decibels(evidence.point_sensitivity(loop)), SERIES[1], 'none', 'open'))
    if evidence.model_error is not None:
        frequency_hz = tuned.tuning.after.frequency_hz
        sensitivities.append(Trace(
            'largest within the error of the model', frequency_hz, _decibels(np.minimum(
                evidence.band_sensitivity(frequency_hz, loop.loop(frequency_hz)), 1e6)),
            SERIES[4], 'dashdot'))
    if tuned.bound is not None:
        frequency_hz = tuned.tuning.after.frequency_hz
        complements.append(Trace(
            '1/|W|', frequency_hz, -_decibels(bound_magnitude(tuned.bound, frequency_hz)),
            SERIES[3], 'dotted', width_px=2.0))
    limit = 20.0 * math.log10(tuned.tuning.max_sensitivity)
    return chart_picture(
        'sensitivity', 'Sensitivity S: feedback lessens the error of a sine where it is below 0 '
        'dB. Complementary sensitivity T: the loop is robust where |T| is below 1/|W|.', [
            Panel(_FREQUENCY, '|S| (dB)', sensitivities, lines=[
                Line(limit, f'limit {tuned.tuning.max_sensitivity:.3g}'), Line(0.0, '|S| = 1')],
                log_x=True, y_range=(_LOWEST_DB, limit + 6.0)),
            Panel(_FREQUENCY, '|T| (dB)', complements, log_x=True, y_range=(_LOWEST_DB, 26.0))])


def _decibels(values: NDArray[np.complex128] | _Floats) -> _Floats:
    size = np.abs(np.asarray(values))
    return np.asarray(20.0 * np.log10(np.maximum(size, 1e-12)), dtype=np.float64)


def _response_sections(tuned: TunedLoop) -> list[Section]:
    stable = {name: shape for name, shape in tuned.shapes.items() if shape.stable}
    period_s = tuned.tuning.after.loop.sample_period_s
    if period_s is None or not stable:
        return []
    samples = max(settling_samples(shape.loop, period_s) for shape in stable.values())
    pictures = [chart_picture(
        'step', 'Response of the linear loop to a step of 1 µm; rails, slew limit and hysteresis '
        'are not in it.',
        _response_panels(stable, np.ones(samples), period_s, 'displacement (µm)'))]
    if tuned.reference_um is not None:
        pictures.append(chart_picture(
            'scan', f'Response of the linear loop under feedback alone to {tuned.scan}, and below '
            'the error.',
            _response_panels(
                stable, tuned.reference_um, period_s, 'displacement (µm)', with_error=True)))
    return [Section('responses', 'Step and scan', pictures)]


def _response_panels(
    shapes: Mapping[str, LoopShape], reference_um: _Floats, period_s: float, y_label: str,
    *, with_error: bool = False,
) -> list[Panel]:
    traces, errors = [], []
    for number, (name, shape) in enumerate(shapes.items()):
        response = loop_response(shape.loop, reference_um, period_s)
        time_ms = 1e3 * response.time_s
        if not number:
            traces.append(Trace('reference', time_ms, reference_um, SERIES[3], 'dotted'))
        look = _look(number)
        traces.append(Trace(name, time_ms, response.displacement_um, **look))
        errors.append(Trace(
            name, time_ms, 1e3 * (reference_um - response.displacement_um), **look))
    panels = [Panel('time (ms)', y_label, traces)]
    if with_error:
        panels.append(Panel('time (ms)', 'error (nm)', errors))
    return panels


def _map_sections(tuned: TunedLoop) -> list[Section]:
    if not tuned.points:
        return []
    points = tuned.points
    rows = [[
        point.amplitude_um, point.frequency_hz,
        Cell(point.scheme, scheme=point.scheme), point.chosen.harmonics, point.nrmse_percent,
        str(point.interval), ', '.join(point.chosen.unknown) or '–',
        'yes' if point.chosen.is_limited else 'no',
        '/'.join(point.schemes_by_place) if point.depends_on_place else '–'] for point in points]
    return [Section('schemes', 'Which scheme, over amplitude and frequency', [
        Picture(
            'schemes', 'Scheme of least predicted error, its NRMSE and where that is expected; '
            '! the amplifier is at its limits, ? the scheme depends on which poles are before the '
            'hysteresis.', lambda: scheme_map_figure(points)),
        Table([
            Column('amplitude', 'µm', 'g'), Column('frequency', 'Hz', 'g'), Column('scheme'),
            Column('m', '', 'd'), Column('NRMSE', '%', '.3g'),
            Column('expected between', '%'), Column('not known'), Column('amplifier at its limits'),
            Column('depends on the place')], rows, 'Predicted operating points. Where a part of '
            'the error is not known, the upper end is open (?).')])]
