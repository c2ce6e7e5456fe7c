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

"""Compiled array kernels of the model: the shared steps over whole arrays."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros.model import creep, hysteresis, packing, rig
from piezo_ros.model.compiled import brief_kernel, kernel

__all__ = [
    'creep_inverse_packed_array',
    'forward_array',
    'full_rig_array',
    'inverse_array',
    'inverse_packed_array',
    'rig_array',
]

_compensation_step = hysteresis.compensation_step
_hysteresis_step = hysteresis.hysteresis_step
_inverse_creep_step = creep.inverse_creep_step
_packed_creep = packing.packed_creep
_packed_inverse_creep = packing.packed_inverse_creep
_packed_load = packing.packed_load
_sample_step = rig.sample_step
_settle_step = hysteresis.settle_step
_unpacked_inverse = packing.unpacked_inverse
_unpacked_rig = packing.unpacked_rig


@kernel
def forward_array(
    state: NDArray[np.float64], constants: Any, voltage_v: NDArray[np.float64],
    displacement_um: NDArray[np.float64],
) -> None:
    """Fill ``displacement_um`` and leave the last plays in ``state``."""
    for k in range(voltage_v.size):
        displacement_um[k] = _hysteresis_step(state, constants, voltage_v[k])
    _settle_step(state, constants)


@kernel
def inverse_array(
    state: NDArray[np.float64], constants: Any, displacement_um: NDArray[np.float64],
    voltage_v: NDArray[np.float64],
) -> None:
    """Fill ``voltage_v`` and leave the last plays in ``state``."""
    for k in range(displacement_um.size):
        voltage_v[k] = _compensation_step(state, constants, displacement_um[k])
    _settle_step(state, constants)


@brief_kernel
def rig_array(
    memory: NDArray[np.float64], voltage_v: NDArray[np.float64], noise: NDArray[np.float64],
    displacement_um: NDArray[np.float64],
) -> None:
    """Fill ``displacement_um`` with the readings; the state in ``memory`` moves on."""
    state, constants = _unpacked_rig(memory, None, None)
    for k in range(voltage_v.size):
        displacement_um[k] = _sample_step(state, constants, voltage_v[k], noise[k])


@brief_kernel
def full_rig_array(
    memory: NDArray[np.float64], voltage_v: NDArray[np.float64], noise: NDArray[np.float64],
    displacement_um: NDArray[np.float64],
) -> None:
    """Do as `rig_array` for a rig with creep, drift, average current limit or self-heating."""
    state, constants = _unpacked_rig(memory, _packed_creep(memory), _packed_load(memory))
    for k in range(voltage_v.size):
        displacement_um[k] = _sample_step(state, constants, voltage_v[k], noise[k])


@brief_kernel
def inverse_packed_array(
    memory: NDArray[np.float64], displacement_um: NDArray[np.float64],
    voltage_v: NDArray[np.float64],
) -> None:
    """Fill ``voltage_v``; the state in ``memory`` moves on."""
    state, constants = _unpacked_inverse(memory)
    for k in range(displacement_um.size):
        voltage_v[k] = _compensation_step(state, constants, displacement_um[k])


@brief_kernel
def creep_inverse_packed_array(
    memory: NDArray[np.float64], displacement_um: NDArray[np.float64],
    voltage_v: NDArray[np.float64],
) -> None:
    """Do as `inverse_packed_array` for an inverse model with creep."""
    state, constants = _unpacked_inverse(memory)
    relaxed_um, creep_constants = _packed_inverse_creep(memory)
    for k in range(displacement_um.size):
        voltage_v[k] = _compensation_step(
            state, constants,
            _inverse_creep_step(relaxed_um, creep_constants, displacement_um[k]))
