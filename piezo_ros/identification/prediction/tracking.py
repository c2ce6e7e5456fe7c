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
The tracking error to expect of one run, from a model of the plant or the rig.

For harmonic k of the reference Y_d, with the dynamics G, the feedforward F (the inverse model up to
harmonic m, 0 beyond), the controller K, (8) in Liu 2015, a measurement that is d samples old and
S = 1/(1 + K G z^-d), (16):

    ff:     U = F Y_d
    fbff:   U = S (F + K) Y_d
    fb:     U = S K Y_d
    E = Y_d - G U

E is the known error: harmonics beyond m, the hold, a feedforward that inverts another model than G.
A relative uncertainty |Delta| <= |W| adds |G U W|, (14), under feedback |S G U W|, (15). The two
parts have unrelated phases:

    NRMSE^2 = (sum_k (|E_k|^2 + |uncertain_k|^2)/2 + mean square of harmonics not listed
              + |E_0|^2 + |uncertain_0|^2 of the offset) / (2 A)^2

A rig (hysteresis, rails, slew limit) is simulated too; the simulated NRMSE then takes the place of
the known part. Where the place of the hysteresis among its poles is not decided, it is simulated
with each. What identification knows of the errors of its models adds its parts, see `accuracy`.

Examples
--------
The feedforward of nine harmonics leaves 0.37 % of a triangle:

>>> from piezo_ros.control import ControllerParameters, TrajectoryParameters
>>> from piezo_ros.model import LinearDynamics
>>> prediction = predict_tracking(
...     LinearDynamics(), TrajectoryParameters(harmonics=9), ControllerParameters(scheme='ff'))
>>> round(prediction.truncation_percent, 2)
0.37

"""

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.control.shapes.fourier_series import fourier_amplitudes, mean_square_um2
from piezo_ros.identification.prediction.accuracy import (
    ErrorInterval,
    ModelAccuracy,
    error_interval,
)
from piezo_ros.identification.prediction.placement import placements
from piezo_ros.identification.tuning.linear_plant import Bound, Model, bound_magnitude
from piezo_ros.identification.tuning.pi_loop import Lead, PiLoop
from piezo_ros.model import HysteresisParameters, LinearDynamics, RigParameters
from piezo_ros.model.effects.load import average_slew

__all__ = ['TrackingPrediction', 'predict_tracking']

_MOST_HARMONICS: Final = 2001
# fs / f is rarely representable: whole periods are counted with this much tolerance, in samples.
_ROUNDING_SAMPLES: Final = 1e-6
_SLEW_TOLERANCE: Final = 1e-9
_NOTHING_KNOWN: Final = ModelAccuracy().unknown(bound=False)

_Floats = NDArray[np.float64]
_Complexes = NDArray[np.complex128]


@dataclass(frozen=True)
class TrackingPrediction:
    """
    Predicted error of one run in steady state, percent of the peak-to-peak reference.

    Attributes
    ----------
    scheme : str
        Scheme of the controller.
    harmonics : int
        Highest harmonic m of the feedforward.
    linear_nrmse_percent : float
        NRMSE by the spectra, uncertainty included.
    truncation_percent, uncertainty_percent : float
        The parts of it that are due to the harmonics beyond m and to the uncertainty of the model.
    frequency_hz : ndarray, shape (K,)
        Frequencies of the harmonics of the reference.
    reference_um : ndarray, shape (K,)
        Their amplitudes A_k, (11) in Liu 2015; signed.
    known_error_um : ndarray of complex, shape (K,)
        The known error; sin(w t) is 1.
    uncertain_error_um : ndarray, shape (K,)
        Size of the further error for the size of Delta, (14) and (15).
    simulated_nrmse_percent : float or None
        NRMSE of the last periods of the run simulated on the known rig; None without a rig.
    slew_v_per_s, voltage_minimum_v, voltage_maximum_v : float or None
        Fastest change and extremes of the voltage that the simulated run asks for, the extremes as
        deviations from the operating point; None without a rig.
    slew_limited, rail_limited, average_limited : bool
        Whether the amplifier cannot follow, the last one for its average current; false without a
        rig.
    model_percent, hysteresis_percent : float
        The parts that are due to the errors of the dynamics and of the hysteresis as far as
        identification tells them.
    noise_percent : float
        The part of the simulated NRMSE that is noise of the sensor.
    by_place_percent : tuple of float
        Simulated NRMSE for each place of the hysteresis that is possible, that of the rig first;
        empty where the place is known.
    unknown : tuple of str
        Parts of which nothing is known; the interval then has no upper end.
    residual_gain : float
        How much larger the residual of the hysteresis is in the run than at rest.

    """

    scheme: str
    harmonics: int
    linear_nrmse_percent: float
    truncation_percent: float
    uncertainty_percent: float
    frequency_hz: _Floats = field(repr=False, compare=False)
    reference_um: _Floats = field(repr=False, compare=False)
    known_error_um: _Complexes = field(repr=False, compare=False)
    uncertain_error_um: _Floats = field(repr=False, compare=False)
    simulated_nrmse_percent: float | None = None
    slew_v_per_s: float | None = None
    voltage_minimum_v: float | None = None
    voltage_maximum_v: float | None = None
    slew_limited: bool = False
    rail_limited: bool = False
    average_limited: bool = False
    model_percent: float = 0.0
    hysteresis_percent: float = 0.0
    noise_percent: float = 0.0
    by_place_percent: tuple[float, ...] = ()
    unknown: tuple[str, ...] = _NOTHING_KNOWN
    residual_gain: float = field(default=1.0, repr=False, compare=False)

    @property
    def dynamics_percent(self) -> float:
        """The part due to errors of the dynamics: W(s), or their own error where it is larger."""
        return max(self.uncertainty_percent, self.model_percent)

    @property
    def nrmse_percent(self) -> float:
        """Expected NRMSE: the simulated run, without a rig the spectra, with the other parts."""
        if self.simulated_nrmse_percent is None:
            return math.hypot(self.linear_nrmse_percent, self.hysteresis_percent)
        return math.hypot(
            self.simulated_nrmse_percent, self.dynamics_percent, self.hysteresis_percent)

    @property
    def interval(self) -> ErrorInterval:
        """Where the NRMSE is expected, percent."""
        known = self.by_place_percent
        if not known:
            linear = math.sqrt(max(
                self.linear_nrmse_percent**2 - self.uncertainty_percent**2, 0.0))
            known = (
                linear if self.simulated_nrmse_percent is None else self.simulated_nrmse_percent,)
        return error_interval(
            known, self.dynamics_percent, self.hysteresis_percent, self.unknown)

    @property
    def is_limited(self) -> bool:
        """Whether the amplifier reaches its slew limit, its average current or a rail."""
        return self.slew_limited or self.rail_limited or self.average_limited

    def record(self) -> dict[str, float | bool | list[float] | list[str] | None]:
        """Return every number under its name, for report.json and tables."""
        return {
            'harmonics': self.harmonics,
            'nrmse_percent': self.nrmse_percent,
            'linear_nrmse_percent': self.linear_nrmse_percent,
            'simulated_nrmse_percent': self.simulated_nrmse_percent,
            'truncation_percent': self.truncation_percent,
            'uncertainty_percent': self.uncertainty_percent,
            'model_percent': self.model_percent,
            'hysteresis_percent': self.hysteresis_percent,
            'noise_percent': self.noise_percent,
            'low_percent': self.interval.low_percent,
            'high_percent': self.interval.high_percent,
            'by_place_percent': list(self.by_place_percent),
            'unknown': list(self.unknown),
            'slew_v_per_s': self.slew_v_per_s,
            'slew_limited': self.slew_limited,
            'rail_limited': self.rail_limited,
            'average_limited': self.average_limited,
        }


def predict_tracking(
    model: Model | RigParameters,
    trajectory: TrajectoryParameters,
    controller: ControllerParameters,
    *,
    compensator: HysteresisParameters | None = None,
    uncertainty: Bound | None = None,
    score_periods: float = 4.0,
    accuracy: ModelAccuracy | None = None,
    every_place: bool = True,
) -> TrackingPrediction:
    """
    Return the error to expect of a run.

    Parameters
    ----------
    model : LinearDynamics, DynamicsFit, control.TransferFunction or RigParameters
        The best known model of the compensated actuator; the feedforward inverts the dynamics in
        ``trajectory``, which may differ. A rig (identified dynamics and hysteresis, slew limit
        and rails of the amplifier) is simulated too, with its poles before and behind the
        hysteresis; where ``hysteresis_place`` is ``'undecided'``, with every place.
    trajectory : TrajectoryParameters
        A waveform that repeats (triangle, sine, sawtooth, staircase, lissajous), with its
        feedforward and the sample period.
    controller : ControllerParameters
        Scheme, gains and delay of the measurement.
    compensator : HysteresisParameters, optional
        The hysteresis that the simulated run inverts; that of the rig by default.
    uncertainty : UncertaintyBound, control.TransferFunction or callable, optional
        W(s), or a measured |Delta| as a function of the frequency in hertz.
    score_periods : float, optional
        Periods at the end of the simulated run that are scored.
    accuracy : ModelAccuracy, optional
        What identification knows of the errors of hysteresis and dynamics.
    every_place : bool, optional
        Whether to simulate every place of the hysteresis where it is not decided.

    Returns
    -------
    TrackingPrediction
        The predicted error and its parts.

    Raises
    ------
    ParameterError
        If the waveform has no Fourier series.
    ValueError
        If a simulated run has fewer periods than are to be scored.

    """
    known = accuracy or ModelAccuracy()
    if not isinstance(model, RigParameters):
        return _by_spectra(model, trajectory, controller, uncertainty, known)
    prediction = _by_spectra(
        LinearDynamics(model.true_dynamics), trajectory, controller, uncertainty, known)
    prediction = _with_simulation(
        prediction, model, trajectory, controller, compensator or model, score_periods)
    others = placements(model)[1:] if every_place and model.order == 'physical' else ()
    by_place = [
        _with_simulation(
            prediction, other, trajectory, controller, compensator or model, score_periods,
        ).simulated_nrmse_percent
        for other in others if isinstance(other, RigParameters)]
    return replace(
        _with_residual(
            prediction, model, trajectory, known,
            has_integral=controller.uses_feedback and controller.integral_gain_per_s > 0.0),
        by_place_percent=tuple(
            percent for percent in (prediction.simulated_nrmse_percent, *by_place)
            if percent is not None) if by_place else ())


def _by_spectra(
    model: Model, trajectory: TrajectoryParameters, controller: ControllerParameters,
    uncertainty: Bound | None, accuracy: ModelAccuracy,
) -> TrackingPrediction:
    """Return the error of a linear rig, harmonic by harmonic."""
    period_s = trajectory.sample_period_s
    nyquist_harmonic = math.ceil(0.5 / (trajectory.fundamental_hz * period_s)) - 1
    highest = min(max(nyquist_harmonic, 1), _MOST_HARMONICS)
    all_amplitudes = fourier_amplitudes(trajectory, highest)
    order = np.flatnonzero(all_amplitudes) + 1
    amplitude = all_amplitudes[order - 1]
    frequency = np.asarray(order * trajectory.fundamental_hz, dtype=np.float64)
    # Without feedback the gains do not matter, but a loop needs some.
    gains = (controller.proportional_gain, controller.integral_gain_per_s)
    loop = PiLoop.of(
        model, *(gains if any(gains) else (1.0, 0.0)), period_s,
        controller.measurement_delay_samples, Lead.of(controller))
    feedforward = _feedforward_gain(trajectory, order) * amplitude * controller.uses_feedforward
    sensitivity: _Complexes = np.ones(order.size, dtype=np.complex128)
    command = feedforward
    if controller.uses_feedback and any(gains):
        sensitivity = loop.sensitivity(frequency)
        compared = amplitude * np.exp(
            -2j * np.pi * frequency * period_s * controller.reference_delay_samples)
        command = sensitivity * (feedforward + loop.controller_response(frequency) * compared)
    elif controller.scheme == 'open_loop':
        command = amplitude.astype(np.complex128)
    output = loop.plant_response(frequency) * command
    known = amplitude - output
    uncertain: _Floats = np.zeros(order.size)
    if uncertainty is not None:
        uncertain = np.abs(sensitivity * output) * bound_magnitude(uncertainty, frequency)
    model_error = np.abs(sensitivity * output) * accuracy.relative_error(frequency)

    def passed(low_hz: _Floats) -> _Floats:
        relative = np.abs(loop.plant_response(low_hz)) / abs(loop.plant.dc_gain)
        is_closed = controller.uses_feedback and any(gains)
        return relative * np.abs(loop.sensitivity(low_hz)) if is_closed else relative

    left_out_um2 = max(
        mean_square_um2(trajectory) - 0.5 * float(np.sum(amplitude**2)), 0.0)
    mean_gain, mean_sensitivity = _mean_gain(trajectory, controller, loop)
    passed_um = abs(trajectory.offset_um * mean_gain * mean_sensitivity)
    left_of_mean_um2 = (trajectory.offset_um * (1.0 - mean_gain)) ** 2
    # The model is as uncertain at 0 Hz as at the lowest frequency of the waveform.
    uncertain_mean_um2 = 0.0 if uncertainty is None else float(
        passed_um * bound_magnitude(uncertainty, frequency[:1])[0]) ** 2
    model_mean_um2 = float(passed_um * accuracy.relative_error(frequency[:1])[0]) ** 2

    def percent(amplitudes_um: _Floats, further_um2: float) -> float:
        mean_square = 0.5 * float(np.sum(amplitudes_um**2)) + further_um2
        return 100.0 * math.sqrt(mean_square) / (2.0 * trajectory.amplitude_um)

    return TrackingPrediction(
        scheme=controller.scheme, harmonics=trajectory.harmonics,
        linear_nrmse_percent=percent(
            np.hypot(np.abs(known), uncertain),
            left_out_um2 + left_of_mean_um2 + uncertain_mean_um2),
        truncation_percent=percent(np.abs(known[order > trajectory.harmonics]), left_out_um2),
        uncertainty_percent=percent(uncertain, uncertain_mean_um2),
        frequency_hz=frequency, reference_um=amplitude, known_error_um=known,
        uncertain_error_um=uncertain, model_percent=percent(model_error, model_mean_um2),
        unknown=accuracy.unknown(bound=uncertainty is not None),
        residual_gain=accuracy.residual_gain(trajectory.fundamental_hz, period_s, passed))


def _mean_gain(
    trajectory: TrajectoryParameters, controller: ControllerParameters, loop: PiLoop,
) -> tuple[float, float]:
    """Return the gain from the offset to the mean displacement, and the sensitivity at 0 Hz."""
    gain = loop.plant.dc_gain
    forward = 1.0 / trajectory.dc_gain if controller.uses_feedforward else 0.0
    if controller.uses_feedback and controller.integral_gain_per_s:
        return 1.0, 0.0
    if controller.uses_feedback:
        sensitivity = 1.0 / (1.0 + controller.proportional_gain * gain)
        return sensitivity * gain * (forward + controller.proportional_gain), sensitivity
    return gain * (1.0 if controller.scheme == 'open_loop' else forward), 1.0


def _feedforward_gain(
    trajectory: TrajectoryParameters, order: NDArray[np.int64],
) -> _Complexes:
    """Return U_k/A_k of (13) in Liu 2015."""
    model = LinearDynamics(trajectory)
    if trajectory.harmonics == 0:
        return np.full(order.size, 1.0 / trajectory.dc_gain, dtype=np.complex128)
    return np.where(
        order <= trajectory.harmonics, 1.0 / model.response(order * trajectory.fundamental_hz),
        0.0)


def _with_residual(
    prediction: TrackingPrediction, rig: RigParameters, trajectory: TrajectoryParameters,
    accuracy: ModelAccuracy, *, has_integral: bool,
) -> TrackingPrediction:
    """Return the prediction with what the hysteresis leaves and with the share of the noise."""
    assert prediction.voltage_maximum_v is not None
    assert prediction.voltage_minimum_v is not None
    amplitude_v = 0.5 * (prediction.voltage_maximum_v - prediction.voltage_minimum_v)
    residual_um = math.hypot(
        prediction.residual_gain * accuracy.residual_um(amplitude_v, rig.noise_rms_um),
        0.0 if has_integral else accuracy.loop_offset_um)
    percent_per_um = 100.0 / (2.0 * trajectory.amplitude_um)
    return replace(
        prediction, hysteresis_percent=percent_per_um * residual_um,
        noise_percent=percent_per_um * rig.noise_rms_um)


def _with_simulation(
    prediction: TrackingPrediction, rig: RigParameters, trajectory: TrajectoryParameters,
    controller: ControllerParameters, compensator: HysteresisParameters, score_periods: float,
) -> TrackingPrediction:
    """Return the prediction with the error of a simulated run and its demand on the amplifier."""
    if not 0.0 < score_periods <= trajectory.periods:
        raise ValueError(
            f'score_periods is {score_periods}, allowed is above 0 … {trajectory.periods} '
            '(periods of the trajectory)')
    run = simulate(rig, compensator, controller, trajectory)
    period_s = trajectory.sample_period_s
    count = min(trajectory.samples, max(2, math.floor(
        score_periods / (trajectory.frequency_hz * period_s) + _ROUNDING_SAMPLES)))
    error = run.reference_um[-count:] - run.displacement_um[:-1][-count:]
    voltage = run.voltage_v[-count:]
    slew = float(np.max(np.abs(np.diff(voltage)))) / period_s
    low = rig.voltage_minimum_v - rig.operating_point_v
    high = rig.voltage_maximum_v - rig.operating_point_v
    return replace(
        prediction,
        simulated_nrmse_percent=100.0 * float(np.sqrt(np.mean(error**2)))
        / float(np.ptp(run.reference_um[-count:])),
        slew_v_per_s=slew,
        voltage_minimum_v=float(voltage.min()),
        voltage_maximum_v=float(voltage.max()),
        slew_limited=0.0 < rig.slew_limit_v_per_s * (1.0 + _SLEW_TOLERANCE) < slew,
        rail_limited=bool(voltage.min() < low or voltage.max() > high),
        average_limited=0.0 < rig.average_slew_limit_v_per_s * (1.0 + _SLEW_TOLERANCE) < float(
            np.max(average_slew(voltage, rig.average_slew_time_s, period_s))))
