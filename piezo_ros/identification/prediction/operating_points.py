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
Scheme and number of harmonics for a scan, by its predicted errors.

The feedback-acceptable condition, (18) in Liu 2015, is for one frequency: feedback lessens the
error where |S| < 1, as E_fbff = E_ff S, (14) and (15). A scan has many frequencies, and the
amplifier has limits. So the error of every candidate is predicted and the smallest one decides:

    scheme = argmin NRMSE(scheme, m(scheme)),   scheme in ff, fbff, fb
    m(scheme) = min {m odd: NRMSE(scheme, m) <= 1.01 min over m of NRMSE(scheme, m)}

The number m of harmonics of the feedforward (13) is left to trial in the paper: each further
harmonic lessens the truncation, but adds uncertainty at its frequency and demands more of the
amplifier.

Examples
--------
>>> from piezo_ros.control import ControllerParameters, TrajectoryParameters
>>> from piezo_ros.model import RigParameters
>>> point = predict_operating_point(
...     RigParameters(gain_mismatch=-0.05),
...     TrajectoryParameters(amplitude_um=1.0, frequency_hz=200.0),
...     ControllerParameters(), harmonics_open=False)
>>> point.scheme
'fbff'
>>> sorted(point.predicted_nrmse_percent)
['fb', 'fbff', 'ff']

"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.identification.prediction.accuracy import ErrorInterval, ModelAccuracy
from piezo_ros.identification.prediction.harmonics_choice import (
    HarmonicsChoice,
    choose_harmonics,
)
from piezo_ros.identification.prediction.tracking import TrackingPrediction, predict_tracking
from piezo_ros.identification.tuning.feedback_table import (
    FeedbackTable,
    crossing_frequency_hz,
)
from piezo_ros.identification.tuning.linear_plant import Bound, Model
from piezo_ros.identification.tuning.loop_shape import LoopShape, loop_shape
from piezo_ros.identification.tuning.pi_loop import Lead
from piezo_ros.model import HysteresisParameters, LinearDynamics, RigParameters

__all__ = [
    'HarmonicsChoice',
    'OperatingPoint',
    'choose_harmonics',
    'equal_error_frequency_hz',
    'feedback_table',
    'predict_operating_point',
    'predict_operating_points',
    'recommend_scheme',
]

_CANDIDATES: Final = ('ff', 'fbff', 'fb')


@dataclass(frozen=True)
class OperatingPoint:
    """
    The scheme to use for one scan, and the errors to expect.

    Attributes
    ----------
    amplitude_um, frequency_hz : float
        The scan.
    predictions : mapping of str to TrackingPrediction
        Every scheme that was considered, with the number of harmonics that suits it best where that
        was left open. An unstable loop is not considered.
    choices : mapping of str to HarmonicsChoice
        The alternatives, for each scheme with feedforward, where m was left open; else empty.
    loop : LoopShape or None
        The feedback loop; None where the scheme was given.

    """

    amplitude_um: float
    frequency_hz: float
    predictions: Mapping[str, TrackingPrediction]
    choices: Mapping[str, HarmonicsChoice]
    loop: LoopShape | None = field(repr=False, compare=False)

    @property
    def predicted_nrmse_percent(self) -> dict[str, float]:
        """Expected NRMSE of every scheme considered, percent of the peak-to-peak reference."""
        return {name: one.nrmse_percent for name, one in self.predictions.items()}

    @property
    def scheme(self) -> str:
        """The scheme of least predicted error: one of `predictions`."""
        errors = self.predicted_nrmse_percent
        return min(errors, key=lambda name: errors[name])

    @property
    def schemes_by_place(self) -> tuple[str, ...]:
        """The scheme of least error for each possible place of the hysteresis, its own first."""
        by_place = {name: one.by_place_percent for name, one in self.predictions.items()}
        counts = min(map(len, by_place.values()))
        return tuple(
            min(by_place, key=lambda name: by_place[name][i]) for i in range(counts))

    @property
    def depends_on_place(self) -> bool:
        """Whether another scheme is better with another place of the hysteresis."""
        return len(set(self.schemes_by_place)) > 1

    @property
    def interval(self) -> ErrorInterval:
        """Where the NRMSE under the scheme to use is expected, percent."""
        return self.chosen.interval

    @property
    def chosen(self) -> TrackingPrediction:
        """The prediction for that scheme."""
        return self.predictions[self.scheme]

    @property
    def nrmse_percent(self) -> float:
        """Expected NRMSE under that scheme, percent of the peak-to-peak reference."""
        return self.chosen.nrmse_percent

    @property
    def harmonics(self) -> dict[str, int]:
        """Highest harmonic m of the feedforward under each scheme; 0 without feedforward."""
        return {
            name: 0 if name == 'fb' else one.harmonics for name, one in self.predictions.items()}

    @property
    def limited(self) -> dict[str, bool]:
        """Whether the amplifier would be at its limits, under each scheme."""
        return {name: one.is_limited for name, one in self.predictions.items()}

    @property
    def by_harmonics(self) -> dict[int, float]:
        """Expected NRMSE of each m that was considered, under the scheme to use."""
        if self.scheme in self.choices:
            return self.choices[self.scheme].predicted_nrmse_percent
        return {self.chosen.harmonics: self.nrmse_percent}

    @property
    def feedback_acceptable_frequency_hz(self) -> float:
        """Where |S| = 1: the highest frequency of a sine at which feedback helps, (18)."""
        return math.nan if self.loop is None else self.loop.feedback_acceptable_frequency_hz

    @property
    def reason(self) -> str:
        """Why this scheme and this m, in one or two sentences."""
        sentences = []
        if self.loop is not None or len(self.predictions) > 1:
            listed = ', '.join(
                f'{name} {percent:.3g} %' for name, percent in self.predicted_nrmse_percent.items())
            stability = '' if self.loop is None else (
                f'; |S| = 1 at {self.feedback_acceptable_frequency_hz:.4g} Hz' if self.loop.stable
                else '; the loop is not stable')
            sentences.append(f'{self.scheme} is predicted to err least: {listed}{stability}')
        parts = self.chosen.unknown
        sentences.append(f'expected between: {self.interval} %' + (
            f' (not known: {", ".join(parts)})' if parts else ''))
        if self.depends_on_place:
            sentences.append(
                'which poles are before the hysteresis is not decided, and the scheme depends on '
                f'it: {", ".join(self.schemes_by_place)}')
        if self.scheme in self.choices:
            sentences.append(self.choices[self.scheme].reason)
        return '. '.join(sentences)

    def record(self) -> dict[str, Any]:
        """Return the decision and its grounds for report.json."""
        return {
            'scheme': self.scheme,
            'harmonics': self.chosen.harmonics,
            'nrmse_percent': self.nrmse_percent,
            'low_percent': self.interval.low_percent,
            'high_percent': self.interval.high_percent,
            'unknown': list(self.chosen.unknown),
            'depends_on_place': self.depends_on_place,
            'by_scheme': self.predicted_nrmse_percent,
            'by_harmonics': {str(m): percent for m, percent in self.by_harmonics.items()},
            'reason': self.reason,
        }


def predict_operating_point(
    model: Model | RigParameters,
    trajectory: TrajectoryParameters,
    controller: ControllerParameters,
    *,
    harmonics_open: bool = True,
    compensator: HysteresisParameters | None = None,
    uncertainty: Bound | None = None,
    accuracy: ModelAccuracy | None = None,
    score_periods: float = 4.0,
) -> OperatingPoint:
    """
    Return the scheme and the number of harmonics to use for a scan.

    Parameters
    ----------
    model, compensator, uncertainty, accuracy, score_periods
        As for `predict_tracking`. Only a rig shows where the amplifier cannot follow.
    trajectory : TrajectoryParameters
        The scan, a waveform that repeats, with the dynamics that its feedforward inverts.
    controller : ControllerParameters
        The gains; its own scheme does not matter.
    harmonics_open : bool, optional
        Whether to choose m; else that of ``trajectory`` is taken.

    Returns
    -------
    OperatingPoint
        The scheme and the predicted errors.

    Raises
    ------
    ParameterError
        If the waveform has no Fourier series.
    ValueError
        If both gains are 0, or the run has fewer periods than are scored.

    """
    dynamics = LinearDynamics(model.true_dynamics) if isinstance(model, RigParameters) else model
    loop = loop_shape(
        dynamics, controller.proportional_gain, controller.integral_gain_per_s,
        sample_period_s=trajectory.sample_period_s,
        measurement_delay_samples=controller.measurement_delay_samples,
        lead=Lead.of(controller))
    choices: dict[str, HarmonicsChoice] = {}
    predictions: dict[str, TrackingPrediction] = {}
    for scheme in _CANDIDATES if loop.stable else ('ff',):
        law = controller.replaced(scheme=scheme)
        if harmonics_open and law.uses_feedforward:
            choices[scheme] = choose_harmonics(
                model, trajectory, law, compensator=compensator, uncertainty=uncertainty,
                accuracy=accuracy, score_periods=score_periods)
            predictions[scheme] = choices[scheme].chosen
        else:
            scan = trajectory.replaced(harmonics=0) if harmonics_open else trajectory
            predictions[scheme] = predict_tracking(
                model, scan, law, compensator=compensator, uncertainty=uncertainty,
                accuracy=accuracy, score_periods=score_periods)
    return OperatingPoint(
        trajectory.amplitude_um, trajectory.frequency_hz, predictions, choices, loop)


def recommend_scheme(
    model: Model | RigParameters,
    trajectory: TrajectoryParameters,
    controller: ControllerParameters,
    *,
    compensator: HysteresisParameters | None = None,
    uncertainty: Bound | None = None,
    accuracy: ModelAccuracy | None = None,
    score_periods: float = 4.0,
) -> OperatingPoint:
    """
    Return the scheme to use for a scan with the number of harmonics given.

    Parameters and errors are those of `predict_operating_point`, ``harmonics_open`` being false.
    """
    return predict_operating_point(
        model, trajectory, controller, harmonics_open=False, compensator=compensator,
        uncertainty=uncertainty, accuracy=accuracy, score_periods=score_periods)


def predict_operating_points(
    model: Model | RigParameters,
    trajectory: TrajectoryParameters,
    controller: ControllerParameters,
    cells: Iterable[tuple[float, float]],
    *,
    harmonics_open: bool = True,
    compensator: HysteresisParameters | None = None,
    uncertainty: Bound | None = None,
    accuracy: ModelAccuracy | None = None,
) -> tuple[OperatingPoint, ...]:
    """
    Return the scheme and the number of harmonics to use at several operating points.

    Parameters
    ----------
    model, controller, harmonics_open, compensator, uncertainty, accuracy
        As for `predict_operating_point`.
    trajectory : TrajectoryParameters
        The scan; its own amplitude and frequency do not matter.
    cells : iterable of (amplitude in um, frequency in Hz)
        The operating points.

    Returns
    -------
    tuple of OperatingPoint
        In the order of the cells.

    Raises
    ------
    ParameterError, ValueError
        As for `predict_operating_point`.

    """
    return tuple(
        predict_operating_point(
            model, trajectory.replaced(amplitude_um=amplitude_um, frequency_hz=frequency_hz),
            controller, harmonics_open=harmonics_open, compensator=compensator,
            uncertainty=uncertainty, accuracy=accuracy)
        for amplitude_um, frequency_hz in cells)


def _crossing_of_points(points: Sequence[OperatingPoint]) -> float:
    """Return `crossing_frequency_hz` of points of ascending frequency; 0 for an unstable loop."""
    errors = [point.predicted_nrmse_percent for point in points]
    if not all('fbff' in each for each in errors):
        return 0.0
    return crossing_frequency_hz(
        [point.frequency_hz for point in points], [each['ff'] for each in errors],
        [each['fbff'] for each in errors])


def equal_error_frequency_hz(
    model: Model | RigParameters,
    trajectory: TrajectoryParameters,
    controller: ControllerParameters,
    frequency_hz: ArrayLike,
    *,
    compensator: HysteresisParameters | None = None,
    uncertainty: Bound | None = None,
    accuracy: ModelAccuracy | None = None,
) -> float:
    """
    Return the frequency of the scan at which FF and FBFF are predicted to do equally well.

    Parameters
    ----------
    model, controller, compensator, uncertainty, accuracy
        As for `predict_operating_point`.
    trajectory : TrajectoryParameters
        Waveform, amplitude and harmonics; its own frequency does not matter.
    frequency_hz : array_like, shape (N,)
        Ascending frequencies to predict at, hertz.

    Returns
    -------
    float
        See `crossing_frequency_hz`; 0 where the loop is not stable. Table 3 in Liu 2015 has it for
        sines of five amplitudes.

    """
    frequencies = np.asarray(frequency_hz, dtype=np.float64)
    return _crossing_of_points(predict_operating_points(
        model, trajectory, controller,
        [(trajectory.amplitude_um, frequency) for frequency in frequencies.tolist()],
        harmonics_open=False, compensator=compensator, uncertainty=uncertainty, accuracy=accuracy))


def feedback_table(points: Sequence[OperatingPoint]) -> FeedbackTable:
    """
    Return, for each amplitude of some operating points, the frequency below which feedback helps.

    Predictions end at the highest frequency of the points: where feedback helps at all of them, the
    table has the next number above it.

    Parameters
    ----------
    points : sequence of OperatingPoint
        Several frequencies of each amplitude.

    Returns
    -------
    FeedbackTable
        Amplitudes ascending, micrometres, and the frequencies, hertz.

    """
    rows: dict[float, list[OperatingPoint]] = {}
    for point in sorted(points, key=lambda point: (point.amplitude_um, point.frequency_hz)):
        rows.setdefault(point.amplitude_um, []).append(point)
    return FeedbackTable(tuple(rows), tuple(
        min(_crossing_of_points(row), math.nextafter(row[-1].frequency_hz, math.inf))
        for row in rows.values()))
