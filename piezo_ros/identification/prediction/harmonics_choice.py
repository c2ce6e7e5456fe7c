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
The number m of harmonics of the feedforward (13) in Liu 2015, by the predicted errors.

    m = min {m odd: NRMSE(m) <= 1.01 min over m of NRMSE(m)}

It is left to trial in the paper: each further harmonic lessens the truncation, but adds uncertainty
at its frequency and demands more of the amplifier.
"""

import math
from dataclasses import dataclass
from typing import Final

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.identification.prediction.accuracy import ModelAccuracy
from piezo_ros.identification.prediction.tracking import TrackingPrediction, predict_tracking
from piezo_ros.identification.tuning.linear_plant import Bound, Model
from piezo_ros.model import HysteresisParameters, ParameterError, RigParameters

__all__ = ['HarmonicsChoice', 'choose_harmonics']

_HIGHEST_HARMONIC: Final = 41
_GOOD_ENOUGH: Final = 0.01  # relative, above the least error, for fewer harmonics


@dataclass(frozen=True)
class HarmonicsChoice:
    """
    The chosen number of harmonics and the alternatives, under one scheme.

    Attributes
    ----------
    harmonics : int
        The fewest within 1 % of the least predicted error.
    predictions : tuple of TrackingPrediction
        One for each m that was tried, ascending.

    """

    harmonics: int
    predictions: tuple[TrackingPrediction, ...]

    @property
    def predicted_nrmse_percent(self) -> dict[int, float]:
        """Expected NRMSE for each m, percent of the peak-to-peak reference."""
        return {one.harmonics: one.nrmse_percent for one in self.predictions}

    @property
    def chosen(self) -> TrackingPrediction:
        """The prediction for the chosen number."""
        return next(one for one in self.predictions if one.harmonics == self.harmonics)

    @property
    def reason(self) -> str:
        """Why this number, in one sentence."""
        errors = self.predicted_nrmse_percent
        text = (
            f'm = {self.harmonics}: {self.chosen.nrmse_percent:.3g} %, the fewest of '
            f'{min(errors)} … {max(errors)} within 1 % of the least predicted error')
        limited = [one.harmonics for one in self.predictions if one.is_limited]
        return text + (
            f'; the amplifier is at its limits from m = {limited[0]} on' if limited else '')


def choose_harmonics(
    model: Model | RigParameters,
    trajectory: TrajectoryParameters,
    controller: ControllerParameters,
    *,
    compensator: HysteresisParameters | None = None,
    uncertainty: Bound | None = None,
    accuracy: ModelAccuracy | None = None,
    highest: int = _HIGHEST_HARMONIC,
    score_periods: float = 4.0,
) -> HarmonicsChoice:
    """
    Return how many harmonics the feedforward should have.

    Parameters
    ----------
    model, compensator, uncertainty, accuracy, score_periods
        As for `predict_tracking`.
    trajectory : TrajectoryParameters
        The scan, a waveform that repeats, with the dynamics that the feedforward inverts; its own
        ``harmonics`` does not matter.
    controller : ControllerParameters
        Gains and scheme, ``'ff'`` or ``'fbff'``.
    highest : int, optional
        Highest harmonic that is tried, as far as it is below the Nyquist frequency.

    Returns
    -------
    HarmonicsChoice
        The choice, and the predicted error of every m that was tried.

    Raises
    ------
    ParameterError
        If the scheme has no feedforward, or the waveform no Fourier series.
    ValueError
        If ``highest`` is below 1, or the run has fewer periods than are scored.

    """
    if not controller.uses_feedforward:
        raise ParameterError(
            f'scheme is {controller.scheme!r}, which has no feedforward; allowed are ff, fbff')
    if highest < 1:
        raise ValueError(f'highest is {highest}, it must be 1 at least')
    predictions: list[TrackingPrediction] = []
    for harmonics in _numbers_of_harmonics(trajectory, highest):
        try:
            scan = trajectory.replaced(harmonics=harmonics)
        except ParameterError:  # the model has no gain at its highest harmonic
            break
        predictions.append(predict_tracking(
            model, scan, controller, compensator=compensator, uncertainty=uncertainty,
            score_periods=score_periods, accuracy=accuracy, every_place=False))
    if not predictions:
        trajectory.replaced(harmonics=1)  # says why
    enough = min(one.nrmse_percent for one in predictions) * (1.0 + _GOOD_ENOUGH)
    best = next(one for one in predictions if one.nrmse_percent <= enough)
    if isinstance(model, RigParameters) and model.hysteresis_place != 'known':
        predictions[predictions.index(best)] = best = predict_tracking(
            model, trajectory.replaced(harmonics=best.harmonics), controller,
            compensator=compensator, uncertainty=uncertainty, score_periods=score_periods,
            accuracy=accuracy)
    return HarmonicsChoice(best.harmonics, tuple(predictions))


def _numbers_of_harmonics(trajectory: TrajectoryParameters, highest: int) -> tuple[int, ...]:
    """Return the odd numbers of harmonics that waveform and sampling allow; 0 for a staircase."""
    if trajectory.waveform in ('sine', 'lissajous'):
        return (1,)
    nyquist = 0.5 / (trajectory.fundamental_hz * trajectory.sample_period_s)
    numbers = range(1, min(highest, math.ceil(nyquist) - 1) + 1, 2)
    # So few harmonics make a triangle of most staircases: without any it may be followed better.
    return (0, *numbers) if trajectory.waveform == 'staircase' else tuple(numbers)
