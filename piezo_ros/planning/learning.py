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
Learning of a planned scan from runs of the true stage.

After each run the error e of its period average moves the coefficients of the voltage by a step of
the model,

    c <- c + mu d,   d = argmin mean of w (e - J d)^2 + lambda |d|^2 within the limits,

J being the slope of the model at these coefficients; beside feedback S J, which takes its part of
every change. The best run is kept. A run that does not pay is judged only after the best one has
been measured again: of a stage that drifts, an old best misleads. mu is halved where the error
rises, and after two runs that do not pay learning ends.
"""

import math
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.planning.aligned_feedback import filtered
from piezo_ros.planning.constrained_step import constrained_step
from piezo_ros.planning.periodic_plan import (
    PeriodicPlan,
    regularisation_of,
    weighted_rms_um,
)
from piezo_ros.planning.periodic_stage import PeriodicStage

__all__ = ['Learner', 'Measured', 'period_average']

_PAYS: Final = 0.02  # relative fall of the error that is worth a run
_RISES: Final = 0.05  # relative rise of the error from which a step is too long
_SIGMAS: Final = 2.0  # of the noise, by which a difference must be above it
_UNPAID: Final = 2  # runs that do not pay, after which learning ends


class Measured(NamedTuple):
    """
    The error of a run, of its period average.

    Attributes
    ----------
    error_um : ndarray, shape (P,)
        Reference less average displacement.
    rms_um : float
        Its weighted root mean square.
    sigma_um : float
        Standard deviation of that, from the differences between the periods.

    """

    error_um: NDArray[np.float64]
    rms_um: float
    sigma_um: float


def period_average(
    displacement_um: NDArray[np.float64], reference_um: NDArray[np.float64],
    weight: NDArray[np.float64], repetitions: int,
) -> Measured:
    """
    Return the error of the last repetitions of a run, averaged over them.

    Parameters
    ----------
    displacement_um : ndarray, shape (N,)
        Readings; the sample k of the run belongs to the sample k modulo P of the reference.
    reference_um : ndarray, shape (P,)
        One repetition of the reference.
    weight : ndarray, shape (P,)
        Weight of each sample's squared error.
    repetitions : int
        How many of the last whole repetitions are averaged.

    Raises
    ------
    ValueError
        If the run is too short, or a reading is not finite.

    """
    samples = reference_um.size
    whole = displacement_um.size // samples
    if not 1 <= repetitions <= whole:
        raise ValueError(
            f'repetitions is {repetitions}, allowed is 1 … {whole} (a run of '
            f'{displacement_um.size} samples, {samples} for each)')
    stacked = displacement_um[(whole - repetitions) * samples:whole * samples].reshape(
        repetitions, samples)
    if not np.isfinite(stacked).all():
        place = int(np.argmin(np.isfinite(displacement_um)))
        raise ValueError(f'displacement_um is {displacement_um[place]} at sample {place}')
    error_um = reference_um - stacked.mean(axis=0)
    rms_um = weighted_rms_um(error_um, weight)
    if repetitions == 1:
        return Measured(error_um, rms_um, 0.0)
    # The noise of an average sample; its share of the squared error scatters by sqrt(2/P), and
    # moves the error along itself by its own size over sqrt(P).
    noise_um = math.sqrt(
        float(np.mean(weight * stacked.var(axis=0, ddof=1))) / repetitions)
    spread_um2 = math.hypot(
        noise_um**2 * math.sqrt(2.0 / samples), 2.0 * rms_um * noise_um / math.sqrt(samples))
    return Measured(error_um, rms_um, spread_um2 / (2.0 * max(rms_um, 1e-300)))


class _Tried(NamedTuple):
    coefficients_v: NDArray[np.float64]
    measured: Measured


@dataclass
class Learner:
    """
    The state of a learning: what to run next, the best so far, whether it is over.

    Parameters
    ----------
    stage : PeriodicStage
        The identified stage.
    plan : PeriodicPlan
        Where it begins.
    sensitivity : ndarray of complex, shape (P//2 + 1,), optional
        S at the harmonics, of feedback that takes its part of every change of the voltage.

    Attributes
    ----------
    step : float
        The share mu of a step of the model.
    runs : int
        Runs that were told.
    is_done : bool
        Whether no further run pays.

    """

    stage: PeriodicStage
    plan: PeriodicPlan
    sensitivity: NDArray[np.complex128] | None = None
    step: float = 1.0
    runs: int = 0
    is_done: bool = False
    _best: _Tried | None = None
    _doubted: _Tried | None = None
    _unpaid: int = 0
    _next: Literal['begin', 'try', 'measure the best again'] = 'begin'
    _proposed_v: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    @property
    def best(self) -> PeriodicPlan:
        """The plan with the best coefficients so far."""
        if self._best is None:
            return self.plan
        return self.plan.with_coefficients(self._best.coefficients_v, self.stage)

    @property
    def best_rms_um(self) -> float:
        """Weighted error of the best run, as it was measured last; infinite before any run."""
        return math.inf if self._best is None else self._best.measured.rms_um

    def propose(self) -> PeriodicPlan:
        """
        Return the plan to run next.

        Raises
        ------
        InfeasibleError
            If no voltage keeps the limits.

        """
        if self._best is None:
            self._proposed_v = self.plan.coefficients_v
        elif self._next == 'measure the best again':
            self._proposed_v = self._best.coefficients_v
        else:
            self._proposed_v = self._best.coefficients_v + self.step * self._model_step(self._best)
        return self.plan.with_coefficients(self._proposed_v, self.stage)

    def _model_step(self, tried: _Tried) -> NDArray[np.float64]:
        plan = self.plan
        basis = plan.basis(plan.reference_um.size)
        slope = self.stage.linearise(basis @ tried.coefficients_v, basis).slope
        if self.sensitivity is not None:
            slope = filtered(self.sensitivity, slope)
        return constrained_step(
            slope, tried.measured.error_um, plan.weight, regularisation_of(slope), basis,
            tried.coefficients_v, plan.limits, plan.sample_period_s)

    def tell(self, measured: Measured) -> None:
        """
        Take the error of the run that was proposed last.

        Parameters
        ----------
        measured : Measured
            Of `period_average`.

        """
        self.runs += 1
        tried = _Tried(self._proposed_v, measured)
        if self._best is None:
            self._best, self._next = tried, 'try'
        elif self._next == 'measure the best again':
            assert self._doubted is not None
            self._best = tried
            self._judge(self._doubted)
            self._doubted = None
            self._next = 'try'
        elif self._falls(tried, self._best):
            self._judge(tried)
        else:
            self._doubted, self._next = tried, 'measure the best again'

    def _judge(self, tried: _Tried) -> None:
        """Compare a run with the best one, as that was measured last."""
        assert self._best is not None
        best_um, now_um = self._best.measured.rms_um, tried.measured.rms_um
        if self._falls(tried, self._best):
            self._best, self._unpaid = tried, 0
            return
        self._unpaid += 1
        if now_um > (1.0 + _RISES) * best_um + _SIGMAS * self._sigma_um(tried):
            self.step *= 0.5
        elif now_um < best_um:
            self._best = tried
        self.is_done = self._unpaid >= _UNPAID

    def _falls(self, tried: _Tried, best: _Tried) -> bool:
        needed_um = max(
            _PAYS * best.measured.rms_um, _SIGMAS * self._sigma_um(tried))
        return tried.measured.rms_um < best.measured.rms_um - needed_um

    def _sigma_um(self, tried: _Tried) -> float:
        assert self._best is not None
        return math.hypot(tried.measured.sigma_um, self._best.measured.sigma_um)
