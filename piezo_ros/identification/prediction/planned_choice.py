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
A planned scan as one more candidate for an operating point.

The voltage of a plan has many more harmonics than the feedforward (13) in Liu 2015, up to the
resonance and beyond: it is as good as the model is there. So it is a candidate only where the error
of the dynamics is known, by W(s) or by what identification tells of its own model, and in the band
in which that is small.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control import TrajectoryParameters
from piezo_ros.identification.prediction.accuracy import ModelAccuracy
from piezo_ros.identification.prediction.operating_points import OperatingPoint
from piezo_ros.identification.prediction.placement import placements
from piezo_ros.identification.prediction.tracking import TrackingPrediction
from piezo_ros.identification.tuning.linear_plant import Bound, bound_magnitude
from piezo_ros.model import (
    DynamicsParameters,
    HysteresisParameters,
    LinearDynamics,
    RigParameters,
)
from piezo_ros.planning.harmonics import repeating_samples
from piezo_ros.planning.periodic_plan import PeriodicPlan
from piezo_ros.planning.scan import ScanRequest, limits_of, plan_for_rig, stage_of, with_bound

__all__ = ['PLANNED', 'PlannedChoice', 'plan_candidate', 'with_planned']

PLANNED: Final = 'planned'
# What takes long to plan is slow, and the feedforward (13) does well there.
_MOST_SAMPLES: Final = 2500
_MOST_HARMONICS: Final = 201
_Magnitude = Callable[[NDArray[np.float64]], NDArray[np.float64]]


class PlannedChoice(NamedTuple):
    """
    A planned scan with its prediction.

    Attributes
    ----------
    request : ScanRequest
        What was wanted.
    plan : PeriodicPlan
        The plan.
    prediction : TrackingPrediction
        The error to expect of a run of it.

    """

    request: ScanRequest
    plan: PeriodicPlan
    prediction: TrackingPrediction


def with_planned(point: OperatingPoint, choice: PlannedChoice | None) -> OperatingPoint:
    """Return an operating point with a planned scan among its candidates, where there is one."""
    if choice is None:
        return point
    return replace(point, predictions={**point.predictions, PLANNED: choice.prediction})


def plan_candidate(
    rig: RigParameters, trajectory: TrajectoryParameters, *, uncertainty: Bound | None = None,
    accuracy: ModelAccuracy | None = None,
) -> PlannedChoice | None:
    """
    Return the planned scan of an operating point, None where there is none to be trusted.

    Parameters
    ----------
    rig : RigParameters
        The rig as far as it is known, without mismatches.
    trajectory : TrajectoryParameters
        The scan, a triangle or a sine.
    uncertainty : UncertaintyBound, control.TransferFunction or callable, optional
        W(s), or a measured |Delta| as a function of the frequency in hertz.
    accuracy : ModelAccuracy, optional
        What identification knows of the errors of hysteresis and dynamics.

    """
    known = accuracy or ModelAccuracy()
    magnitude = _magnitude(uncertainty, known)
    if magnitude is None or rig.order != 'physical':
        return None
    try:
        samples = repeating_samples(trajectory.frequency_hz, trajectory.sample_period_s)
        if samples > _MOST_SAMPLES:
            return None
        request = ScanRequest(
            waveform=trajectory.waveform, amplitude_um=trajectory.amplitude_um,
            frequency_hz=trajectory.frequency_hz, sample_period_s=trajectory.sample_period_s,
            dynamics=DynamicsParameters.among(rig.to_mapping()),
            hysteresis=HysteresisParameters.among(rig.to_mapping()), limits=limits_of(rig),
            noise_rms_um=rig.noise_rms_um, offset_um=trajectory.offset_um,
            turn_fraction=trajectory.turn_fraction, flyback_fraction=trajectory.flyback_fraction)
        request = with_bound(replace(request, band_hz=min(
            request.band, (_MOST_HARMONICS + 0.5) * trajectory.frequency_hz)), magnitude)
        request, plan = plan_for_rig(request, rig)
    except ValueError:  # it does not repeat, or no voltage near to it keeps the limits
        return None
    prediction = _prediction(rig, plan, known, uncertainty is not None)
    return PlannedChoice(request, plan, _with_places(prediction, rig, request, plan))


def _with_places(
    prediction: TrackingPrediction, rig: RigParameters, request: ScanRequest, plan: PeriodicPlan,
) -> TrackingPrediction:
    """Return the prediction with every possible place of the hysteresis; the worst one counts."""
    percent = [plan.measured_nrmse_percent]
    for place in placements(rig)[1:]:
        other = replace(request, dynamics=DynamicsParameters.among(place.to_mapping()))
        moved = plan.with_coefficients(plan.coefficients_v, stage_of(other))
        percent.append(moved.measured_nrmse_percent)
    if len(percent) == 1:
        return prediction
    return replace(
        prediction, simulated_nrmse_percent=max(percent), by_place_percent=tuple(percent))


def _magnitude(uncertainty: Bound | None, accuracy: ModelAccuracy) -> _Magnitude | None:
    """Return |W| by frequency, the larger one of what is known; None where nothing is."""
    if uncertainty is None and accuracy.model_error is None:
        return None

    def magnitude(frequency_hz: NDArray[np.float64]) -> NDArray[np.float64]:
        error = accuracy.relative_error(frequency_hz)
        if uncertainty is None:
            return error
        return np.maximum(error, bound_magnitude(uncertainty, frequency_hz))

    return magnitude


def _prediction(
    rig: RigParameters, plan: PeriodicPlan, accuracy: ModelAccuracy, has_bound: bool,
) -> TrackingPrediction:
    voltage_v = plan.period_voltage_v
    span_um = float(np.ptp(plan.reference_um))
    residual_um = accuracy.residual_um(0.5 * float(np.ptp(voltage_v)), rig.noise_rms_um)
    dynamics = LinearDynamics(rig.true_dynamics)
    residual_um *= accuracy.residual_gain(
        plan.frequency_hz, plan.sample_period_s,
        lambda low_hz: np.abs(dynamics.response(low_hz) / dynamics.dc_gain))
    steps_v = np.abs(np.roll(voltage_v, -1) - voltage_v)
    nothing = np.zeros(0)
    return TrackingPrediction(
        scheme=PLANNED, harmonics=int(plan.orders[-1]),
        linear_nrmse_percent=plan.predicted_nrmse_percent,
        truncation_percent=plan.truncation_percent,
        uncertainty_percent=plan.accuracy.uncertainty_percent, frequency_hz=nothing,
        reference_um=nothing, known_error_um=nothing.astype(np.complex128),
        uncertain_error_um=nothing, simulated_nrmse_percent=plan.measured_nrmse_percent,
        slew_v_per_s=float(steps_v.max()) / plan.sample_period_s,
        voltage_minimum_v=float(voltage_v.min()), voltage_maximum_v=float(voltage_v.max()),
        hysteresis_percent=100.0 * residual_um / span_um, noise_percent=plan.noise_percent,
        unknown=accuracy.unknown(bound=has_bound))
