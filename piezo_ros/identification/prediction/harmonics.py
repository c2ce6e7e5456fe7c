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
The number of harmonics of the feedforward (13), which Liu 2015 leaves to trial.

Each harmonic that is added lessens the truncation, adds what the model does not know at its
frequency, and asks more of the amplifier. The first two come from the spectra, the last from a
simulated run; they add up as powers.
"""

import math
from dataclasses import dataclass
from typing import Final

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.identification.prediction.tracking import (
    SimulatedTracking,
    SpectralTracking,
    simulated_tracking,
    spectral_tracking,
)
from piezo_ros.identification.tuning.linear_plant import Bound
from piezo_ros.model import HysteresisParameters, LinearDynamics, ParameterError, RigParameters

__all__ = ['HarmonicsChoice', 'HarmonicsPrediction', 'choose_harmonics']

HIGHEST_HARMONIC: Final = 41
_GOOD_ENOUGH: Final = 0.01  # relative, above the least error, for fewer harmonics


@dataclass(frozen=True)
class HarmonicsPrediction:
    """
    What to expect of one number of harmonics.

    Attributes
    ----------
    spectral : SpectralTracking
        The linear prediction, with truncation and uncertainty apart.
    simulated : SimulatedTracking
        The run on the known rig, with the amplifier's limits and without uncertainty.

    """

    spectral: SpectralTracking
    simulated: SimulatedTracking

    @property
    def harmonics(self) -> int:
        """Highest harmonic m."""
        return self.spectral.harmonics

    @property
    def nrmse_percent(self) -> float:
        """Expected NRMSE: the simulated run, and the uncertainty of the model beside it."""
        return math.hypot(self.simulated.nrmse_percent, self.spectral.uncertainty_percent)

    def record(self) -> dict[str, float | bool]:
        """Return every number under its name, for report.json and tables."""
        return {
            'harmonics': self.harmonics,
            'nrmse_percent': self.nrmse_percent,
            'linear_nrmse_percent': self.spectral.nrmse_percent,
            'simulated_nrmse_percent': self.simulated.nrmse_percent,
            'truncation_percent': self.spectral.truncation_percent,
            'uncertainty_percent': self.spectral.uncertainty_percent,
            'slew_v_per_s': self.simulated.slew_v_per_s,
            'slew_limited': self.simulated.slew_limited,
            'rail_limited': self.simulated.rail_limited,
        }


@dataclass(frozen=True)
class HarmonicsChoice:
    """
    The chosen number of harmonics and the alternatives.

    Attributes
    ----------
    harmonics : int
        The fewest within 1 % of the least predicted error.
    predictions : tuple of HarmonicsPrediction
        One for each m that was tried, ascending.

    """

    harmonics: int
    predictions: tuple[HarmonicsPrediction, ...]

    @property
    def predicted_nrmse_percent(self) -> dict[int, float]:
        """Expected NRMSE for each m, percent of the peak-to-peak reference."""
        return {one.harmonics: one.nrmse_percent for one in self.predictions}

    @property
    def chosen(self) -> HarmonicsPrediction:
        """What to expect of the chosen number."""
        return next(one for one in self.predictions if one.harmonics == self.harmonics)


def choose_harmonics(
    rig: RigParameters,
    trajectory: TrajectoryParameters,
    controller: ControllerParameters,
    *,
    compensator: HysteresisParameters | None = None,
    uncertainty: Bound | None = None,
    highest: int = HIGHEST_HARMONIC,
    score_periods: float = 4.0,
) -> HarmonicsChoice:
    """
    Return how many harmonics the feedforward should have.

    Parameters
    ----------
    rig : RigParameters
        What is known of the rig, not its secrets: identified dynamics and hysteresis, the
        amplifier's slew limit and rails. Its order should be the physical one: a lumped rig
        promises of high harmonics what the hysteresis before the mechanics does not keep.
    trajectory : TrajectoryParameters
        The scan, a triangle or a sine, with the dynamics that the feedforward inverts; its own
        ``harmonics`` does not matter.
    controller : ControllerParameters
        Gains and scheme, ``'ff'`` or ``'fbff'``.
    compensator : HysteresisParameters, optional
        The hysteresis that is inverted; that of ``rig`` by default.
    uncertainty : UncertaintyBound, control.TransferFunction or callable, optional
        W(s), or a measured |Delta| as a function of the frequency in hertz.
    highest : int, optional
        Highest harmonic that is tried, as far as it is below the Nyquist frequency.
    score_periods : float, optional
        Periods at the end of the simulated runs that are scored.

    Returns
    -------
    HarmonicsChoice
        The choice, and the predicted error of every odd m.

    Raises
    ------
    ParameterError
        If the scheme has no feedforward, or the waveform no Fourier series.
    ValueError
        If ``highest`` is below 1, or the run is shorter than what is scored.

    """
    if not controller.uses_feedforward:
        raise ParameterError(
            f'scheme is {controller.scheme!r}, which has no feedforward; allowed are ff, fbff')
    if highest < 1:
        raise ValueError(f'highest is {highest}, it must be 1 at least')
    model = LinearDynamics(rig.true_dynamics)
    predictions = []
    for harmonics in _candidates(trajectory, highest):
        run = trajectory.replaced(harmonics=harmonics)
        predictions.append(HarmonicsPrediction(
            spectral_tracking(model, run, controller, uncertainty=uncertainty),
            simulated_tracking(
                rig, run, controller, compensator=compensator, score_periods=score_periods)))
    enough = min(one.nrmse_percent for one in predictions) * (1.0 + _GOOD_ENOUGH)
    return HarmonicsChoice(
        next(one.harmonics for one in predictions if one.nrmse_percent <= enough),
        tuple(predictions))


def _candidates(trajectory: TrajectoryParameters, highest: int) -> range:
    """Return the odd numbers of harmonics that waveform and sampling allow."""
    if trajectory.waveform == 'sine':
        return range(1, 2)
    nyquist = 0.5 / (trajectory.frequency_hz * trajectory.sample_period_s)
    return range(1, min(highest, math.ceil(nyquist) - 1) + 1, 2)
