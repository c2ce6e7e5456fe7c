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

"""
Which scheme, and how many harmonics, at each operating point: amplitude by frequency of a scan.

Predicted from what is known of the rig: G, hysteresis, W, the amplifier's rails and slew limit, and
the spectrum of the trajectory. It generalises the feedback-acceptable condition, (18) in Liu 2015,
which knows of one frequency only.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.identification.prediction.harmonics import HarmonicsChoice, choose_harmonics
from piezo_ros.identification.prediction.scheme_choice import (
    SchemePrediction,
    crossing_frequency_hz,
    recommend_scheme,
)
from piezo_ros.identification.prediction.tracking import SimulatedTracking
from piezo_ros.identification.tuning.controller_file import FeedbackTable
from piezo_ros.identification.tuning.linear_plant import Bound
from piezo_ros.identification.tuning.loop_shape import LoopShape
from piezo_ros.model import HysteresisParameters, RigParameters

__all__ = [
    'OperatingPoint',
    'feedback_table',
    'predict_operating_point',
    'predict_operating_points',
]


@dataclass(frozen=True)
class OperatingPoint:
    """
    What to use at one operating point, and what to expect.

    Attributes
    ----------
    amplitude_um, frequency_hz : float
        The scan.
    scheme : str
        ``'ff'``, ``'fbff'`` or ``'fb'``: the one of least predicted error.
    predicted_nrmse_percent : mapping of str to float
        Every scheme that was considered, with the number of harmonics that suits it best where that
        was left open. An unstable loop is not considered.
    harmonics : mapping of str to int
        Highest harmonic m of the feedforward under each scheme; 0 without feedforward.
    choices : mapping of str to HarmonicsChoice
        The alternatives to it, where m was left open.
    loop : LoopShape
        The feedback loop.
    limited : mapping of str to bool
        Whether the amplifier would be at its limits.

    """

    amplitude_um: float
    frequency_hz: float
    scheme: str
    predicted_nrmse_percent: Mapping[str, float]
    harmonics: Mapping[str, int]
    choices: Mapping[str, HarmonicsChoice]
    loop: LoopShape
    limited: Mapping[str, bool]


def predict_operating_point(
    known: RigParameters,
    trajectory: TrajectoryParameters,
    controller: ControllerParameters,
    *,
    harmonics_open: bool = True,
    compensator: HysteresisParameters | None = None,
    uncertainty: Bound | None = None,
    score_periods: float = 4.0,
) -> OperatingPoint:
    """
    Return what to use for a scan.

    Parameters
    ----------
    known : RigParameters
        What is known of the rig: identified dynamics and hysteresis, the amplifier's slew limit
        and rails; see `choose_harmonics`.
    trajectory : TrajectoryParameters
        The scan, a triangle or a sine, with the dynamics that its feedforward inverts.
    controller : ControllerParameters
        The gains; its own scheme does not matter.
    harmonics_open : bool, optional
        Whether to choose m; else that of ``trajectory`` is taken.
    compensator : HysteresisParameters, optional
        The hysteresis that is inverted; that of ``known`` by default.
    uncertainty : UncertaintyBound, control.TransferFunction or callable, optional
        W(s), or a measured |Delta| as a function of the frequency in hertz.
    score_periods : float, optional
        Periods at the end of the simulated runs that are scored.

    Returns
    -------
    OperatingPoint
        The scheme and the predicted errors.

    Raises
    ------
    ParameterError
        If the waveform has no Fourier series.
    ValueError
        If both gains are 0, or the run is shorter than what is scored.

    """
    choices: dict[str, HarmonicsChoice] = {}

    def choose(scheme: str) -> HarmonicsChoice:
        choices[scheme] = choose_harmonics(
            known, trajectory, controller.replaced(scheme=scheme), compensator=compensator,
            uncertainty=uncertainty, score_periods=score_periods)
        return choices[scheme]

    scan = trajectory.replaced(harmonics=choose('ff').harmonics) if harmonics_open else trajectory
    recommended = recommend_scheme(
        known, scan, controller, compensator=compensator, uncertainty=uncertainty,
        score_periods=score_periods)
    if harmonics_open and 'fbff' in recommended.predictions:
        choose('fbff')
    predicted = {
        name: choices[name].chosen.nrmse_percent if name in choices else one.nrmse_percent
        for name, one in recommended.predictions.items()}
    return OperatingPoint(
        amplitude_um=trajectory.amplitude_um, frequency_hz=trajectory.frequency_hz,
        scheme=min(predicted, key=lambda name: predicted[name]),
        predicted_nrmse_percent=predicted,
        harmonics={
            name: choices[name].harmonics if name in choices
            else 0 if name == 'fb' else scan.harmonics for name in predicted},
        choices=choices, loop=recommended.loop,
        limited={
            name: _simulated(one, choices.get(name)).is_limited
            for name, one in recommended.predictions.items()})


def _simulated(
    prediction: SchemePrediction, choice: HarmonicsChoice | None,
) -> SimulatedTracking:
    simulated = choice.chosen.simulated if choice else prediction.simulated
    assert simulated is not None  # a rig is known
    return simulated


def predict_operating_points(
    known: RigParameters,
    trajectory: TrajectoryParameters,
    controller: ControllerParameters,
    cells: Iterable[tuple[float, float]],
    *,
    harmonics_open: bool = True,
    compensator: HysteresisParameters | None = None,
    uncertainty: Bound | None = None,
) -> tuple[OperatingPoint, ...]:
    """
    Return what to use at several operating points.

    Parameters
    ----------
    known, controller, harmonics_open, compensator, uncertainty
        As for `predict_operating_point`.
    trajectory : TrajectoryParameters
        The scan; its own amplitude and frequency do not matter.
    cells : iterable of (amplitude in um, frequency in Hz)
        The operating points.

    """
    return tuple(
        predict_operating_point(
            known, trajectory.replaced(amplitude_um=amplitude_um, frequency_hz=frequency_hz),
            controller, harmonics_open=harmonics_open, compensator=compensator,
            uncertainty=uncertainty)
        for amplitude_um, frequency_hz in cells)


def feedback_table(points: Sequence[OperatingPoint]) -> FeedbackTable:
    """
    Return, for each amplitude of some operating points, where feedback stops helping.

    Nothing is promised beyond the highest frequency of the points: where feedback helps at all of
    them, the table ends just above it.

    Parameters
    ----------
    points : sequence of OperatingPoint
        Several frequencies of each amplitude.

    """
    rows: dict[float, list[OperatingPoint]] = {}
    for point in points:
        rows.setdefault(point.amplitude_um, []).append(point)
    amplitudes_um = tuple(sorted(rows))
    return FeedbackTable(amplitudes_um, tuple(_acceptable_hz(rows[a]) for a in amplitudes_um))


def _acceptable_hz(row: list[OperatingPoint]) -> float:
    row = sorted(row, key=lambda point: point.frequency_hz)
    if not all('fbff' in point.predicted_nrmse_percent for point in row):
        return 0.0
    frequencies_hz = [point.frequency_hz for point in row]
    crossing_hz = crossing_frequency_hz(
        frequencies_hz, [point.predicted_nrmse_percent['ff'] for point in row],
        [point.predicted_nrmse_percent['fbff'] for point in row])
    if crossing_hz == math.inf:
        return math.nextafter(frequencies_hz[-1], math.inf)
    return crossing_hz
