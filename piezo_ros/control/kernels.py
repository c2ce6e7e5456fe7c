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

"""Compiled array kernels of the control tier: trajectories and whole closed-loop runs."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control import controller, stepping, trajectory
from piezo_ros.model import hysteresis, rig
from piezo_ros.model.compiled import kernel

__all__ = ['closed_loop', 'controller_packed_array', 'trajectory_array']

_controller_packed = stepping.controller_packed
_controller_step = controller.controller_step
_inverse_step = hysteresis.inverse_step
_measure_step = rig.measure_step
_rig_step = rig.rig_step
_trajectory_step = trajectory.trajectory_step


@kernel
def closed_loop(
    trajectory_constants: Any, controller_state: Any, controller_constants: Any,
    compensator_state: NDArray[np.float64], compensator_constants: Any,
    rig_state: Any, rig_constants: Any, noise: NDArray[np.float64], run: Any,
    start: int, stop: int,
) -> None:
    """Fill the streams of ``run`` from one sample to another; the states move on with them."""
    if start == 0:
        run.displacement_um[0] = _measure_step(
            rig_constants, rig_state.displacement_um[0], noise[0])
    measured_um = run.displacement_um[start]
    for k in range(start, stop):
        reference_um, feedforward_um = _trajectory_step(trajectory_constants, k)
        command_um = _controller_step(
            controller_state, controller_constants, k, reference_um, feedforward_um, measured_um)
        voltage_v = _inverse_step(compensator_state, compensator_constants, command_um)
        true_um = _rig_step(rig_state, rig_constants, voltage_v)
        measured_um = _measure_step(rig_constants, true_um, noise[k + 1])
        run.reference_um[k] = reference_um
        run.feedforward_um[k] = feedforward_um
        run.command_um[k] = command_um
        run.voltage_v[k] = voltage_v
        run.displacement_um[k + 1] = measured_um


@kernel
def trajectory_array(
    constants: Any, start: int, reference_um: NDArray[np.float64],
    feedforward_um: NDArray[np.float64],
) -> None:
    """Fill both streams from the sample ``start`` on."""
    for k in range(reference_um.size):
        reference_um[k], feedforward_um[k] = _trajectory_step(constants, start + k)


@kernel
def controller_packed_array(
    packed: NDArray[np.float64], start: int, reference_um: NDArray[np.float64],
    feedforward_um: NDArray[np.float64], command_um: NDArray[np.float64],
) -> None:
    """Fill ``command_um`` from sample ``start`` on, without feedback; the state moves on."""
    for k in range(reference_um.size):
        command_um[k] = _controller_packed(
            packed, start + k, reference_um[k], feedforward_um[k], 0.0)
