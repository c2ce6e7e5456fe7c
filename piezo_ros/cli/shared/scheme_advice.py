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

"""The part of ``piezo tune`` that says which scheme to use at each operating point."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.experiment.model_file import read_accuracy, read_model
from piezo_ros.experiment.plan.automatic import AUTO, known_rig, place_is_told
from piezo_ros.identification.prediction.operating_points import (
    OperatingPoint,
    feedback_table,
    predict_operating_points,
)
from piezo_ros.identification.prediction.placement import likely_place
from piezo_ros.identification.prediction.planned_choice import plan_candidate, with_planned
from piezo_ros.model import HysteresisParameters, RigParameters
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.parameter_file import read_parameter_file, read_parameter_set

if TYPE_CHECKING:
    from piezo_ros.identification.tuning.linear_plant import Bound
    from piezo_ros.identification.tuning.pi_tuning import PiTuning

__all__ = ['NO_BOUND', 'operating_points_text', 'predicted_points']

NO_BOUND: Final = Path('none')

_SHARES_OF_REACH: Final = tuple(i / 12.0 for i in range(1, 6))
_SHARES_OF_ACCEPTABLE: Final = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0)
_SAMPLES_PER_PERIOD: Final = 20.0  # at least, of the scans that are predicted unasked
_MOST_OF_A_PERIOD: Final = 500_000  # samples, of the scans that are predicted
_DEFAULT_SCAN_HZ: Final = 300.0


def predicted_points(
    options: argparse.Namespace, tuning: 'PiTuning', bound: 'Bound | None',
) -> tuple[OperatingPoint, ...]:
    """Return what to expect at the operating points that the options ask for."""
    harmonics_open = options.harmonics == AUTO
    period_s = options.sample_period_s
    highest_hz = 1.0 / (_SAMPLES_PER_PERIOD * period_s)
    compensator = HysteresisParameters() if options.compensator is None else read_model(
        options.compensator, HysteresisParameters)
    plant = _plant(options)
    scan = read_parameter_set(options.model, 'trajectory', TrajectoryParameters, {
        'sample_period_s': period_s, 'frequency_hz': min(_DEFAULT_SCAN_HZ, highest_hz)}).replaced(
            waveform=options.waveform, sample_period_s=period_s, **{
                name: getattr(options, name) for name in ('offset_um', 'turn_fraction')
                if getattr(options, name) is not None})
    if not place_is_told(read_parameter_file(options.model, ['trajectory'])['trajectory']):
        scan = likely_place(scan)
    lead = tuning.after.loop.lead
    controller = ControllerParameters(
        proportional_gain=tuning.proportional_gain,
        integral_gain_per_s=tuning.integral_gain_per_s,
        lead_zero_hz=lead.zero_hz if lead else 0.0,
        lead_pole_hz=lead.pole_hz if lead else 0.0,
        measurement_delay_samples=options.measurement_delay_samples,
        command_minimum_um=-plant.reach_um, command_maximum_um=plant.reach_um)
    if abs(scan.offset_um) >= plant.reach_um:
        where = str(options.model) if options.offset_um is None else '--offset-um'
        raise PlanError(
            f'{where}: offset_um is {scan.offset_um:g} um, it must be between -{plant.reach_um:g} '
            f'and {plant.reach_um:g} um (the reach of the stage)')
    amplitudes_um = options.amplitudes_um or [
        _rounded(share * plant.reach_um) for share in _SHARES_OF_REACH]
    for amplitude_um in amplitudes_um:
        if not 0.0 < amplitude_um <= plant.reach_um - abs(scan.offset_um):
            beside = f', beside the offset of {scan.offset_um:g} um' if scan.offset_um else ''
            raise PlanError(
                f'--amplitudes-um has {amplitude_um:g}, allowed is above 0 … '
                f'{plant.reach_um - abs(scan.offset_um):g} um (the reach of the stage{beside})')
    frequencies_hz = options.frequencies_hz or _default_frequencies_hz(tuning, highest_hz)
    for frequency_hz in frequencies_hz:
        if not 0.0 < frequency_hz < 0.5 / period_s:
            raise PlanError(
                f'--frequencies-hz has {frequency_hz:g}, allowed is above 0 and below '
                f'{0.5 / period_s:g} Hz (the Nyquist frequency)')
        if frequency_hz * period_s * _MOST_OF_A_PERIOD < 1.0:
            raise PlanError(
                f'--frequencies-hz has {frequency_hz:g}, of which a period has '
                f'{1.0 / (frequency_hz * period_s):g} samples, allowed are {_MOST_OF_A_PERIOD}; '
                'take a longer --sample-period-s')
    told = {} if options.plant is None else {'plant': {'order': plant.order}}
    cells = [(a, f) for a in sorted(set(amplitudes_um)) for f in sorted(set(frequencies_hz))]
    if not harmonics_open:
        scan = scan.replaced(frequency_hz=max(frequencies_hz), harmonics=int(options.harmonics))
    rig = known_rig(told, plant, compensator, scan)
    accuracy = read_accuracy(_model_files(options))
    points = predict_operating_points(
        rig, scan, controller, cells, harmonics_open=harmonics_open, compensator=compensator,
        uncertainty=bound, accuracy=accuracy)
    if not harmonics_open:
        return points
    return tuple(
        with_planned(point, plan_candidate(
            rig, scan.replaced(
                amplitude_um=point.amplitude_um, frequency_hz=point.frequency_hz),
            uncertainty=bound, accuracy=accuracy))
        for point in points)


def _model_files(options: argparse.Namespace) -> list[Path]:
    return [path for path in (options.model, options.compensator) if path is not None]


def _default_frequencies_hz(tuning: 'PiTuning', highest_hz: float) -> list[float]:
    """Return frequencies about the feedback-acceptable one, as far as they can be sampled."""
    base_hz = tuning.after.feedback_acceptable_frequency_hz
    if not 0.0 < base_hz < math.inf:
        rates = abs(tuning.after.loop.plant.poles_rad_per_s)
        base_hz = float(rates[rates > 0.0].min()) / (2.0 * math.pi * max(_SHARES_OF_ACCEPTABLE))
    base_hz = min(base_hz, highest_hz / max(_SHARES_OF_ACCEPTABLE))
    return [_rounded(share * base_hz) for share in _SHARES_OF_ACCEPTABLE]


def _plant(options: argparse.Namespace) -> RigParameters:
    if options.plant is None:
        return RigParameters()
    return read_parameter_set(options.plant, 'plant', RigParameters)


def _rounded(value: float) -> float:
    return float(f'{value:.2g}')


def operating_points_text(
    points: Sequence[OperatingPoint], options: argparse.Namespace,
) -> str:
    """Return amplitudes by frequencies, each with the scheme to use, m and the predicted NRMSE."""
    frequencies_hz = sorted({point.frequency_hz for point in points})
    table = feedback_table(points)
    hysteresis = options.compensator or 'Table 1 of the paper'
    amplifier = options.plant or 'rails of the paper, no slew limit'
    lines = [
        f'{options.waveform}, hysteresis: {hysteresis}, amplifier: {amplifier}',
        'scheme to use, m of its feedforward, predicted NRMSE in % (! amplifier at its limits)',
        f'{"":>10}' + ''.join(f'{f"{f:g} Hz":>15}' for f in frequencies_hz)
        + f'{"fbff below":>14}']
    for amplitude_um, acceptable_hz in zip(*table, strict=True):
        row = sorted(
            (point for point in points if point.amplitude_um == amplitude_um),
            key=lambda point: point.frequency_hz)
        lines.append(
            f'{f"{amplitude_um:g} um":>10}' + ''.join(f'{_cell(point):>15}' for point in row)
            + f'{f"{acceptable_hz:.4g} Hz" if acceptable_hz else "–":>14}')
    if any(
            point.scheme == 'fbff' and not dict(zip(*table, strict=True))[point.amplitude_um]
            for point in points):
        lines.append(
            '– nowhere from 0 Hz on: where a cell of that row says fbff, scheme auto takes ff')
    lines += ['', *_interval_lines(points, frequencies_hz, options), *_place_lines(points)]
    return '\n'.join(lines)


def _interval_lines(
    points: Sequence[OperatingPoint], frequencies_hz: Sequence[float],
    options: argparse.Namespace,
) -> list[str]:
    """Return where each of these errors is expected, and the parts of that."""
    lines = [
        'expected between, NRMSE in %' + (
            ' (? nothing is known of a part)' if points[0].chosen.unknown else ''),
        f'{"":>10}' + ''.join(f'{f"{f:g} Hz":>15}' for f in frequencies_hz)]
    for amplitude_um in sorted({point.amplitude_um for point in points}):
        row = sorted(
            (point for point in points if point.amplitude_um == amplitude_um),
            key=lambda point: point.frequency_hz)
        lines.append(
            f'{f"{amplitude_um:g} um":>10}'
            + ''.join(f'{point.interval!s:>15}' for point in row))
    accuracy = read_accuracy(_model_files(options))
    files = ' and '.join(map(str, _model_files(options)))
    residual, error = accuracy.hysteresis_rms_um, accuracy.model_error
    usable = '' if math.isinf(accuracy.usable_to_hz) else f' up to {accuracy.usable_to_hz:.4g} Hz'
    lines += [
        'made of: hysteresis residual '
        + (f'not known ({files} tell none)' if residual is None else f'{1e3 * residual:.3g} nm'),
        f'         W(s) {"not known" if options.bound == NO_BOUND else "as above"}, error of the '
        'dynamics '
        + (f'not known ({options.model} tells none)' if error is None
           else f'{100.0 * error:.3g} %{usable}'),
        f'         noise {1e3 * _noise_um(options):.3g} nm ({options.plant or "of the paper"})']
    return lines


def _noise_um(options: argparse.Namespace) -> float:
    return _plant(options).noise_rms_um


def _place_lines(points: Sequence[OperatingPoint]) -> list[str]:
    """Return at which points the scheme depends on a place that is not decided."""
    if not any(point.chosen.by_place_percent for point in points):
        return []
    lines = [
        'which poles are before the hysteresis is not decided: intervals cover every possibility']
    depending = [point for point in points if point.depends_on_place]
    for amplitude_um in dict.fromkeys(point.amplitude_um for point in depending):
        places = ', '.join(
            f'{point.frequency_hz:g} Hz ({" or ".join(dict.fromkeys(point.schemes_by_place))})'
            for point in depending if point.amplitude_um == amplitude_um)
        lines.append(f'  the scheme depends on it at {amplitude_um:g} um: {places}')
    return [*lines, *([] if depending else ['  the schemes do not depend on it'])]


def _cell(point: OperatingPoint) -> str:
    scheme = point.scheme
    mark = '!' if point.limited[scheme] else ''
    return (
        f'{scheme} {point.harmonics[scheme]} '
        f'{point.predicted_nrmse_percent[scheme]:.2f}{mark}')
