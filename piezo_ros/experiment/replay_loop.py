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

"""The loop closed offline around a given reference and feedforward, with the steps of the nodes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control import ClosedLoopRun, ControllerParameters, controller
from piezo_ros.control.changes import Change, segments
from piezo_ros.model import HysteresisParameters, RigParameters, hysteresis, rig
from piezo_ros.model.compiled import kernel
from piezo_ros.model.noise import unit_noise

__all__ = ['run_loop']

_controller_step = controller.controller_step
_inverse_step = hysteresis.inverse_step
_measure_step = rig.measure_step
_rig_step = rig.rig_step


def run_loop(
    plant: RigParameters,
    compensator: HysteresisParameters,
    law: ControllerParameters,
    sample_period_s: float,
    reference_um: NDArray[np.float64],
    feedforward_um: NDArray[np.float64],
    changes: Sequence[Change] = (),
) -> ClosedLoopRun:
    """
    Return every stream of a run; bit for bit what the live graph gives for the same two streams.

    Parameters
    ----------
    plant : RigParameters
        The rig, at rest and never driven.
    compensator : HysteresisParameters
        The hysteresis that the compensator inverts.
    law : ControllerParameters
        Gains and scheme.
    sample_period_s : float
        Sample period, seconds.
    reference_um, feedforward_um : ndarray, shape (N,)
        What the trajectory sends.
    changes : sequence of Change, optional
        Changes of gains and scheme during the run.

    """
    samples = reference_um.size
    run = ClosedLoopRun(
        np.array(reference_um), np.array(feedforward_um),
        np.empty(samples), np.empty(samples), np.empty(samples + 1))
    constants = rig.rig_constants(plant, sample_period_s)
    memory = controller.initial_state(law, np.array)
    inverse_state = np.array(hysteresis.hysteresis_state([0.0] * len(compensator.saturation_v)))
    inverse = rig.as_arrays(hysteresis.hysteresis_constants(compensator))
    stage, stage_constants = rig.initial_state(constants, np.array), rig.as_arrays(constants)
    noise = unit_noise(plant.seed, 0, samples + 1)
    for start, stop, piece in segments(law, changes, samples):
        if start:
            controller.prepare_transfer(memory)
        _loop(
            memory, rig.as_arrays(controller.controller_constants(piece, sample_period_s)),
            inverse_state, inverse, stage, stage_constants, noise, run, start, stop)
    return run


@kernel
def _loop(
    controller_state: Any, controller_constants: Any, compensator_state: NDArray[np.float64],
    compensator_constants: Any, rig_state: Any, rig_constants: Any, noise: NDArray[np.float64],
    run: Any, start: int, stop: int,
) -> None:
    """Close the loop from one sample to another, over what the arrays of a run hold before it."""
    if start == 0:
        run.displacement_um[0] = _measure_step(
            rig_constants, rig_state.displacement_um[0], noise[0])
    measured_um = run.displacement_um[start]
    for k in range(start, stop):
        command_um = _controller_step(
            controller_state, controller_constants, k, run.reference_um[k], run.feedforward_um[k],
            measured_um)
        voltage_v = _inverse_step(compensator_state, compensator_constants, command_um)
        true_um = _rig_step(rig_state, rig_constants, voltage_v)
        measured_um = _measure_step(rig_constants, true_um, noise[k + 1])
        run.command_um[k] = command_um
        run.voltage_v[k] = voltage_v
        run.displacement_um[k + 1] = measured_um
