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

"""Compiled array kernels of the control tier: trajectories, the controller, the closed loop."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control import controller_packing, controller_step, trajectory_step
from piezo_ros.model import creep, hysteresis, packing, rig
from piezo_ros.model.compiled import brief_kernel, kernel
from piezo_ros.model.step import step

__all__ = ['closed_loop', 'controller_array', 'full_closed_loop', 'trajectory_array']

_controller_step = controller_step.controller_step
_compensation_step = hysteresis.compensation_step
_inverse_creep_step = creep.inverse_creep_step
_packed_creep = packing.packed_creep
_packed_inverse_creep = packing.packed_inverse_creep
_packed_load = packing.packed_load
_sample_step = rig.sample_step
_trajectory_step = trajectory_step.trajectory_step
_unpacked_controller = controller_packing.unpacked_controller
_unpacked_inverse = packing.unpacked_inverse
_unpacked_rig = packing.unpacked_rig


@kernel
def trajectory_array(
    constants: Any, start: int, reference_um: NDArray[np.float64],
    feedforward_um: NDArray[np.float64],
) -> None:
    """Fill both streams from the sample ``start`` on."""
    for k in range(reference_um.size):
        reference_um[k], feedforward_um[k] = _trajectory_step(constants, start + k)


@brief_kernel
def controller_array(
    memory: NDArray[np.float64], start: int, reference_um: NDArray[np.float64],
    feedforward_um: NDArray[np.float64], displacement_um: NDArray[np.float64],
    command_um: NDArray[np.float64],
) -> None:
    """Fill ``command_um`` from sample ``start`` on; the state in ``memory`` moves on."""
    state, constants = _unpacked_controller(memory)
    for k in range(reference_um.size):
        command_um[k] = _controller_step(
            state, constants, start + k, reference_um[k], feedforward_um[k], displacement_um[k])


@step
def _close_loop(
    controller_memory: Any, inverse_memory: Any, relaxed_um: Any, inverse_creep: Any,
    rig_state: Any, rig_constants: Any, noise: Any, run: Any, start: int, stop: int,
) -> None:
    controller_state, controller_constants = _unpacked_controller(controller_memory)
    inverse_state, inverse_constants = _unpacked_inverse(inverse_memory)
    measured_um = run.displacement_um[start]
    for k in range(start, stop):
        command_um = _controller_step(
            controller_state, controller_constants, k, run.reference_um[k], run.feedforward_um[k],
            measured_um)
        voltage_v = _compensation_step(
            inverse_state, inverse_constants,
            _inverse_creep_step(relaxed_um, inverse_creep, command_um))
        measured_um = _sample_step(rig_state, rig_constants, voltage_v, noise[k + 1])
        run.command_um[k] = command_um
        run.voltage_v[k] = voltage_v
        run.displacement_um[k + 1] = measured_um


@kernel
def closed_loop(
    controller_memory: NDArray[np.float64], inverse_memory: NDArray[np.float64],
    rig_memory: NDArray[np.float64], noise: NDArray[np.float64], run: Any, start: int, stop: int,
) -> None:
    """Close the loop from one sample to another, over what a run has before it in its arrays."""
    state, constants = _unpacked_rig(rig_memory, None, None)
    _close_loop(
        controller_memory, inverse_memory, inverse_memory[0:0], None, state, constants, noise, run,
        start, stop)


@kernel
def full_closed_loop(
    controller_memory: NDArray[np.float64], inverse_memory: NDArray[np.float64],
    rig_memory: NDArray[np.float64], noise: NDArray[np.float64], run: Any, start: int, stop: int,
) -> None:
    """Do as `closed_loop` where a rig has effects of its own, or the inverse model has creep."""
    state, constants = _unpacked_rig(
        rig_memory, _packed_creep(rig_memory), _packed_load(rig_memory))
    relaxed_um, inverse_creep = _packed_inverse_creep(inverse_memory)
    _close_loop(
        controller_memory, inverse_memory, relaxed_um, inverse_creep, state, constants, noise, run,
        start, stop)
