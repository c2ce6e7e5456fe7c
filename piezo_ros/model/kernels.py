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

from piezo_ros.model import hysteresis, rig, stepping
from piezo_ros.model.compiled import kernel

__all__ = [
    'forward_array',
    'hold_packed_array',
    'hold_packed_creeping_array',
    'hold_packed_creeping_kernel',
    'hold_packed_kernel',
    'inverse_array',
    'inverse_packed_array',
    'inverse_packed_kernel',
    'rig_array',
]

_forward_step = hysteresis.forward_step
_inverse_step = hysteresis.inverse_step
_measure_step = rig.measure_step
_rig_step = rig.rig_step
_settle_step = hysteresis.settle_step
_hold_packed = stepping.hold_packed
_hold_packed_creeping = stepping.hold_packed_creeping
_inverse_packed = stepping.inverse_packed
_packed_creep = stepping.packed_creep
_unpacked_inverse = stepping.unpacked_inverse
_unpacked_rig = stepping.unpacked_rig


@kernel
def forward_array(
    state: NDArray[np.float64], constants: Any, voltage_v: NDArray[np.float64],
    displacement_um: NDArray[np.float64],
) -> None:
    """Fill ``displacement_um`` and leave the last plays in ``state``."""
    for k in range(voltage_v.size):
        displacement_um[k] = _forward_step(state, constants, voltage_v[k])
    _settle_step(state, constants)


@kernel
def inverse_array(
    state: NDArray[np.float64], constants: Any, displacement_um: NDArray[np.float64],
    voltage_v: NDArray[np.float64],
) -> None:
    """Fill ``voltage_v`` and leave the last plays in ``state``."""
    for k in range(displacement_um.size):
        voltage_v[k] = _inverse_step(state, constants, displacement_um[k])
    _settle_step(state, constants)


@kernel
def rig_array(
    state: Any, constants: Any, voltage_v: NDArray[np.float64], noise: NDArray[np.float64],
    displacement_um: NDArray[np.float64],
) -> None:
    """Fill ``displacement_um`` with the readings and move the state on."""
    for k in range(voltage_v.size):
        true_um = _rig_step(state, constants, voltage_v[k])
        displacement_um[k] = _measure_step(constants, true_um, noise[k])


@kernel
def hold_packed_kernel(
    memory: NDArray[np.float64], voltage_v: float, unit_noise: float,
) -> float:
    """Hold a voltage for one sample period and return the reading at its end."""
    return _hold_packed(memory, voltage_v, unit_noise)


@kernel
def hold_packed_creeping_kernel(
    memory: NDArray[np.float64], voltage_v: float, unit_noise: float,
) -> float:
    """Hold a voltage as `hold_packed_kernel` does, on a rig with creep or drift."""
    return _hold_packed_creeping(memory, voltage_v, unit_noise)


@kernel
def inverse_packed_kernel(memory: NDArray[np.float64], displacement_um: float) -> float:
    """Return the voltage of one displacement."""
    return _inverse_packed(memory, displacement_um)


@kernel
def inverse_packed_array(
    memory: NDArray[np.float64], displacement_um: NDArray[np.float64],
    voltage_v: NDArray[np.float64],
) -> None:
    """Fill ``voltage_v``; the state in ``memory`` moves on."""
    state, constants = _unpacked_inverse(memory)
    for k in range(displacement_um.size):
        voltage_v[k] = _inverse_step(state, constants, displacement_um[k])


@kernel
def hold_packed_array(
    memory: NDArray[np.float64], voltage_v: NDArray[np.float64], noise: NDArray[np.float64],
    displacement_um: NDArray[np.float64],
) -> None:
    """Fill ``displacement_um`` with the readings; the state in ``memory`` moves on."""
    state, constants = _unpacked_rig(memory, None)
    rig_array(state, constants, voltage_v, noise, displacement_um)


@kernel
def hold_packed_creeping_array(
    memory: NDArray[np.float64], voltage_v: NDArray[np.float64], noise: NDArray[np.float64],
    displacement_um: NDArray[np.float64],
) -> None:
    """Do as `hold_packed_array` for a rig with creep or drift."""
    state, constants = _unpacked_rig(memory, _packed_creep(memory))
    rig_array(state, constants, voltage_v, noise, displacement_um)
