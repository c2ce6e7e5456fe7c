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
Which scheme to use at an operating point: the feedback-acceptable condition, (18) in Liu 2015.

Where |S| < 1 feedback lessens the error that the feedforward leaves, E_fbff = E_ff S, (14), (15);
above it feedforward alone is better. A scan has many frequencies: its harmonics decide together.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.identification.prediction.tracking import (
    SimulatedTracking,
    SpectralTracking,
    simulated_tracking,
    spectral_tracking,
)
from piezo_ros.identification.tuning.linear_plant import Bound, Model
from piezo_ros.identification.tuning.loop_shape import LoopShape, loop_shape
from piezo_ros.model import HysteresisParameters, LinearDynamics, RigParameters

__all__ = [
    'CANDIDATES',
    'SchemeChoice',
    'SchemePrediction',
    'crossing_frequency_hz',
    'equal_error_frequency_hz',
    'recommend_scheme',
]

CANDIDATES: Final = ('ff', 'fbff', 'fb')


@dataclass(frozen=True)
class SchemePrediction:
    """
    What to expect of one scheme.

    Attributes
    ----------
    spectral : SpectralTracking
        The errors harmonic by harmonic, (14) and (15) in Liu 2015.
    simulated : SimulatedTracking or None
        The run on the known rig; None without one.

    """

    spectral: SpectralTracking
    simulated: SimulatedTracking | None

    @property
    def nrmse_percent(self) -> float:
        """Expected NRMSE, percent of the peak-to-peak reference."""
        if self.simulated is None:
            return self.spectral.nrmse_percent
        return math.hypot(self.simulated.nrmse_percent, self.spectral.uncertainty_percent)


@dataclass(frozen=True)
class SchemeChoice:
    """
    The recommended scheme and what it rests on.

    Attributes
    ----------
    scheme : str
        ``'ff'``, ``'fbff'`` or ``'fb'``: the one of least predicted error.
    predictions : mapping of str to SchemePrediction
        Every candidate.
    loop : LoopShape
        The feedback loop.

    """

    scheme: str
    predictions: Mapping[str, SchemePrediction]
    loop: LoopShape

    @property
    def predicted_nrmse_percent(self) -> dict[str, float]:
        """Expected NRMSE of every candidate, percent of the peak-to-peak reference."""
        return {name: one.nrmse_percent for name, one in self.predictions.items()}

    @property
    def feedback_acceptable_frequency_hz(self) -> float:
        """Where |S| = 1: the highest frequency of a sine at which feedback helps, (18)."""
        return self.loop.feedback_acceptable_frequency_hz


def recommend_scheme(
    model: Model | RigParameters,
    trajectory: TrajectoryParameters,
    controller: ControllerParameters,
    *,
    compensator: HysteresisParameters | None = None,
    uncertainty: Bound | None = None,
    score_periods: float = 4.0,
) -> SchemeChoice:
    """
    Return the scheme that is predicted to track best.

    Parameters
    ----------
    model : LinearDynamics, DynamicsFit, control.TransferFunction or RigParameters
        What is known best of the compensated actuator. A rig (identified dynamics and hysteresis,
        the amplifier's slew limit and rails) is simulated too, which shows where the amplifier
        cannot follow.
    trajectory : TrajectoryParameters
        The operating point: waveform, amplitude, frequency; and the feedforward.
    controller : ControllerParameters
        The gains; its own scheme does not matter.
    compensator : HysteresisParameters, optional
        The hysteresis that is inverted; that of the rig by default.
    uncertainty : UncertaintyBound, control.TransferFunction or callable, optional
        W(s), or a measured |Delta| as a function of the frequency in hertz.
    score_periods : float, optional
        Periods at the end of the simulated runs that are scored.

    Returns
    -------
    SchemeChoice
        The scheme and the predicted errors. An unstable loop is never recommended.

    Raises
    ------
    ParameterError
        If the waveform has no Fourier series.
    ValueError
        If both gains are 0, or the run is shorter than what is scored.

    """
    rig: RigParameters | None = None
    linear: Model
    if isinstance(model, RigParameters):
        rig, linear = model, LinearDynamics(model.true_dynamics)
    else:
        linear = model
    shape = loop_shape(
        linear, controller.proportional_gain, controller.integral_gain_per_s,
        sample_period_s=trajectory.sample_period_s,
        measurement_delay_samples=controller.measurement_delay_samples)
    predictions = {}
    for scheme in CANDIDATES if shape.stable else ('ff',):
        law = controller.replaced(scheme=scheme)
        predictions[scheme] = SchemePrediction(
            spectral_tracking(linear, trajectory, law, uncertainty=uncertainty),
            None if rig is None else simulated_tracking(
                rig, trajectory, law, compensator=compensator, score_periods=score_periods))
    return SchemeChoice(
        min(predictions, key=lambda name: predictions[name].nrmse_percent), predictions, shape)


def equal_error_frequency_hz(
    model: Model | RigParameters,
    trajectory: TrajectoryParameters,
    controller: ControllerParameters,
    frequency_hz: ArrayLike,
    *,
    compensator: HysteresisParameters | None = None,
    uncertainty: Bound | None = None,
) -> float:
    """
    Return the frequency of the scan at which FF and FBFF are predicted to do equally well.

    Parameters
    ----------
    model, controller, compensator, uncertainty
        As for `recommend_scheme`.
    trajectory : TrajectoryParameters
        Waveform and amplitude; its own frequency does not matter.
    frequency_hz : array_like, shape (N,)
        Frequencies to look at, ascending, hertz.

    Returns
    -------
    float
        See `crossing_frequency_hz`; 0 where the loop is not stable. Table 3 in Liu 2015 has it for
        sines of five amplitudes.

    """
    frequencies = np.asarray(frequency_hz, dtype=np.float64)
    predicted = [
        recommend_scheme(
            model, trajectory.replaced(frequency_hz=frequency), controller,
            compensator=compensator, uncertainty=uncertainty).predicted_nrmse_percent
        for frequency in frequencies.tolist()]
    if not all('fbff' in errors for errors in predicted):
        return 0.0
    return crossing_frequency_hz(
        frequencies, [errors['ff'] for errors in predicted],
        [errors['fbff'] for errors in predicted])


def crossing_frequency_hz(
    frequency_hz: ArrayLike, ff_error: ArrayLike, fbff_error: ArrayLike,
) -> float:
    """
    Return the frequency that best divides where feedback helps from where it does harm.

    Parameters
    ----------
    frequency_hz : array_like, shape (N,)
        Ascending frequencies, hertz.
    ff_error, fbff_error : array_like, shape (N,)
        Errors under both schemes there, above 0.

    Returns
    -------
    float
        Interpolated where the ratio of the errors rises through 1; infinite where feedback helps up
        to the highest frequency, 0 where it is better done without. Of several crossings the one
        that costs the least error (geometric mean over the frequencies) with feedback below and
        none above; the lowest of equals.

    """
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    excess = np.log(np.asarray(fbff_error) / np.asarray(ff_error))
    # With feedback at the first k frequencies the error is that of FF and the first k excesses.
    with_feedback = int(np.argmin(np.concatenate([[0.0], np.cumsum(excess)])))
    if with_feedback == 0:
        return 0.0
    if with_feedback == frequency.size:
        return math.inf
    last = with_feedback - 1
    share = -excess[last] / (excess[last + 1] - excess[last])
    return float(frequency[last] + share * (frequency[last + 1] - frequency[last]))
