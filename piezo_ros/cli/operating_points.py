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
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.experiment.plan.automatic import AUTO, known_rig
from piezo_ros.identification.prediction.operating_points import (
    OperatingPoint,
    feedback_table,
    predict_operating_points,
)
from piezo_ros.model import HysteresisParameters, ParameterSet, RigParameters
from piezo_ros.parameters.parameter_file import read_parameter_set

if TYPE_CHECKING:
    from piezo_ros.identification.tuning.linear_plant import Bound
    from piezo_ros.identification.tuning.pi_tuning import PiTuning

__all__ = ['operating_points_text', 'predicted_points']

_Set = TypeVar('_Set', bound=ParameterSet)
_SHARES_OF_REACH: Final = tuple(i / 12.0 for i in range(1, 6))
_SHARES_OF_ACCEPTABLE: Final = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0)


def predicted_points(
    options: argparse.Namespace, tuning: 'PiTuning', bound: 'Bound | None',
) -> tuple[OperatingPoint, ...]:
    """Return what to expect at the operating points that the options ask for."""
    harmonics_open = options.harmonics == AUTO
    if not harmonics_open and not options.harmonics.isdigit():
        raise ValueError(f"--harmonics is {options.harmonics!r}, allowed is a number or 'auto'")
    compensator = _told(options.compensator, 'compensator', HysteresisParameters)
    plant = _told(options.plant, 'plant', RigParameters)
    scan = read_parameter_set(
        options.model, 'trajectory', TrajectoryParameters).replaced(
            waveform=options.waveform, sample_period_s=options.sample_period_s,
            **({} if harmonics_open else {'harmonics': int(options.harmonics)}))
    controller = ControllerParameters(
        proportional_gain=tuning.proportional_gain,
        integral_gain_per_s=tuning.integral_gain_per_s,
        measurement_delay_samples=options.measurement_delay_samples,
        command_minimum_um=-plant.reach_um, command_maximum_um=plant.reach_um)
    amplitudes_um = options.amplitudes_um or [
        _rounded(share * plant.reach_um) for share in _SHARES_OF_REACH]
    for amplitude_um in amplitudes_um:
        if not 0.0 < amplitude_um <= plant.reach_um:
            raise ValueError(
                f'--amplitudes-um has {amplitude_um:g}, allowed is above 0 … {plant.reach_um:g} um '
                '(the reach of the stage)')
    acceptable_hz = tuning.after.feedback_acceptable_frequency_hz
    frequencies_hz = options.frequencies_hz or [
        _rounded(share * acceptable_hz) for share in _SHARES_OF_ACCEPTABLE]
    return predict_operating_points(
        known_rig({}, plant, compensator, scan), scan, controller,
        [(a, f) for a in sorted(set(amplitudes_um)) for f in sorted(set(frequencies_hz))],
        harmonics_open=harmonics_open, compensator=compensator, uncertainty=bound)


def _told(path: Path | None, node: str, parameter_set: type[_Set]) -> _Set:
    return parameter_set() if path is None else read_parameter_set(path, node, parameter_set)


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
            + f'{f"{acceptable_hz:.4g} Hz":>14}')
    return '\n'.join(lines)


def _cell(point: OperatingPoint) -> str:
    scheme = point.scheme
    mark = '!' if point.limited[scheme] else ''
    return (
        f'{scheme} {point.harmonics[scheme]} '
        f'{point.predicted_nrmse_percent[scheme]:.2f}{mark}')
