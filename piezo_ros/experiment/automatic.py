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
Runs that leave the scheme or the number of harmonics to a prediction.

It is made before anything starts, of what is known of the rig: identified hysteresis and dynamics
and the amplifier's data sheet. What the simulated rig has beyond that, its mismatches, is its
secret and never looked at.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.model import (
    DynamicsParameters,
    HysteresisParameters,
    ParameterError,
    RigParameters,
)

if TYPE_CHECKING:  # the mathematics is imported only where a run asks for it
    from piezo_ros.identification import HarmonicsChoice
    from piezo_ros.identification.tuning.linear_plant import Bound

__all__ = ['AUTO', 'KNOWN_STAGES', 'Prediction', 'known_rig', 'predict']

AUTO: Final = 'auto'
KNOWN_STAGES: Final = ('compensator', 'plant', 'trajectory')
_PERIODIC: Final = ('triangle', 'sine')
# What a data sheet tells of a rig. All else is a model's or the rig's secret, and no parameter
# that the rig may be given one day becomes known by itself.
_DATA_SHEET: Final = (
    'slew_limit_v_per_s', 'operating_point_v', 'operating_point_um', 'travel_um',
    'voltage_minimum_v', 'voltage_maximum_v', 'dac_bits', 'dac_span_v', 'adc_bits', 'adc_span_v',
    'sensor_scale_um_per_v', 'noise_rms_um')


@dataclass(frozen=True)
class Prediction:
    """
    What was decided for a run, and the errors it was decided by.

    Attributes
    ----------
    scheme : str
        The scheme of the run, chosen or given.
    harmonics : int
        Its highest harmonic m, chosen or given.
    by_scheme : mapping of str to float
        Predicted NRMSE, percent of the peak-to-peak reference, of each scheme that was considered,
        with the number of harmonics that suits it best where that was left open too.
    by_harmonics : mapping of int to float
        Predicted NRMSE of each m that was considered, under the scheme of the run.
    reason : str
        One sentence or two for people.

    """

    scheme: str
    harmonics: int
    by_scheme: Mapping[str, float]
    by_harmonics: Mapping[int, float]
    reason: str

    @property
    def nrmse_percent(self) -> float:
        """Predicted NRMSE of the run, percent of the peak-to-peak reference."""
        return self.by_scheme[self.scheme]

    def record(self) -> dict[str, Any]:
        """Return everything as JSON has it."""
        return {
            'scheme': self.scheme,
            'harmonics': self.harmonics,
            'nrmse_percent': self.nrmse_percent,
            'by_scheme': dict(self.by_scheme),
            'by_harmonics': {str(m): percent for m, percent in self.by_harmonics.items()},
            'reason': self.reason,
        }


def known_rig(
    told: Mapping[str, Mapping[str, Any]],
    plant: RigParameters,
    compensator: HysteresisParameters,
    trajectory: DynamicsParameters,
) -> RigParameters:
    """
    Return what is known of the rig of a run.

    Parameters
    ----------
    told : mapping of str to mapping
        One of `KNOWN_STAGES` to parameters that are better known than those of the run; others
        than data sheet, hysteresis and dynamics are left aside.
    plant : RigParameters
        The plant of the run; only its data sheet is read.
    compensator : HysteresisParameters
        The hysteresis that the run inverts.
    trajectory : DynamicsParameters
        The dynamics that its feedforward inverts.

    Returns
    -------
    RigParameters
        A rig without mismatches, in physical order: a lumped one would promise of high harmonics
        what the hysteresis before the mechanics does not keep.

    Raises
    ------
    ParameterError
        If what is told and the run's own do not go together.

    """
    values = {name: getattr(plant, name) for name in _DATA_SHEET}
    for parameter_set, own, stage in (
        (HysteresisParameters, compensator, 'compensator'),
        (DynamicsParameters, trajectory, 'trajectory'),
    ):
        names = parameter_set.names()
        values.update({name: getattr(own, name) for name in names})
        values.update(_chosen(told, stage, names))
    values.update(_chosen(told, 'plant', _DATA_SHEET))
    return RigParameters.from_mapping({**values, 'order': 'physical'})


def _chosen(
    told: Mapping[str, Mapping[str, Any]], stage: str, names: Collection[str],
) -> dict[str, Any]:
    return {name: value for name, value in told.get(stage, {}).items() if name in names}


@dataclass(frozen=True)
class _Run:
    """A run as far as a prediction needs it."""

    known: RigParameters
    compensator: HysteresisParameters
    controller: ControllerParameters
    trajectory: TrajectoryParameters
    bound: 'Bound | None'
    score_periods: float

    def choose_harmonics(self, scheme: str) -> 'HarmonicsChoice':
        """Return the number of harmonics for a scheme."""
        from piezo_ros.identification.prediction.harmonics import choose_harmonics
        return choose_harmonics(
            self.known, self.trajectory, self.controller.replaced(scheme=scheme),
            compensator=self.compensator, uncertainty=self.bound,
            score_periods=self.score_periods)


def predict(
    known: RigParameters,
    compensator: HysteresisParameters,
    controller: ControllerParameters,
    trajectory: TrajectoryParameters,
    open_: Collection[str],
    *,
    bound: 'Bound | None' = None,
    score_periods: float = 4.0,
) -> Prediction:
    """
    Decide what a run leaves open.

    Parameters
    ----------
    known : RigParameters
        What is known of the rig, see `known_rig`.
    compensator : HysteresisParameters
        The hysteresis that the run inverts.
    controller : ControllerParameters
        Gains; and the scheme, with feedforward, unless that is open.
    trajectory : TrajectoryParameters
        The scan; and the harmonics, unless they are open.
    open_ : collection of str
        What is to be decided: ``'scheme'``, ``'harmonics'`` or both.
    bound : UncertaintyBound, control.TransferFunction or callable, optional
        W(s), the uncertainty of the known dynamics.
    score_periods : float, optional
        Periods at the end of the run that will be scored.

    Returns
    -------
    Prediction
        The decision and its grounds.

    Raises
    ------
    ParameterError
        If the waveform is no periodic one, or the scheme has no feedforward.
    ValueError
        If the run is shorter than what is scored, or has no gains.

    """
    if trajectory.waveform not in _PERIODIC:
        raise ParameterError(
            f'waveform is {trajectory.waveform!r}; what a run leaves to auto can be predicted for '
            f'{", ".join(_PERIODIC)}')
    run = _Run(known, compensator, controller, trajectory, bound, score_periods)
    if 'scheme' in open_:
        return _predict_scheme(run, harmonics_open='harmonics' in open_)
    choice = run.choose_harmonics(controller.scheme)
    return Prediction(
        controller.scheme, choice.harmonics, {controller.scheme: choice.chosen.nrmse_percent},
        choice.predicted_nrmse_percent, _why_harmonics(choice))


def _predict_scheme(run: _Run, *, harmonics_open: bool) -> Prediction:
    from piezo_ros.identification.prediction.operating_points import predict_operating_point
    point = predict_operating_point(
        run.known, run.trajectory, run.controller, harmonics_open=harmonics_open,
        compensator=run.compensator, uncertainty=run.bound, score_periods=run.score_periods)
    by_scheme = dict(point.predicted_nrmse_percent)
    scheme = point.scheme
    listed = ', '.join(f'{name} {percent:.3g} %' for name, percent in by_scheme.items())
    acceptable_hz = point.loop.feedback_acceptable_frequency_hz
    reason = f'{scheme} is predicted to err least: {listed}; ' + (
        f'|S| = 1 at {acceptable_hz:.4g} Hz' if point.loop.stable
        else 'the loop is not stable')
    if scheme in point.choices:
        choice = point.choices[scheme]
        return Prediction(
            scheme, choice.harmonics, by_scheme, choice.predicted_nrmse_percent,
            f'{reason}. {_why_harmonics(choice)}')
    # Without feedforward there is nothing that harmonics could do.
    harmonics = point.harmonics[scheme] if harmonics_open else run.trajectory.harmonics
    return Prediction(scheme, harmonics, by_scheme, {harmonics: by_scheme[scheme]}, reason)


def _why_harmonics(choice: 'HarmonicsChoice') -> str:
    errors = choice.predicted_nrmse_percent
    text = (
        f'm = {choice.harmonics}: {choice.chosen.nrmse_percent:.3g} %, the fewest of '
        f'{min(errors)} … {max(errors)} within 1 % of the least predicted error')
    limited = [one.harmonics for one in choice.predictions if one.simulated.is_limited]
    return text + (f'; the amplifier is at its limits from m = {limited[0]} on' if limited else '')
