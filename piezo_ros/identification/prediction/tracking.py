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
What tracking error to expect of a scan, from what is known of the rig.

From the spectra, harmonic by harmonic: E_ff = Y_d Delta, (14) in Liu 2015, and
E_fbff = Y_d Delta S, (15), where Delta has a part that is known (the feedforward is cut off after m
harmonics; it inverts another model than the one at hand, and no hold) and one of which W knows the
size only. And from a simulated run on the known rig, which also sees rails and slew limit.
"""

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.control.feedforward import fourier_amplitudes
from piezo_ros.identification.tuning.linear_plant import Bound, Model, bound_magnitude
from piezo_ros.identification.tuning.pi_loop import PiLoop
from piezo_ros.model import HysteresisParameters, LinearDynamics, RigParameters

__all__ = [
    'SimulatedTracking',
    'SpectralTracking',
    'simulated_tracking',
    'spectral_tracking',
]

_MOST_HARMONICS: Final = 2001
# fs / f is rarely representable: whole periods are counted with this much tolerance, in samples.
_ROUNDING_SAMPLES: Final = 1e-6
_SLEW_TOLERANCE: Final = 1e-9

_Floats = NDArray[np.float64]
_Complexes = NDArray[np.complex128]


@dataclass(frozen=True)
class SpectralTracking:
    """
    Predicted error, harmonic by harmonic, of a linear rig in steady state.

    Attributes
    ----------
    scheme : str
        Scheme of the controller.
    harmonics : int
        Highest harmonic m of the feedforward.
    frequency_hz : ndarray, shape (K,)
        Frequencies of the harmonics of the reference.
    reference_um : ndarray, shape (K,)
        Their amplitudes A_k, (11) in Liu 2015; signed.
    known_error_um : ndarray of complex, shape (K,)
        Error that the model foresees; sin(w t) is 1.
    uncertain_error_um : ndarray, shape (K,)
        Size of the further error for the size of Delta, (14) and (15).
    left_out_um2 : float
        Mean square of the harmonics of the reference that are not listed.

    """

    scheme: str
    harmonics: int
    frequency_hz: _Floats
    reference_um: _Floats
    known_error_um: _Complexes
    uncertain_error_um: _Floats
    left_out_um2: float
    _amplitude_um: float = field(repr=False)

    @property
    def error_um(self) -> _Floats:
        """Amplitude of the error at each harmonic, both parts of unrelated phase, shape (K,)."""
        error: _Floats = np.hypot(np.abs(self.known_error_um), self.uncertain_error_um)
        return error

    @property
    def nrmse_percent(self) -> float:
        """Expected NRMSE, percent of the peak-to-peak reference."""
        return self._percent(self.error_um, self.left_out_um2)

    @property
    def uncertainty_percent(self) -> float:
        """The part of it that is due to the uncertainty of the model."""
        return self._percent(self.uncertain_error_um, 0.0)

    @property
    def truncation_percent(self) -> float:
        """The part of it that is due to the harmonics beyond m."""
        order = np.round(self.frequency_hz / self.frequency_hz[0])
        return self._percent(
            np.abs(self.known_error_um[order > self.harmonics]), self.left_out_um2)

    def _percent(self, amplitudes_um: _Floats, left_out_um2: float) -> float:
        mean_square = 0.5 * float(np.sum(amplitudes_um**2)) + left_out_um2
        return 100.0 * math.sqrt(mean_square) / (2.0 * self._amplitude_um)


@dataclass(frozen=True)
class SimulatedTracking:
    """
    Error of a run simulated on a known rig.

    Attributes
    ----------
    nrmse_percent : float
        NRMSE of the last periods, percent of the peak-to-peak reference.
    slew_v_per_s : float
        Fastest change of voltage that was asked for in them.
    voltage_minimum_v, voltage_maximum_v : float
        Extreme voltages that were asked for, deviations from the operating point.
    slew_limited, rail_limited : bool
        Whether the amplifier could not follow.

    """

    nrmse_percent: float
    slew_v_per_s: float
    voltage_minimum_v: float
    voltage_maximum_v: float
    slew_limited: bool
    rail_limited: bool

    @property
    def is_limited(self) -> bool:
        """Whether the amplifier's limits took part."""
        return self.slew_limited or self.rail_limited


def spectral_tracking(
    model: Model,
    trajectory: TrajectoryParameters,
    controller: ControllerParameters,
    *,
    uncertainty: Bound | None = None,
) -> SpectralTracking:
    """
    Return the error that a linear rig is expected to have.

    Parameters
    ----------
    model : LinearDynamics, DynamicsFit or control.TransferFunction
        What is known best of the compensated actuator; the feedforward inverts the dynamics in
        ``trajectory``, which may be others.
    trajectory : TrajectoryParameters
        A triangle or a sine, its feedforward and the sample period.
    controller : ControllerParameters
        Scheme, gains and delay of the measurement.
    uncertainty : UncertaintyBound, control.TransferFunction or callable, optional
        W(s), or a measured |Delta| as a function of the frequency in hertz.

    Returns
    -------
    SpectralTracking
        The spectrum of the error.

    Raises
    ------
    ParameterError
        If the waveform has no Fourier series.

    """
    period_s = trajectory.sample_period_s
    nyquist_harmonic = math.ceil(0.5 / (trajectory.frequency_hz * period_s)) - 1
    highest = min(max(nyquist_harmonic, 1), _MOST_HARMONICS)
    all_amplitudes = fourier_amplitudes(trajectory.waveform, trajectory.amplitude_um, highest)
    order = np.flatnonzero(all_amplitudes) + 1
    amplitude = all_amplitudes[order - 1]
    frequency = np.asarray(order * trajectory.frequency_hz, dtype=np.float64)
    inverse = _feedforward_gain(trajectory, order)
    # Without feedback the gains do not matter, but there must be some.
    gains = (controller.proportional_gain, controller.integral_gain_per_s)
    loop = PiLoop.of(
        model, *(gains if any(gains) else (1.0, 0.0)), period_s,
        controller.measurement_delay_samples)
    plant = loop.plant_response(frequency)
    feedforward = inverse * amplitude * controller.uses_feedforward
    sensitivity: _Complexes = np.ones(order.size, dtype=np.complex128)
    command = feedforward
    if controller.uses_feedback and any(gains):
        sensitivity = loop.sensitivity(frequency)
        command = sensitivity * (feedforward + loop.controller_response(frequency) * amplitude)
    elif controller.scheme == 'open_loop':
        command = amplitude.astype(np.complex128)
    output = plant * command
    uncertain: _Floats = np.zeros(order.size)
    if uncertainty is not None:
        uncertain = np.abs(sensitivity * output) * bound_magnitude(uncertainty, frequency)
    square = _mean_square(trajectory)
    return SpectralTracking(
        scheme=controller.scheme, harmonics=trajectory.harmonics, frequency_hz=frequency,
        reference_um=amplitude, known_error_um=amplitude - output, uncertain_error_um=uncertain,
        left_out_um2=max(square - 0.5 * float(np.sum(amplitude**2)), 0.0),
        _amplitude_um=trajectory.amplitude_um)


def _feedforward_gain(
    trajectory: TrajectoryParameters, order: NDArray[np.int64],
) -> _Complexes:
    """Return U_k/A_k of (13)."""
    model = LinearDynamics(trajectory)
    if trajectory.harmonics == 0:
        return np.full(order.size, 1.0 / trajectory.dc_gain, dtype=np.complex128)
    return np.where(
        order <= trajectory.harmonics, 1.0 / model.response(order * trajectory.frequency_hz), 0.0)


def _mean_square(trajectory: TrajectoryParameters) -> float:
    share = {'triangle': 1.0 / 3.0, 'sine': 0.5}[trajectory.waveform]
    return share * trajectory.amplitude_um**2


def simulated_tracking(
    rig: RigParameters,
    trajectory: TrajectoryParameters,
    controller: ControllerParameters,
    *,
    compensator: HysteresisParameters | None = None,
    score_periods: float = 4.0,
) -> SimulatedTracking:
    """
    Return the error of a simulated run.

    Parameters
    ----------
    rig : RigParameters
        What is known of the rig: identified dynamics and hysteresis, the amplifier's slew limit
        and rails.
    trajectory : TrajectoryParameters
        The run.
    controller : ControllerParameters
        Gains and scheme.
    compensator : HysteresisParameters, optional
        The hysteresis that is inverted; that of ``rig`` by default.
    score_periods : float, optional
        Periods at the end of the run that are scored.

    Returns
    -------
    SimulatedTracking
        Error and what the amplifier was asked for.

    Raises
    ------
    ValueError
        If the run has fewer periods than are to be scored.

    """
    if not 0.0 < score_periods <= trajectory.periods:
        raise ValueError(
            f'score_periods is {score_periods}, allowed is above 0 … {trajectory.periods} '
            '(periods of the trajectory)')
    run = simulate(rig, compensator or rig, controller, trajectory)
    period_s = trajectory.sample_period_s
    count = min(trajectory.samples, max(2, math.floor(
        score_periods / (trajectory.frequency_hz * period_s) + _ROUNDING_SAMPLES)))
    error = run.reference_um[-count:] - run.displacement_um[:-1][-count:]
    voltage = run.voltage_v[-count:]
    slew = float(np.max(np.abs(np.diff(voltage)))) / period_s
    low = rig.voltage_minimum_v - rig.operating_point_v
    high = rig.voltage_maximum_v - rig.operating_point_v
    return SimulatedTracking(
        nrmse_percent=100.0 * float(np.sqrt(np.mean(error**2)))
        / float(np.ptp(run.reference_um[-count:])),
        slew_v_per_s=slew,
        voltage_minimum_v=float(voltage.min()),
        voltage_maximum_v=float(voltage.max()),
        slew_limited=0.0 < rig.slew_limit_v_per_s * (1.0 + _SLEW_TOLERANCE) < slew,
        rail_limited=bool(voltage.min() < low or voltage.max() > high))
