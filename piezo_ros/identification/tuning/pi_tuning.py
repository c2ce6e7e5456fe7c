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
The PI gains of least ITAE within limits of robustness, started by the crossover method.

    minimise ITAE = integral of t |e| dt, (9) in Liu 2015
    subject to |W T| < 1, (10),   |S| <= limit,   a stable loop with its delay

or, as ``feedback_band``, maximise the frequency below which |S| < 1 within the same limits, kI/kP
being 0.3 of it (in rad/s) at least: without an integral, drift and slow disturbances would stay.

The limit on |S| holds on the model, on the measured points and on the band of the model, as far as
these are given.

Start: with the gain kU at which the proportional loop oscillates, and its period TU,

    kP = 0.45 kU,   kI = 1.2 kP/TU

Examples
--------
>>> from piezo_ros.model import LinearDynamics
>>> tuning = tune_pi(LinearDynamics(), max_sensitivity=1.5)
>>> tuning.active_limits
('max_sensitivity',)
>>> tuning.objective_after < tuning.objective_before
True

"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.trajectory_blocks import trajectory_blocks
from piezo_ros.control.trajectory_step import TrajectoryParameters
from piezo_ros.identification.tuning.controller_file import controller_file
from piezo_ros.identification.tuning.feedback_table import FeedbackTable
from piezo_ros.identification.tuning.gain_search import GainSearch
from piezo_ros.identification.tuning.itae import itae
from piezo_ros.identification.tuning.linear_plant import Bound, Model
from piezo_ros.identification.tuning.loop_evidence import LoopEvidence
from piezo_ros.identification.tuning.loop_shape import LoopShape, loop_shape
from piezo_ros.identification.tuning.pi_loop import Lead, PiLoop

__all__ = ['OBJECTIVES', 'PiTuning', 'tune_pi']

_FEEDBACK_BAND: Final = 'feedback_band'
OBJECTIVES: Final = ('itae_step', 'itae_scan', _FEEDBACK_BAND)
# The crossover method (Ziegler and Nichols): shares of the ultimate gain and of its period.
_PROPORTIONAL_SHARE: Final = 0.45
_INTEGRAL_PERIODS: Final = 1.0 / 1.2
_SETTLING_TIMES: Final = 15.0  # of the slowest mode, over which a step is weighted
_STEPS_PER_FASTEST: Final = 5.0  # of a continuous loop's fastest pole
_MOST_STEPS: Final = 2**18
_RETREAT: Final = 1.0 - 2e-4
_NEAR: Final = 0.01  # relative distance at which a limit counts as active

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PiTuning:
    """
    Tuned gains, and the loops with them and with those of the start.

    Attributes
    ----------
    objective : str
        ``'itae_step'``, ``'itae_scan'``, ``'feedback_band'`` or the trajectory in words.
    before, after : LoopShape
        The loop with the gains of the start and with the tuned ones.
    objective_before, objective_after : float
        ITAE of both, um s^2 (s^2 for a unit step), infinite for an unstable loop; or one over the
        frequency below which |S| < 1, s, more where kI is too small.
    max_sensitivity, uncertainty_limit : float
        The limits on |S| and |W T|.
    active_limits : tuple of str
        The limits that the tuned gains reach; empty at a free optimum.
    point_sensitivity, band_sensitivity : float or None
        Largest |S| on the measured points and on the band of the model; None without them.

    """

    objective: str
    before: LoopShape
    after: LoopShape
    objective_before: float
    objective_after: float
    max_sensitivity: float
    uncertainty_limit: float
    active_limits: tuple[str, ...]
    point_sensitivity: float | None = None
    band_sensitivity: float | None = None

    @property
    def promised_sensitivity(self) -> float:
        """Largest |S| on the model, the measured points and the band."""
        return max(
            self.after.max_sensitivity, self.point_sensitivity or 0.0,
            self.band_sensitivity or 0.0)

    @property
    def proportional_gain(self) -> float:
        """Tuned kP."""
        return self.after.loop.proportional_gain

    @property
    def integral_gain_per_s(self) -> float:
        """Tuned kI, 1/s."""
        return self.after.loop.integral_gain_per_s

    def to_parameter_yaml(self, *, source: str, table: FeedbackTable | None = None) -> str:
        """
        Return a ROS parameter file for the controller node, margins as comments.

        Parameters
        ----------
        source : str
            Origin of the model, for instance the name of its file.
        table : FeedbackTable, optional
            Where feedback is acceptable, for the scheme auto; by default below |S| = 1, (18) in
            Liu 2015, at every amplitude.

        """
        shape = self.after
        period_s = shape.loop.sample_period_s
        period = 'continuous loop' if period_s is None else f'sample period {period_s:.9g} s'
        weighted = '' if shape.weighted_peak is None else (
            f', ||W T||inf {shape.weighted_peak:.4g} (limit {self.uncertainty_limit:g})')
        return controller_file(shape, [
            *(f'source: {line}' for line in source.splitlines() or ['']),
            (f'objective {self.objective}: {self.objective_after:.4g}, at the start '
             f'{self.objective_before:.4g}; {period}'),
            f'active limits: {", ".join(self.active_limits) or "none"}',
            f'max |S| {shape.max_sensitivity:.4g} (limit {self.max_sensitivity:g}){weighted}',
            *(f'max |S| on the {name} {value:.4g}' for name, value in (
                ('measured points', self.point_sensitivity),
                ('band of the model', self.band_sensitivity)) if value is not None),
        ], table)


def tune_pi(
    model: Model,
    *,
    bound: Bound | None = None,
    objective: str | TrajectoryParameters = 'itae_step',
    max_sensitivity: float = 2.0,
    uncertainty_limit: float = 1.0,
    measurement_delay_samples: int = 1,
    sample_period_s: float | None = 1e-5,
    start: str | tuple[float, float] = 'crossover',
    evidence: LoopEvidence | None = None,
    lead: Lead | None = None,
) -> PiTuning:
    """
    Return the PI gains of least ITAE, (9) in Liu 2015, within the limits of robustness.

    Parameters
    ----------
    model : LinearDynamics, DynamicsFit or control.TransferFunction
        G(s), stable.
    bound : UncertaintyBound, control.TransferFunction or callable, optional
        W(s), (19); without it (10) is not required.
    objective : str or TrajectoryParameters, optional
        ITAE of a unit step of the reference, of the default scan (a triangle of 300 Hz) or of the
        given trajectory, each under feedback alone; or ``'feedback_band'``.
    max_sensitivity : float, optional
        Limit on |S|, above 1; infinite for none.
    uncertainty_limit : float, optional
        Limit on |W T|; (10) says 1.
    measurement_delay_samples : int, optional
        Age of the measurement, as the controller has it.
    sample_period_s : float or None, optional
        Sample period, seconds; None tunes the continuous loop, which has no delay.
    start : str or tuple of float, optional
        ``'crossover'`` for gains from the ultimate gain and its period, or kP and kI to compare
        with.
    evidence : LoopEvidence, optional
        Measured points and the error of the model: the limit on |S| holds for them too.
    lead : Lead, optional
        Lead section before the gains, which start and tuned loop have.

    Returns
    -------
    PiTuning
        The gains and both loops.

    Raises
    ------
    ValueError
        If an argument is out of range, the model is not stable, or no gains are within the limits.

    """
    if not max_sensitivity > 1.0:
        raise ValueError(f'max_sensitivity is {max_sensitivity}, it must be above 1')
    if not uncertainty_limit > 0.0:
        raise ValueError(f'uncertainty_limit is {uncertainty_limit}, it must be above 0')
    delay = measurement_delay_samples if sample_period_s is not None else 0
    loop = PiLoop.of(model, 1.0, 1.0, sample_period_s, delay, lead)
    if not loop.plant.poles_rad_per_s.real.max() < 0.0:
        raise ValueError(
            f'the model has the poles {loop.plant.poles_rad_per_s} rad/s, all must be stable')
    if not loop.plant.dc_gain > 0.0:
        raise ValueError(f'the model has the dc gain {loop.plant.dc_gain}, it must be above 0')
    name, trajectory = _objective(objective)
    crossover_kp, crossover_ki = _crossover_gains(loop)
    start_kp, start_ki = (crossover_kp, crossover_ki) if start == 'crossover' else _pair(start)
    search = GainSearch(loop, bound, max_sensitivity, uncertainty_limit, crossover_kp, evidence)
    evaluate = (
        search.feedback_band_s if name == _FEEDBACK_BAND
        else _evaluator(search, crossover_ki / crossover_kp, trajectory, sample_period_s))

    def shape(proportional_gain: float, integral_gain_per_s: float) -> LoopShape:
        return loop_shape(
            loop.plant, proportional_gain, integral_gain_per_s, sample_period_s=sample_period_s,
            measurement_delay_samples=delay, bound=bound, lead=lead)

    before = shape(start_kp, start_ki)
    tuned_kp, tuned_ki = search.best(crossover_ki / crossover_kp, evaluate)
    after = shape(tuned_kp, tuned_ki)
    # The search uses a grid of frequencies; a peak between two of them may be a bit higher.
    while (max(after.max_sensitivity, *_on_evidence(after.loop, evidence)) > max_sensitivity
           or (after.weighted_peak or 0.0) >= uncertainty_limit):
        tuned_kp, tuned_ki = tuned_kp * _RETREAT, tuned_ki * _RETREAT
        after = shape(tuned_kp, tuned_ki)
    points, band = (
        (None, None) if evidence is None
        else (evidence.largest_on_points(after.loop), evidence.largest_on_band(after.loop)))
    return PiTuning(
        objective=name, before=before, after=after,
        objective_before=evaluate(before.loop), objective_after=evaluate(after.loop),
        max_sensitivity=max_sensitivity, uncertainty_limit=uncertainty_limit,
        active_limits=tuple(
            limit for limit, value, most in (
                ('max_sensitivity', max(after.max_sensitivity, points or 0.0, band or 0.0),
                 max_sensitivity),
                ('uncertainty_limit', after.weighted_peak or 0.0, uncertainty_limit))
            if value > most * (1.0 - _NEAR)),
        point_sensitivity=points, band_sensitivity=band)


def _on_evidence(loop: PiLoop, evidence: LoopEvidence | None) -> tuple[float, float]:
    """Return the largest |S| on points and band, 0 for what is not known."""
    if evidence is None:
        return 0.0, 0.0
    return evidence.largest_on_points(loop) or 0.0, evidence.largest_on_band(loop) or 0.0


def _objective(objective: str | TrajectoryParameters) -> tuple[str, TrajectoryParameters | None]:
    if isinstance(objective, str):
        if objective not in OBJECTIVES:
            raise ValueError(
                f'objective is {objective!r}, allowed are {", ".join(OBJECTIVES)} and a trajectory')
        return objective, TrajectoryParameters() if objective == 'itae_scan' else None
    words = (
        f'ITAE of {objective.periods:g} periods of {objective.waveform}, '
        f'{objective.amplitude_um:g} um, {objective.frequency_hz:g} Hz')
    return words, objective


def _pair(start: str | tuple[float, float]) -> tuple[float, float]:
    if isinstance(start, str) or len(start) != 2:
        raise ValueError(f"start is {start!r}, it must be 'crossover' or kP and kI")
    return float(start[0]), float(start[1])


def _crossover_gains(loop: PiLoop) -> tuple[float, float]:
    """Return gains from the gain at which the proportional loop oscillates, and its period."""
    shape = loop_shape(
        loop.plant, 1.0, 0.0, sample_period_s=loop.sample_period_s,
        measurement_delay_samples=loop.measurement_delay_samples, lead=loop.lead)
    frequency_hz = shape.frequency_hz
    response = shape.loop.loop(frequency_hz)
    reversed_phase = (response.imag[:-1] < 0.0) & (response.imag[1:] >= 0.0) & (
        response.real[1:] < 0.0)
    # If the phase never reaches -180 degrees, the highest frequency of the grid is used.
    candidates = np.append(np.flatnonzero(reversed_phase), frequency_hz.size - 1)
    ultimate = candidates[np.argmax(np.abs(response[candidates]))]
    proportional = _PROPORTIONAL_SHARE / float(np.abs(response[ultimate]))
    return proportional, proportional * float(frequency_hz[ultimate]) / _INTEGRAL_PERIODS


def _evaluator(
    search: GainSearch, ratio_per_s: float, trajectory: TrajectoryParameters | None,
    sample_period_s: float | None,
) -> Callable[[PiLoop], float]:
    """Return the objective as a function of the loop, with one grid of time for all gains."""
    poles = search.loop.plant.poles_rad_per_s
    step_s = sample_period_s or 1.0 / (_STEPS_PER_FASTEST * float(np.abs(poles).max()))
    if trajectory is not None:
        sampled = trajectory.replaced(sample_period_s=step_s)
        if sampled.samples > _MOST_STEPS:
            raise ValueError(
                f'the trajectory has {sampled.samples} samples of {step_s:g} s, at most '
                f'{_MOST_STEPS} can be weighted')
        reference_um = np.array(trajectory_blocks(sampled)(0, sampled.samples)[0])
        return lambda loop: itae(loop, reference_um, step_s, reference_um.size)
    gain = 0.5 * search.largest(ratio_per_s)
    if gain == 0.0:
        raise ValueError(search.refusal())
    decay = search.loop.with_gains(gain, gain * ratio_per_s).slowest_decay(step_s)
    steps = min(math.ceil(_SETTLING_TIMES / -math.log(decay)) + 1, _MOST_STEPS)
    return lambda loop: itae(loop, None, step_s, steps)
