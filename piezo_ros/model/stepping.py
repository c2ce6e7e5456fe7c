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
The rig and the inverse hysteresis one sample at a time, in Python or behind one compiled call.

What a compiled call costs is handing its arguments over, so that all constants and all state travel
as one flat array each and are taken apart again inside. The steps are the same either way, and so
are the bits.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros.model.converter import ConverterConstants
from piezo_ros.model.creep import CreepConstants
from piezo_ros.model.hysteresis import (
    HysteresisConstants,
    HysteresisParameters,
    hysteresis_constants,
    hysteresis_state,
    inverse_step,
    state_size,
)
from piezo_ros.model.rig import (
    RigConstants,
    RigParameters,
    RigState,
    initial_state,
    measure_step,
    rig_constants,
    rig_step,
)
from piezo_ros.model.state_space import LinearConstants
from piezo_ros.model.step import step

__all__ = [
    'compensator_stepper',
    'hold_packed',
    'hold_packed_creeping',
    'inverse_packed',
    'packed_creep',
    'packed_memory',
    'rig_stepper',
    'saturated_samples',
    'unpacked_inverse',
    'unpacked_rig',
]


def rig_stepper(
    parameters: RigParameters, sample_period_s: float, *, compiled: bool = False,
) -> Callable[[float, float], float]:
    """
    Return a rig at rest at its operating point as a function.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    sample_period_s : float
        Sample period, seconds.
    compiled : bool
        Whether to import the compiler; quicker per sample, slower to start.

    Returns
    -------
    callable
        Takes the voltage to hold for one sample period and the unit noise of the reading, and
        returns the reading at its end, micrometres.

    """
    constants = rig_constants(parameters, sample_period_s)
    state = initial_state(constants)
    if compiled:
        from piezo_ros.model.kernels import hold_packed_creeping_kernel, hold_packed_kernel
        sizes = [
            len(constants.hysteresis.width_um), len(state.amplifier), len(state.mechanics),
            len(state.relaxed_um)]
        packed = hold_packed_creeping_kernel if constants.creep else hold_packed_kernel
        return _bound(packed, sizes, 2, state, constants)

    return partial(_hold, state, constants)


def _hold(
    state: RigState, constants: RigConstants, voltage_v: float, unit_noise: float,
) -> float:
    return measure_step(constants, rig_step(state, constants, voltage_v), unit_noise)


def saturated_samples(stepper: Any) -> tuple[int, int]:
    """Return how many samples a rig's stepper has held beyond a rail, and how many slewing."""
    memory = stepper.args[0]
    drive_v = memory.drive_v if isinstance(memory, RigState) else memory[4:7]
    return int(drive_v[1]), int(drive_v[2])


def compensator_stepper(
    parameters: HysteresisParameters, *, compiled: bool = False,
) -> Callable[[float], float]:
    """
    Return the inverse model of a virgin stage as a function.

    Parameters
    ----------
    parameters : HysteresisParameters
        The hysteresis to invert.
    compiled : bool
        Whether to import the compiler; quicker per sample, slower to start.

    Returns
    -------
    callable
        Takes a displacement, micrometres, and returns its voltage, volts.

    """
    constants = hysteresis_constants(parameters)
    elements = len(constants.width_um)
    state = hysteresis_state([0.0] * elements)
    if compiled:
        from piezo_ros.model.kernels import inverse_packed_kernel
        return _bound(inverse_packed_kernel, [elements], 1, state, constants)

    def inverse(displacement_um: float) -> float:
        return inverse_step(state, constants, displacement_um)

    return inverse


def _bound(kernel: Any, sizes: list[int], numbers: int, *contents: Any) -> Callable[..., float]:
    """Return a kernel of packed state and constants as a function of numbers alone."""
    from piezo_ros.model.compiled import direct
    memory = np.array([*sizes, *_flat(contents)], dtype=np.float64)
    return partial(direct(kernel, memory, *[0.0] * numbers), memory)


def packed_memory(stepper: Any) -> NDArray[np.float64]:
    """Return the state and constants of a compiled stepper, as its kernel takes them."""
    return stepper.args[0]  # type: ignore[no-any-return]


def _flat(value: Any) -> list[float]:
    """Return the numbers of nested named tuples and lists, depth first; none of None."""
    if value is None:
        return []
    if isinstance(value, list | tuple):
        return [number for element in value for number in _flat(element)]
    return [float(value)]


@step
def hold_packed(memory: Any, voltage_v: float, unit_noise: float) -> float:
    """Take a rig without creep and its state apart, do what `rig_stepper` says."""
    state, constants = unpacked_rig(memory, None)
    return measure_step(constants, rig_step(state, constants, voltage_v), unit_noise)


@step
def hold_packed_creeping(memory: Any, voltage_v: float, unit_noise: float) -> float:
    """Take a rig with creep or drift and its state apart, do what `rig_stepper` says."""
    state, constants = unpacked_rig(memory, packed_creep(memory))
    return measure_step(constants, rig_step(state, constants, voltage_v), unit_noise)


@step
def packed_creep(memory: Any) -> CreepConstants:
    """Return the creep in the memory of a rig that has one."""
    relaxations, end = int(memory[3]), len(memory) - 1
    return CreepConstants(
        memory[end - 2 * relaxations:end - relaxations], memory[end - relaxations:end],
        memory[end])


@step
def unpacked_rig(
    memory: Any, creep: CreepConstants | None,
) -> tuple[RigState, RigConstants]:
    """Return state and constants of a rig as views of its memory."""
    elements, first_order, second_order = int(memory[0]), int(memory[1]), int(memory[2])
    relaxations = int(memory[3])
    amplifier_at = 7
    hysteresis_at = amplifier_at + first_order
    mechanics_at = hysteresis_at + state_size(elements)
    displacement_at = mechanics_at + second_order
    relaxed_at = displacement_at + 1
    drift_at = relaxed_at + relaxations
    scratch_at = drift_at + 1
    at = scratch_at + 5
    state = RigState(
        memory[4:amplifier_at], memory[amplifier_at:hysteresis_at],
        memory[hysteresis_at:mechanics_at], memory[mechanics_at:displacement_at],
        memory[displacement_at:relaxed_at], memory[relaxed_at:drift_at],
        memory[drift_at:scratch_at], memory[scratch_at:at])
    dac = _converter_at(memory, at)
    slew_step_v = memory[at + 4]
    at += 5
    amplifier = _linear_at(memory, at, first_order)
    at += first_order * (first_order + 2) + 1
    hysteresis = _hysteresis_at(memory, at, elements)
    at += 3 * elements + 4
    mechanics = _linear_at(memory, at, second_order)
    at += second_order * (second_order + 2) + 1
    return state, RigConstants(
        dac, slew_step_v, amplifier, hysteresis, mechanics, memory[at] > 0.0, memory[at + 1],
        _converter_at(memory, at + 2), creep)


@step
def inverse_packed(memory: Any, displacement_um: float) -> float:
    """Take inverse model and state apart, do what `compensator_stepper` says."""
    state, constants = unpacked_inverse(memory)
    return inverse_step(state, constants, displacement_um)


@step
def unpacked_inverse(memory: Any) -> tuple[Any, HysteresisConstants]:
    """Return state and constants of an inverse model as views of its memory."""
    elements = int(memory[0])
    constants_at = 1 + state_size(elements)
    return memory[1:constants_at], _hysteresis_at(memory, constants_at, elements)


@step
def _converter_at(memory: Any, at: int) -> ConverterConstants:
    return ConverterConstants(memory[at], memory[at + 1], memory[at + 2], memory[at + 3])


@step
def _linear_at(memory: Any, at: int, order: int) -> LinearConstants:
    square = order * order
    return LinearConstants(
        memory[at:at + square], memory[at + square:at + square + order],
        memory[at + square + order:at + square + 2 * order], memory[at + square + 2 * order])


@step
def _hysteresis_at(memory: Any, at: int, elements: int) -> HysteresisConstants:
    return HysteresisConstants(
        memory[at:at + elements], memory[at + elements:at + 2 * elements],
        memory[at + 2 * elements:at + 3 * elements], memory[at + 3 * elements],
        memory[at + 3 * elements + 1], memory[at + 3 * elements + 2], memory[at + 3 * elements + 3])
