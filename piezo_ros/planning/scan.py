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
What is wanted of a periodic scan, and its plan on the identified stage.

The band of the voltage is six times the fastest pole pair. A bound |W| of the relative error of the
identified response narrows it to where the model still tells the direction of a step: above
|W| = 0.5 learning by it is no longer certain.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.waveform import WaveformParameters, abrupt_step, waveform_constants
from piezo_ros.model import (
    DynamicsParameters,
    HysteresisParameters,
    LinearDynamics,
    RigParameters,
)
from piezo_ros.model.effects.load import average_slew
from piezo_ros.planning.constrained_step import AmplifierLimits
from piezo_ros.planning.harmonics import repeating_samples
from piezo_ros.planning.periodic_plan import PeriodicPlan, PlanAccuracy, plan_periodic
from piezo_ros.planning.periodic_stage import PeriodicStage

__all__ = [
    'SCANS', 'ScanRequest', 'limits_of', 'plan_for_rig', 'planned_scan', 'stage_of', 'with_bound',
]

SCANS: Final = ('triangle', 'sine', 'sawtooth')
_WAVEFORM: Final = WaveformParameters()
_HIGHEST_SHARE: Final = 0.15  # of the sampling frequency, for the band
_POLES_SHARE: Final = 6.0  # of the fastest pole pair, for the band
_FREE_WEIGHT: Final = 0.003
_WORST_PERCENT: Final = 10.0  # what is farther off is another scan
_LARGEST_UNCERTAINTY: Final = 0.5  # of a harmonic that is planned
_SETTLED_TIMES: Final = 10.0  # averaging times after which a repeated voltage has its averages
_AVERAGE_SHARE: Final = 0.99  # of the limit, for what the next plan has elsewhere in its period
_MOST_PLANS: Final = 4
_MOST_REPETITIONS: Final = 100


@dataclass(frozen=True)
class ScanRequest:
    """
    What is wanted of a scan, and what is known of the stage.

    Attributes
    ----------
    waveform : str
        ``'triangle'``, ``'sine'`` or ``'sawtooth'``.
    amplitude_um, frequency_hz : float
        Of the scan.
    sample_period_s : float
        Sample period, seconds.
    dynamics : DynamicsParameters
        What was identified.
    hysteresis : HysteresisParameters
        What was identified, and the compensator inverts.
    limits : AmplifierLimits
        What the voltage keeps.
    band_hz : float
        Highest frequency of the voltage; 0: six times the fastest pole pair, at most 15 % of the
        sampling frequency.
    free_turn : float
        Share of each line, about its ends, in which the error hardly counts; 0 for none.
    ramp_periods : float
        Periods of the soft start.
    uncertainty : float
        Largest relative error of the model in the band, for the certificate.
    uncertainty_percent : float
        What that leaves at most of the scan, percent of the peak-to-peak reference.
    noise_rms_um : float
        Of the sensor, which a run will measure beside its error.
    offset_um : float
        Mean of the scan.
    turn_fraction, flyback_fraction : float
        Of triangle and sawtooth, as the trajectory has them.

    """

    waveform: str
    amplitude_um: float
    frequency_hz: float
    sample_period_s: float
    dynamics: DynamicsParameters
    hysteresis: HysteresisParameters
    limits: AmplifierLimits
    band_hz: float = 0.0
    free_turn: float = 0.0
    ramp_periods: float = 2.0
    uncertainty: float = 0.0
    uncertainty_percent: float = 0.0
    noise_rms_um: float = 0.0
    offset_um: float = 0.0
    turn_fraction: float = 0.0
    flyback_fraction: float = _WAVEFORM.flyback_fraction

    def __post_init__(self) -> None:
        if self.waveform not in SCANS:
            raise ValueError(f'waveform is {self.waveform!r}, allowed are {", ".join(SCANS)}')
        for name, low, high in (
                ('amplitude_um', 0.0, 1e4), ('frequency_hz', 0.0, 0.25 / self.sample_period_s)):
            value = getattr(self, name)
            if not low < value <= high:
                raise ValueError(f'{name} is {value}, allowed is above {low:g} … {high:g}')
        if not 0.0 <= self.free_turn < 0.9:
            raise ValueError(f'free_turn is {self.free_turn}, allowed is 0 … 0.9')
        if not 0.0 <= self.ramp_periods <= 1e4:
            raise ValueError(f'ramp_periods is {self.ramp_periods}, allowed is 0 … 10000')
        for name in ('uncertainty', 'uncertainty_percent', 'noise_rms_um'):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f'{name} is {value}, it must be a number from 0 on')
        _ = self._shape  # refuses what the trajectory refuses

    @property
    def _shape(self) -> WaveformParameters:
        return WaveformParameters(
            waveform=self.waveform, amplitude_um=self.amplitude_um, offset_um=self.offset_um,
            frequency_hz=self.frequency_hz, sample_period_s=self.sample_period_s,
            turn_fraction=self.turn_fraction, flyback_fraction=self.flyback_fraction)

    @property
    def band(self) -> float:
        """Highest frequency of the voltage, hertz."""
        if self.band_hz:
            return self.band_hz
        pairs = [frequency for frequency, _ in self.dynamics.pole_pairs]
        rates = [*pairs, *self.dynamics.rates_rad_per_s]
        fastest_hz = max(pairs or rates) / (2.0 * math.pi)
        return max(
            min(_POLES_SHARE * fastest_hz, _HIGHEST_SHARE / self.sample_period_s),
            1.01 * self.frequency_hz)

    @property
    def accuracy(self) -> PlanAccuracy:
        """What is known of the errors of model and sensor."""
        return PlanAccuracy(self.uncertainty, self.uncertainty_percent, self.noise_rms_um)

    @property
    def is_symmetric(self) -> bool:
        """Whether odd harmonics of the voltage are enough."""
        return not (
            self.hysteresis.asymmetry_threshold_um or self.offset_um or self.waveform == 'sawtooth')

    @property
    def reference_um(self) -> NDArray[np.float64]:
        """The reference over the samples after which it repeats, shape (P,)."""
        constants = waveform_constants(self._shape)
        samples = repeating_samples(self.frequency_hz, self.sample_period_s)
        turns = self.frequency_hz * self.sample_period_s * np.arange(samples)
        return np.array([abrupt_step(constants, turn) for turn in turns.tolist()])

    @property
    def weight(self) -> NDArray[np.float64]:
        """Weight of each sample's squared error, shape (P,)."""
        about_mean_um = np.abs(self.reference_um - self.offset_um)
        lines = about_mean_um <= (1.0 - self.free_turn) * self.amplitude_um
        return np.where(lines, 1.0, _FREE_WEIGHT)


def with_bound(
    request: ScanRequest, magnitude: Callable[[NDArray[np.float64]], NDArray[np.float64]],
) -> ScanRequest:
    """
    Return a request with the band in which its model is known, and the uncertainty there.

    Parameters
    ----------
    request : ScanRequest
        What is wanted; its band is not exceeded.
    magnitude : callable
        Frequencies in hertz to |W|, the bound of the relative error of the identified response.

    """
    highest = max(math.floor(request.band / request.frequency_hz), 1)
    frequency_hz = request.frequency_hz * np.arange(1, highest + 1, dtype=np.float64)
    bound = np.asarray(magnitude(frequency_hz), dtype=np.float64)
    beyond = np.flatnonzero(~(bound <= _LARGEST_UNCERTAINTY))
    count = max(int(beyond[0]) if beyond.size else highest, 1)
    reference_um = request.reference_um
    samples = reference_um.size
    repeated = round(request.frequency_hz * request.sample_period_s * samples)
    amplitude_um = 2.0 / samples * np.abs(np.fft.rfft(reference_um))[repeated::repeated]
    known = min(count, amplitude_um.size)
    uncertain_um = math.sqrt(0.5 * float(np.sum((bound[:known] * amplitude_um[:known])**2)))
    return replace(
        request, uncertainty=float(bound[:count].max()),
        uncertainty_percent=100.0 * uncertain_um / float(np.ptp(reference_um)),
        # Half a harmonic more, for the rounding of a quotient.
        band_hz=request.band if count == highest else (count + 0.5) * request.frequency_hz)


def stage_of(request: ScanRequest) -> PeriodicStage:
    """Return the identified stage in its periodic state."""
    dynamics = LinearDynamics(request.dynamics)
    return PeriodicStage(
        dynamics.before_hysteresis, request.hysteresis, dynamics.behind_hysteresis,
        request.sample_period_s,
        repeating_samples(request.frequency_hz, request.sample_period_s), dynamics.delay_s)


def planned_scan(request: ScanRequest) -> PeriodicPlan:
    """
    Return the plan of a scan.

    Raises
    ------
    ValueError
        If the scan does not repeat, or no voltage near to it keeps the limits.

    """
    plan = plan_periodic(
        stage_of(request), request.reference_um, request.frequency_hz, request.sample_period_s,
        band_hz=request.band, limits=request.limits, weight=request.weight,
        accuracy=request.accuracy, is_symmetric=request.is_symmetric)
    if plan.line_nrmse_percent > _WORST_PERCENT:
        raise ValueError(
            f'amplitude_um is {request.amplitude_um:g} at {request.frequency_hz:g} Hz: within its '
            f'limits the amplifier leaves an error of {plan.line_nrmse_percent:.3g} %, allowed is '
            f'{_WORST_PERCENT:g} % (a smaller or slower scan)')
    return plan


def plan_for_rig(request: ScanRequest, rig: RigParameters) -> tuple[ScanRequest, PeriodicPlan]:
    """
    Return the plan of a scan that keeps the average current as the amplifier of a rig averages it.

    A plan keeps its mean absolute slope over whole periods; the amplifier averages over a time of
    its own. Where that has higher peaks, the scan is planned again with a lower mean.

    Parameters
    ----------
    request : ScanRequest
        What is wanted.
    rig : RigParameters
        The rig with the limit.

    Returns
    -------
    request : ScanRequest
        The request with the mean that keeps the limit.
    plan : PeriodicPlan
        Its plan.

    Raises
    ------
    ValueError
        As `planned_scan`, or if no mean is found that keeps the limit.

    """
    limit_v_per_s = rig.average_slew_limit_v_per_s or math.inf
    for _ in range(_MOST_PLANS):
        plan = planned_scan(request)
        highest_v_per_s = _highest_average_v_per_s(plan, rig.average_slew_time_s)
        if highest_v_per_s <= limit_v_per_s:
            return request, plan
        voltage_v = plan.period_voltage_v
        mean_v_per_s = float(
            np.abs(np.roll(voltage_v, -1) - voltage_v).mean()) / plan.sample_period_s
        request = replace(request, limits=replace(
            request.limits,
            average_slew_v_per_s=_AVERAGE_SHARE * mean_v_per_s * limit_v_per_s / highest_v_per_s))
    raise ValueError(
        f'average_slew_limit_v_per_s is {limit_v_per_s:g}, averaged over '
        f'{rig.average_slew_time_s:g} s the plan needs {highest_v_per_s:g} V/s (a smaller or '
        'slower scan)')


def _highest_average_v_per_s(plan: PeriodicPlan, average_s: float) -> float:
    """Return the highest mean absolute slope over the time in which an amplifier averages."""
    voltage_v = plan.period_voltage_v
    settling = math.ceil(_SETTLED_TIMES * average_s / (plan.sample_period_s * voltage_v.size))
    # Over very many repetitions the average hardly leaves the mean, with which it begins.
    repetitions = 2 + min(settling, _MOST_REPETITIONS)
    averages_v_per_s = average_slew(
        np.tile(voltage_v, repetitions), average_s, plan.sample_period_s)
    return float(averages_v_per_s[-voltage_v.size:].max())


def limits_of(
    plant: RigParameters, average_slew_v_per_s: float | None = None,
) -> AmplifierLimits:
    """
    Return the limits that a data sheet gives for the voltage.

    Parameters
    ----------
    plant : RigParameters
        The rig.
    average_slew_v_per_s : float, optional
        Largest mean absolute slope; that of the rig by default, infinite where it has none.

    """
    if average_slew_v_per_s is None:
        average_slew_v_per_s = plant.average_slew_limit_v_per_s or math.inf
    return AmplifierLimits(
        slew_v_per_s=plant.slew_limit_v_per_s or math.inf,
        average_slew_v_per_s=average_slew_v_per_s,
        minimum_v=plant.voltage_minimum_v - plant.operating_point_v,
        maximum_v=plant.voltage_maximum_v - plant.operating_point_v)
