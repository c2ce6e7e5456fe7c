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

"""The sections of the study's page on models: Tables 1 and 2, Fig. 5 to 9."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from piezo_ros import paper
from piezo_ros.identification import DynamicsFit, ExcludedPoint, FrequencyResponse
from piezo_ros.model import LinearDynamics
from piezo_ros.report.figures.frequency_response_figure import ResponseCurve, response_figure
from piezo_ros.report.figures.hysteresis_figure import Loop, loops_figure
from piezo_ros.report.figures.uncertainty_figure import BoundCurve, uncertainty_figure
from piezo_ros.report.page.content import Column, Paragraph, Picture, Section, Table
from piezo_ros.study.experiments import CREEP
from piezo_ros.study.page_elements import PERCENT, Rows, known
from piezo_ros.study.record import left_out, published_uncertainty
from piezo_ros.study.results import PaperResults, StaticLoop

__all__ = [
    'dynamics_section',
    'hysteresis_section',
    'loop_section',
    'static_section',
    'uncertainty_section',
]

_SYMBOLS = {
    'gain_k_rad3_per_s3': 'k (rad³/s³)',
    'zero_b1_rad_per_s': 'b1 (rad/s)',
    'zero_b2_rad2_per_s2': 'b2 (rad²/s²)',
    'time_constant_s': 'τ (s)',
    'damping_ratio_1': 'ζ1',
    'natural_frequency_1_rad_per_s': 'ω1 (rad/s)',
    'damping_ratio_2': 'ζ2',
    'natural_frequency_2_rad_per_s': 'ω2 (rad/s)',
}
_MARGINS = (
    ('|S| = 1 at', 'feedback_acceptable_frequency_hz', 'Hz'),
    ('bandwidth', 'bandwidth_hz', 'Hz'),
    ('max |S|', 'max_sensitivity', ''),
    ('gain margin', 'gain_margin', ''),
    ('phase margin', 'phase_margin_deg', '°'),
    ('max |W T|', 'weighted_peak', ''),
)


def static_section(results: PaperResults) -> Section:
    """Return Fig. 5."""
    loops: Sequence[tuple[str, StaticLoop, Mapping[str, float]]] = (
        ('without compensator', results.uncompensated, paper.UNCOMPENSATED_NONLINEARITY_PERCENT),
        ('published inverse', results.compensated, paper.COMPENSATED_NONLINEARITY_PERCENT),
        ('identified inverse', results.compensated_identified,
         paper.COMPENSATED_NONLINEARITY_PERCENT),
        ('published inverse, with creep', results.compensated_creeping, {}))
    rows: Rows = [
        [name, PERCENT * loop.nonlinearity.input, published.get('input'),
         PERCENT * loop.nonlinearity.output, published.get('output')]
        for name, loop, published in loops]
    return Section('static', 'Fig. 5: hysteresis before and after compensation', [
        Picture('hysteresis-loops', 'A 1 Hz triangle of ±3 V, and of ±3 µm through the inverse; '
                'below, the deviation of each from its straight line, in nanometres.',
                lambda: loops_figure(
                    _loop_curve(results.uncompensated, 'voltage (V)'),
                    _loop_curve(results.compensated, 'command (µm)'))),
        Table(
            [Column('loop'), Column('input', '%', '.2f'), Column('paper', '%', '.2f'),
             Column('output', '%', '.2f'), Column('paper', '%', '.2f')], rows,
            name='nonlinearity')])


def hysteresis_section(results: PaperResults) -> Section:
    """Return Table 1 re-identified."""
    fit = results.hysteresis
    printed = sorted(
        zip(paper.KAPPA_UM_PER_V, [*paper.SATURATION_V, None], strict=True),
        key=lambda element: math.inf if element[1] is None else element[0] * element[1])
    kappa, saturation = fit.parameters.kappa_um_per_v, [*fit.parameters.saturation_v, None]
    saturation_error = [*map(known, fit.saturation_standard_error_v), None]
    rows: Rows = [
        [str(i + 1), kappa[i], known(fit.kappa_standard_error_um_per_v[i]), saturation[i],
         saturation_error[i], *element]
        for i, element in enumerate(printed)]
    return Section('table-1', 'Table 1 re-identified: the hysteresis', [
        Paragraph(
            f'From a triangle of decreasing amplitude; residual {fit.rms_um * 1e3:.2f} nm rms. '
            'Both stand in the order in which the elements saturate. The gain mismatch of the rig '
            'is part of every κ.'),
        Table(
            [Column('element'), Column('κ', 'µm/V', '.4f'), Column('±', 'µm/V', '.2g'),
             Column('u_S', 'V', '.4f'), Column('±', 'V', '.2g'),
             Column('κ, Table 1', 'µm/V', '.4f'), Column('u_S, Table 1', 'V', '.4f')], rows,
            caption='± one standard error', name='table-1')])


def dynamics_section(results: PaperResults) -> Section:
    """Return Table 2, Fig. 6 and Fig. 7."""
    published, fit = results.dynamics_published, results.dynamics
    grid = [r for r in results.compensated_responses if abs(float(r.offset[0])) < 1e-9]
    model_hz = np.geomspace(20.0, results.wide_response.frequency_hz.max(), 300)
    rows: Rows = [
        [symbol, float(paper.TABLE_2[name]), published.values[name],
         published.standard_errors[name], fit.values[name], fit.standard_errors[name]]
        for name, symbol in _SYMBOLS.items()]
    return Section('table-2', 'Table 2, Fig. 6 and 7: the linear dynamics', [
        Picture('bare', 'Fig. 6: the bare actuator, with a gain that depends on the amplitude; '
                'the smallest one past the second resonance.',
                lambda: response_figure(
                    [_curve(sweeps, 'V') for sweeps in results.bare_responses],
                    title='Bare actuator', unit='µm/V', decibels=True)),
        Paragraph(
            'The slow decline at low frequencies is creep, which these runs of the rig have and no '
            f'other ones: {CREEP["creep_per_decade"]:.0%} for every tenfold time, beginning '
            f'{CREEP["creep_start_s"]:g} s after a step. The amount is one that is common for such '
            'ceramics; the paper has no number.'),
        Picture('compensated', 'Fig. 7: the same behind the published inverse, with the fit; the '
                'smallest amplitude past the second resonance.',
                lambda: response_figure(
                    [*(_curve((r,), 'µm') for r in (*grid, results.wide_response)),
                     ResponseCurve('fit of (6)', model_hz, published.sampled_response(model_hz),
                                   style='line'),
                     ResponseCurve(
                         'Table 2', model_hz, LinearDynamics().sampled_response(
                             model_hz, published.sample_period_s), style='line')],
                    title='Compensated actuator', unit='µm/µm', decibels=True)),
        Paragraph(
            f'The second resonance of the fit lies at {_resonance_hz(published):.0f} Hz, that of '
            f'Table 2 at {paper.TABLE_2["natural_frequency_2_rad_per_s"] / (2.0 * np.pi):.0f} Hz: '
            f'the measurement ends at {results.wide_response.frequency_hz.max():.0f} Hz.'),
        Paragraph(
            'Both models are sampled behind the zero-order hold, as the record is. Identified from '
            'sweeps of 0.1 to 0.4 µm, 20 Hz to 8 kHz, behind the published inverse and behind the '
            'identified one, which has the gain of the rig in it. The rig is not exactly (6): its '
            'amplifier stands before the hysteresis.'),
        Table(
            [Column('parameter'), Column('Table 2', '', '.6g'),
             Column('published inverse', '', '.6g'), Column('±', '', '.2g'),
             Column('identified inverse', '', '.6g'), Column('±', '', '.2g')], rows,
            caption='± one standard error',
            name='table-2')])


def uncertainty_section(results: PaperResults) -> Section:
    """Return Fig. 8."""
    bound = results.uncertainty
    frequency_hz = np.geomspace(
        float(bound.frequency_hz.min()), float(bound.frequency_hz.max()), 200)
    published_curve = BoundCurve('W, (19)', frequency_hz, paper.uncertainty_magnitude(frequency_hz))
    measured_hz, delta = published_uncertainty(results)
    below = float(np.mean(delta <= paper.uncertainty_magnitude(measured_hz)))
    excluded = left_out(results.identified_responses)
    by_amplitude: dict[str, list[ExcludedPoint]] = {}
    for point in sorted(excluded, key=lambda point: (point.amplitude, point.frequency_hz)):
        by_amplitude.setdefault(f'{point.amplitude:.2g} µm', []).append(point)
    excluded_rows: Rows = [
        [amplitude, points[0].frequency_hz, len(points), points[0].reason]
        for amplitude, points in by_amplitude.items()]
    return Section('uncertainty', 'Fig. 8: the multiplicative uncertainty', [
        Paragraph(
            'Offsets −1.5 … 1.5 V and amplitudes 0.5 … 2.5 V. As published: behind the published '
            'inverse, against G of Table 2 behind the zero-order hold. '
            f'{below:.0%} of {delta.size} points lie below (19), which allows '
            f'{paper.uncertainty_magnitude(0.0):.1%} at low frequencies; the gain of the rig is '
            f'off by {np.median(delta[measured_hz == measured_hz.min()]):.1%}.'),
        Picture('uncertainty-published', 'As published: measured |Δ| and (19) of the paper.',
                lambda: uncertainty_figure(measured_hz, delta, [published_curve])),
        Paragraph(
            'Re-identified: behind the identified inverse, against the identified G. W (order '
            f'{bound.order}) lies above every one of {bound.frequency_hz.size} points, on average '
            f'{bound.mean_excess_db:.1f} dB above their maximum.'),
        Picture('uncertainty', 'Re-identified: measured |Δ|, our W and (19) of the paper.',
                lambda: uncertainty_figure(
                    bound.frequency_hz, np.abs(bound.uncertainty), [
                        BoundCurve('W, identified', frequency_hz, bound.magnitude(frequency_hz)),
                        published_curve])),
        Paragraph(
            f'{len(excluded)} more points of this grid were left out:'),
        Table(
            [Column('amplitude'), Column('from', 'Hz', '.0f'), Column('points', '', 'd'),
             Column('reason at the lowest frequency')], excluded_rows,
            name='left-out')])


def loop_section(results: PaperResults) -> Section:
    """Return Fig. 9 and the margins."""
    measured = results.closed_loop
    loops = {
        'published, continuous': results.loop_published.record(),
        'published, on the rig': results.loop_identified.record(),
        'tuned': results.tuning.after.record()}
    rows: Rows = [
        [f'{title} ({unit})' if unit else title, *(record[key] for record in loops.values())]
        for title, key, unit in _MARGINS]
    law = results.loop_identified.loop
    model_hz = np.geomspace(measured.frequency_hz[0], measured.frequency_hz[-1], 200)
    return Section('loop', 'Fig. 9: the closed loop, and tuned gains', [
        Picture('closed-loop', 'Reference to displacement under feedback: measured and predicted.',
                lambda: response_figure(
                    [_curve((measured,), 'µm'),
                     # The delay of the measurement is in the loop, not in what is recorded.
                     ResponseCurve('with the fit of (6)', model_hz,
                                   law.complementary(model_hz) / law.measurement_response(model_hz),
                                   style='line'),
                     ResponseCurve('with Table 2, continuous', model_hz,
                                   results.loop_published.loop.complementary(model_hz),
                                   style='line')],
                    title='Closed loop', unit='µm/µm', decibels=True)),
        Table(
            [Column('loop'), *(Column(name, '', '.4g') for name in loops)], rows,
            caption=(
                f'Tuned by ITAE within max |S| {results.tuning.max_sensitivity:g}: kP '
                f'{results.tuning.proportional_gain:.4g}, kI '
                f'{results.tuning.integral_gain_per_s:.4g} 1/s; Table 2 has '
                f'{paper.TABLE_2["proportional_gain"]:g} and '
                f'{paper.TABLE_2["integral_gain_per_s"]:g} 1/s. W is (19) for the published '
                'gains, the identified one for the tuned.'), name='margins')])


def _curve(sweeps: Sequence[FrequencyResponse], unit: str) -> ResponseCurve:
    """Return one curve of one or several sweeps of the same amplitude."""
    frequency_hz, response, radius = (
        np.concatenate([getattr(sweep, name) for sweep in sweeps])
        for name in ('frequency_hz', 'response', 'confidence_radius'))
    return ResponseCurve(
        f'{float(np.median(sweeps[-1].amplitude)):.2g} {unit}', frequency_hz, response, radius)


def _resonance_hz(fit: DynamicsFit) -> float:
    return fit.values['natural_frequency_2_rad_per_s'] / (2.0 * math.pi)


def _loop_curve(loop: StaticLoop, label: str) -> Loop:
    return Loop(
        loop.input, loop.displacement_um, label, PERCENT * loop.nonlinearity.input,
        PERCENT * loop.nonlinearity.output)
