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
A periodic scan planned within the limits of the amplifier.

The voltage of one period is a sum of harmonics up to a band,

    u(t) = sum over k <= m of a_k cos(2 pi k f t) + b_k sin(2 pi k f t)

with odd k for a symmetric stage, else with all and a mean, k = 0. Their coefficients bring the
periodic displacement of the identified stage to the reference (Gauss-Newton, each step within the
limits). The command that is played is v = H(u): its inverse in the compensator gives u back.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.model import HysteresisParameters, MaxwellResistiveCapacitor
from piezo_ros.planning.certificate import Certificate, certificate
from piezo_ros.planning.constrained_step import AmplifierLimits, constrained_step
from piezo_ros.planning.harmonics import (
    harmonic_basis,
    orders_of_band,
    repeating_samples,
    sample_turns,
)
from piezo_ros.planning.periodic_stage import LinearisedAnswer, PeriodicStage

__all__ = [
    'PeriodicPlan', 'PlanAccuracy', 'harmonic_basis', 'known_plan', 'orders_of_band',
    'plan_periodic', 'regularisation_of', 'repeating_samples', 'weighted_rms_um',
]

_ITERATIONS: Final = 12
_SETTLED: Final = 1e-4  # relative change of the error at which the plan is done
_REGULARISATION: Final = 1e-4  # of the mean square sensitivity
_MEAN_SHARE: Final = 0.5  # of the slew limit, on the way to the mean of a scan
_FIRST_SHARE: Final = 0.5
# Voltages about the plan, by which elements of the stage may slip that do not in the model.
_NEIGHBOURS: Final = (0.95, 0.965, 0.98, 0.99, 1.01, 1.02, 1.035, 1.05)


class PlanAccuracy(NamedTuple):
    """
    What is known of the errors of model and sensor.

    Attributes
    ----------
    uncertainty : float
        Largest relative error of the model in the band.
    uncertainty_percent : float
        What that leaves at most of the scan, percent of the peak-to-peak reference.
    noise_rms_um : float
        Noise of the sensor.

    """

    uncertainty: float = 0.0
    uncertainty_percent: float = 0.0
    noise_rms_um: float = 0.0


@dataclass(frozen=True)
class PeriodicPlan:
    """
    A planned scan.

    Attributes
    ----------
    frequency_hz, sample_period_s : float
        Of the scan and of its samples.
    orders : ndarray of int, shape (K,)
        Orders of the harmonics of the voltage.
    coefficients_v : ndarray, shape (M,)
        Cosine, then sine amplitudes.
    reference_um, displacement_um : ndarray, shape (P,)
        What is wanted and what is predicted, over the samples after which all repeats.
    weight : ndarray, shape (P,)
        Weight of each sample's squared error.
    limits : AmplifierLimits
        What the voltage keeps.
    truncation_percent : float
        Error that the band alone would leave, without limits, percent of the peak-to-peak
        reference.
    certificate : Certificate
        Whether learning on the stage is certain to lessen the error.
    accuracy : PlanAccuracy
        What is known of the errors of model and sensor.

    """

    frequency_hz: float
    sample_period_s: float
    orders: NDArray[np.int64]
    coefficients_v: NDArray[np.float64]
    reference_um: NDArray[np.float64]
    displacement_um: NDArray[np.float64]
    weight: NDArray[np.float64]
    limits: AmplifierLimits
    truncation_percent: float
    certificate: Certificate
    accuracy: PlanAccuracy = field(default_factory=PlanAccuracy)

    @property
    def predicted_nrmse_percent(self) -> float:
        """Error of the prediction, percent of the peak-to-peak reference."""
        return self._percent(self.reference_um - self.displacement_um)

    @property
    def limits_percent(self) -> float:
        """The share of the prediction that the limits of the amplifier cause."""
        return math.sqrt(max(self.predicted_nrmse_percent**2 - self.truncation_percent**2, 0.0))

    @property
    def noise_percent(self) -> float:
        """Noise of the sensor, percent of the peak-to-peak reference."""
        return 100.0 * self.accuracy.noise_rms_um / float(np.ptp(self.reference_um))

    @property
    def measured_nrmse_percent(self) -> float:
        """What a run is expected to measure: the prediction and the noise of the sensor."""
        return math.hypot(self.predicted_nrmse_percent, self.noise_percent)

    @property
    def highest_nrmse_percent(self) -> float:
        """What a run measures where the model is as wrong as its uncertainty allows."""
        return math.hypot(
            self.predicted_nrmse_percent + self.accuracy.uncertainty_percent, self.noise_percent)

    @property
    def line_nrmse_percent(self) -> float:
        """Error of the prediction where it counts in full, percent of the peak-to-peak."""
        counts = self.weight >= self.weight.max()
        return self._percent((self.reference_um - self.displacement_um)[counts])

    @property
    def weighted_nrmse_percent(self) -> float:
        """Weighted error of the prediction, percent of the peak-to-peak reference."""
        error_um = self.reference_um - self.displacement_um
        return 100.0 * weighted_rms_um(error_um, self.weight) / float(np.ptp(self.reference_um))

    @property
    def limit_use(self) -> float:
        """Largest use of any limit of the amplifier, 1 at the limit."""
        return self.limits.worst(self.period_voltage_v, self.sample_period_s)

    @property
    def period_voltage_v(self) -> NDArray[np.float64]:
        """The voltage over the samples after which all repeats, shape (P,)."""
        return self.voltage_v(self.reference_um.size)

    def basis(self, samples: int) -> NDArray[np.float64]:
        """Return the voltage by coefficient of the first samples of a run, shape (samples, M)."""
        return harmonic_basis(
            sample_turns(samples, self.frequency_hz, self.sample_period_s), self.orders)

    def voltage_v(self, samples: int) -> NDArray[np.float64]:
        """Return the voltage of the first samples of a run, deviations, shape (samples,)."""
        return self.basis(samples) @ self.coefficients_v

    def with_coefficients(
        self, coefficients_v: NDArray[np.float64], stage: PeriodicStage,
    ) -> 'PeriodicPlan':
        """Return the plan with other coefficients, and the displacement that they bring about."""
        return replace(
            self, coefficients_v=coefficients_v,
            displacement_um=stage.answer(self.basis(stage.samples) @ coefficients_v))

    @property
    def mean_v(self) -> float:
        """Mean of the voltage."""
        return float(self.coefficients_v[0]) if self.orders[0] == 0 else 0.0

    def mean_start_samples(self, periods: float) -> int:
        """
        Return how many samples the way to the mean takes before the scan begins.

        Parameters
        ----------
        periods : float
            Least length of that way; 0 for none.

        """
        if periods <= 0.0 or self.orders[0] != 0:
            return 0
        slope_v = _MEAN_SHARE * self.sample_period_s * min(
            self.limits.slew_v_per_s, self.limits.average_slew_v_per_s)
        return math.ceil(max(
            periods / (self.frequency_hz * self.sample_period_s), abs(self.mean_v) / slope_v))

    def mean_start(self, samples: int, periods: float) -> NDArray[np.float64]:
        """
        Return the factors of the mean in a start from rest, shape (samples,).

        Parameters
        ----------
        samples : int
            Length of the run.
        periods : float
            As for `mean_start_samples`.

        """
        rise = self.mean_start_samples(periods)
        return np.minimum(np.arange(samples) / rise, 1.0) if rise else np.ones(samples)

    def soft_start(self, samples: int, periods: float) -> NDArray[np.float64]:
        """
        Return the factors of the scan about its mean in a start that keeps the limits.

        The ramp ends where the voltage crosses its mean: with |du/dt| <= s and u(T) = 0, the
        product of u and t/T rises by (t/T) s + |u|/T <= s at most.

        Parameters
        ----------
        samples : int
            Length of the run.
        periods : float
            Length of the ramp, which ends at the next crossing; 0 for none.

        Returns
        -------
        ndarray, shape (samples,)

        """
        if periods <= 0.0:
            return np.ones(samples)
        rise = self.mean_start_samples(periods)
        first = rise + math.ceil(periods / (self.frequency_hz * self.sample_period_s))
        voltage_v = self.voltage_v(first + self.reference_um.size + 1)[first:] - self.mean_v
        crossing = int(np.flatnonzero(voltage_v[:-1] * voltage_v[1:] <= 0.0)[0])
        before, after = voltage_v[crossing:crossing + 2].tolist()
        share = before / (before - after) if before != after else 0.0
        return np.clip((np.arange(samples) - rise) / (first + crossing + share - rise), 0.0, 1.0)

    def started_voltage_v(self, samples: int, ramp_periods: float) -> NDArray[np.float64]:
        """Return the voltage of a run from rest, first to its mean, shape (samples,)."""
        about_mean_v = self.voltage_v(samples) - self.mean_v
        return (
            self.mean_v * self.mean_start(samples, ramp_periods)
            + self.soft_start(samples, ramp_periods) * about_mean_v)

    def command_um(
        self, samples: int, hysteresis: HysteresisParameters, ramp_periods: float = 0.0,
    ) -> NDArray[np.float64]:
        """
        Return the command that the compensator turns into the planned voltage, shape (samples,).

        Parameters
        ----------
        samples : int
            Length of the run.
        hysteresis : HysteresisParameters
            The hysteresis that the compensator inverts.
        ramp_periods : float, optional
            Periods of the soft start.

        """
        return MaxwellResistiveCapacitor.of(hysteresis).forward(
            self.started_voltage_v(samples, ramp_periods))[0]

    def _percent(self, error_um: NDArray[np.float64]) -> float:
        return _percent_of(error_um, self.reference_um)


def weighted_rms_um(error_um: NDArray[np.float64], weight: NDArray[np.float64]) -> float:
    """Return the root of the weighted mean square, of arrays of shape (P,)."""
    return math.sqrt(float(np.mean(weight * error_um**2)))


def _percent_of(error_um: NDArray[np.float64], reference_um: NDArray[np.float64]) -> float:
    return 100.0 * float(np.sqrt(np.mean(error_um**2)) / np.ptp(reference_um))


def plan_periodic(
    stage: PeriodicStage, reference_um: NDArray[np.float64], frequency_hz: float,
    sample_period_s: float, *, band_hz: float, limits: AmplifierLimits | None = None,
    weight: Sequence[float] | NDArray[np.float64] | None = None,
    accuracy: PlanAccuracy | None = None, is_symmetric: bool = True,
) -> PeriodicPlan:
    """
    Return the voltage that brings a stage along a periodic reference within limits.

    Parameters
    ----------
    stage : PeriodicStage
        The identified stage, of P samples.
    reference_um : ndarray, shape (P,)
        The reference over the samples after which it repeats; its second half period mirrors the
        first one.
    frequency_hz, sample_period_s : float
        Of the scan and of its samples.
    band_hz : float
        Highest frequency of the voltage.
    limits : AmplifierLimits, optional
        What the voltage keeps; nothing by default.
    weight : array_like, shape (P,), optional
        Weight of each sample's squared error, 1 by default; small where the scan may turn freely.
    accuracy : PlanAccuracy, optional
        What is known of the errors of model and sensor; none by default.
    is_symmetric : bool, optional
        Whether stage and reference are the same upside down, so that odd harmonics are enough.

    Returns
    -------
    PeriodicPlan
        The plan with its predicted error.

    Raises
    ------
    ValueError
        If the band has no harmonic, or sizes do not agree.
    InfeasibleError
        If no voltage of the band keeps the limits.

    """
    if reference_um.shape != (stage.samples,):
        raise ValueError(
            f'reference_um has the shape {reference_um.shape}, the stage has {stage.samples} '
            'samples')
    orders = orders_of_band(band_hz, frequency_hz, sample_period_s, is_symmetric=is_symmetric)
    weights = np.ones(stage.samples) if weight is None else np.asarray(weight, dtype=np.float64)
    basis = harmonic_basis(sample_turns(stage.samples, frequency_hz, sample_period_s), orders)
    start = _start(stage, reference_um, basis, orders)
    coefficients, answer = _descend(
        stage, reference_um, weights, basis, start, AmplifierLimits(), sample_period_s)
    truncation_percent = _percent_of(reference_um - answer.displacement_um, reference_um)
    kept = limits or AmplifierLimits()
    if kept.worst(basis @ coefficients, sample_period_s) > 1.0:
        coefficients, _ = _descend(
            stage, reference_um, weights, basis, start, kept, sample_period_s)
    return known_plan(
        stage, reference_um, frequency_hz, sample_period_s, orders=orders,
        coefficients_v=coefficients, truncation_percent=truncation_percent, limits=kept,
        weight=weights, accuracy=accuracy or PlanAccuracy())


def known_plan(
    stage: PeriodicStage, reference_um: NDArray[np.float64], frequency_hz: float,
    sample_period_s: float, *, orders: NDArray[np.int64], coefficients_v: NDArray[np.float64],
    truncation_percent: float, limits: AmplifierLimits, weight: NDArray[np.float64],
    accuracy: PlanAccuracy,
) -> PeriodicPlan:
    """
    Return a plan of known coefficients, with its prediction and its certificate.

    Parameters
    ----------
    stage, reference_um, frequency_hz, sample_period_s, accuracy
        As for `plan_periodic`.
    orders, coefficients_v, truncation_percent, limits, weight
        As in `PeriodicPlan`.

    """
    basis = harmonic_basis(sample_turns(stage.samples, frequency_hz, sample_period_s), orders)
    voltage_v = basis @ coefficients_v
    answer = stage.linearise(voltage_v, basis)
    neighbours = [stage.linearise(share * voltage_v, basis).slope for share in _NEIGHBOURS]
    return PeriodicPlan(
        frequency_hz=frequency_hz, sample_period_s=sample_period_s, orders=orders,
        coefficients_v=coefficients_v, reference_um=reference_um,
        displacement_um=answer.displacement_um, weight=weight, limits=limits,
        truncation_percent=truncation_percent,
        certificate=certificate(
            answer.slope, weight, regularisation_of(answer.slope), accuracy.uncertainty,
            neighbours),
        accuracy=accuracy)


def regularisation_of(slope: NDArray[np.float64]) -> float:
    """Return the weight of the squared change of the coefficients."""
    return _REGULARISATION * float(np.sum(slope**2)) / slope.size


def _start(
    stage: PeriodicStage, reference_um: NDArray[np.float64], basis: NDArray[np.float64],
    orders: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Return the first harmonic of the reference over the gain of the stage, half as large."""
    cosine = int(np.flatnonzero(orders == 1)[0])
    pair = [cosine, orders.size]  # the sines follow the cosines
    first = basis[:, pair]
    shares = np.linalg.lstsq(first, reference_um, rcond=None)[0]
    unit_v = first @ (shares / np.hypot(*shares))
    gain_um_per_v = float(np.ptp(stage.answer(unit_v)) / np.ptp(unit_v))
    start = np.zeros(basis.shape[1])
    start[pair] = _FIRST_SHARE * shares / gain_um_per_v
    if orders[0] == 0:
        start[0] = _FIRST_SHARE * float(reference_um.mean()) / gain_um_per_v
    return start


def _descend(
    stage: PeriodicStage, reference_um: NDArray[np.float64], weight: NDArray[np.float64],
    basis: NDArray[np.float64], start: NDArray[np.float64], limits: AmplifierLimits,
    sample_period_s: float,
) -> tuple[NDArray[np.float64], LinearisedAnswer]:
    """Return the best coefficients that the steps come to, and the stage's answer to them."""
    coefficients = start
    answer = stage.linearise(basis @ coefficients, basis)
    squares = math.inf
    for _ in range(_ITERATIONS):
        error_um = reference_um - answer.displacement_um
        change = constrained_step(
            answer.slope, error_um, weight, regularisation_of(answer.slope), basis, coefficients,
            limits, sample_period_s)
        for share in (1.0, 0.5, 0.25):
            tried = stage.linearise(basis @ (coefficients + share * change), basis)
            now = float(np.sum(weight * (reference_um - tried.displacement_um)**2))
            if now < squares:
                break
        else:
            break
        coefficients, answer = coefficients + share * change, tried
        settled = squares - now < _SETTLED * now
        squares = now
        if settled:
            break
    return coefficients, answer
