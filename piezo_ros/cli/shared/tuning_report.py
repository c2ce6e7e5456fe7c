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

"""The page that ``piezo tune --report`` writes."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from piezo_ros.control import TrajectoryParameters
from piezo_ros.control.closed_loop import target_of
from piezo_ros.experiment.model_file import identified_facts
from piezo_ros.model import LinearDynamics
from piezo_ros.parameters.parameter_file import read_parameter_set
from piezo_ros.parameters.provenance import software_versions
from piezo_ros.report.analysis.tuning_page import TunedLoop, write_tuning_page

if TYPE_CHECKING:
    from piezo_ros.identification import OperatingPoint
    from piezo_ros.identification.tuning.linear_plant import Bound, Model
    from piezo_ros.identification.tuning.loop_evidence import LoopEvidence
    from piezo_ros.identification.tuning.loop_shape import LoopShape
    from piezo_ros.identification.tuning.pi_tuning import PiTuning

__all__ = ['write_tuning_report']

_PERIODS: Final = 3.0
_SAMPLES_PER_PERIOD: Final = 40.0  # at least, of the scan that is drawn
_MOST_SAMPLES: Final = 2**16


def write_tuning_report(
    options: argparse.Namespace, model: 'Model', tuning: 'PiTuning', published: 'LoopShape',
    evidence: 'LoopEvidence', bound: 'Bound | None', points: Sequence['OperatingPoint'],
) -> Path:
    """
    Draw tuned gains and write the page.

    Parameters
    ----------
    options : argparse.Namespace
        The arguments of the command.
    model : LinearDynamics, DynamicsFit or control.TransferFunction
        The model.
    tuning, published, evidence, bound, points
        As for `TunedLoop`.

    Returns
    -------
    Path
        report.html.

    """
    reference_um, scan = _scan(options, model, tuning)
    tuned = TunedLoop(
        tuning, published, evidence, bound, reference_um, scan, points,
        _remarks(options, tuning, evidence))
    return write_tuning_page(
        options.report, title=f'Gains for {options.model.name}', tuned=tuned,
        software=software_versions(), command=' '.join(['piezo', *sys.argv[1:]]))


def _scan(
    options: argparse.Namespace, model: 'Model', tuning: 'PiTuning',
) -> tuple[Any, str]:
    """Return the scan of the model file, as slow as the sampling needs, and its name."""
    if not isinstance(model, LinearDynamics):
        return None, ''
    period_s = options.sample_period_s
    highest_hz = 1.0 / (_SAMPLES_PER_PERIOD * period_s)
    told = read_parameter_set(
        options.model, 'trajectory', TrajectoryParameters,
        {'sample_period_s': period_s, 'frequency_hz': min(300.0, highest_hz)})
    acceptable_hz = tuning.after.feedback_acceptable_frequency_hz
    frequency_hz = min(told.frequency_hz, highest_hz)
    if _PERIODS / (frequency_hz * period_s) > _MOST_SAMPLES:
        frequency_hz = min(max(acceptable_hz / 4.0, frequency_hz), highest_hz)
    scan = told.replaced(
        sample_period_s=period_s, frequency_hz=frequency_hz, waveform=options.waveform,
        periods=_PERIODS, harmonics=0, file='', file_changes='', output='displacement')
    reference_um, _ = target_of(scan)
    return reference_um[:_MOST_SAMPLES], (
        f'a {options.waveform} of {scan.amplitude_um:g} µm and {frequency_hz:g} Hz')


def _remarks(
    options: argparse.Namespace, tuning: 'PiTuning', evidence: 'LoopEvidence',
) -> list[str]:
    """Return how far the margins and predictions may be trusted."""
    verdict = identified_facts(options.model, 'identified_dynamics').get('verdict')
    points, band = tuning.point_sensitivity, tuning.band_sensitivity
    return [
        f'Model: {options.model}, ' + (
            f'verdict of its identification: {verdict}.' if verdict
            else 'which tells no verdict of an identification: how far it holds is not known.'),
        'All margins are those of the linear model, sampled every '
        f'{options.sample_period_s:g} s, with a measurement that is '
        f'{options.measurement_delay_samples} samples old. ' + (
            'They have not been compared with measured points: the model file names none. '
            if points is None else
            f'On the {evidence.frequency_hz.size} measured points |S| is at most {points:.3g}. ')
        + ('The error of the model is not known.' if band is None
           else f'Within the error of the model |S| is at most {band:.3g}.')]
