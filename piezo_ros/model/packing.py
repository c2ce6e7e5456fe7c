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
State and constants of an element in one flat array, for compiled code.

What a compiled call costs is handing its arguments over: one array instead of several dozen. The
kernel takes it apart again, into the named tuples that the steps know, as views of the array.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros.model.converter import ConverterConstants
from piezo_ros.model.creep import NO_CREEP, CreepConstants
from piezo_ros.model.effects.load import NO_LOAD, STATE_SIZE, LoadConstants
from piezo_ros.model.hysteresis import AsymmetryConstants, HysteresisConstants, state_size
from piezo_ros.model.rig import RigConstants, RigState
from piezo_ros.model.state_space import LinearConstants
from piezo_ros.model.step import step

__all__ = [
    'packed_creep',
    'packed_inverse',
    'packed_inverse_creep',
    'packed_load',
    'packed_rig',
    'unpacked_inverse',
    'unpacked_rig',
    'unpacked_state',
]


def packed_rig(state: RigState, constants: RigConstants) -> NDArray[np.float64]:
    """Return state and constants of a rig as `unpacked_rig` takes them."""
    sizes = [
        len(constants.hysteresis.width_um), len(state.before), len(state.behind),
        len(state.relaxed_um), len(state.delayed_v)]
    # Always there, so that a kernel with all effects takes any rig.
    constants = constants._replace(
        creep=constants.creep or NO_CREEP, load=constants.load or NO_LOAD)
    return _packed(sizes, state, constants)


def packed_inverse(
    state: Any, constants: HysteresisConstants, relaxed_um: Any = (),
    creep: CreepConstants | None = None,
) -> NDArray[np.float64]:
    """Return state and constants of an inverse model as `unpacked_inverse` takes them."""
    creep = creep or NO_CREEP
    return _packed(
        [len(constants.width_um)], state, constants, list(relaxed_um), creep, [len(creep.rate)])


def _packed(sizes: list[int], *contents: Any) -> NDArray[np.float64]:
    numbers: list[float] = [*sizes]
    _append(numbers, contents)
    return np.array(numbers, dtype=np.float64)


def _append(numbers: list[float], value: tuple[Any, ...]) -> None:
    """Append the numbers of nested named tuples and of lists, depth first; none of None."""
    for element in value:
        kind = type(element)
        if kind is float:
            numbers.append(element)
        elif kind is list:
            numbers.extend(element)
        elif isinstance(element, tuple):
            if isinstance(element, AsymmetryConstants):
                numbers.append(float(len(element.threshold_um)))
            _append(numbers, element)
        elif element is not None:
            numbers.append(float(element))


@step
def packed_creep(memory: Any) -> CreepConstants:
    """Return the creep in the memory of a rig, none where it has none."""
    relaxations, end = int(memory[3]), len(memory) - 5
    return CreepConstants(
        memory[end - 2 * relaxations:end - relaxations], memory[end - relaxations:end],
        memory[end])


@step
def packed_load(memory: Any) -> LoadConstants:
    """Return average current and self-heating in the memory of a rig, none where it has none."""
    end = len(memory)
    return LoadConstants(memory[end - 4], memory[end - 3], memory[end - 2], memory[end - 1])


@step
def packed_inverse_creep(memory: Any) -> tuple[Any, CreepConstants]:
    """Return relaxations and creep in the memory of an inverse model, none where it has none."""
    end = len(memory) - 2
    relaxations = int(memory[end + 1])
    return memory[end - 3 * relaxations:end - 2 * relaxations], CreepConstants(
        memory[end - 2 * relaxations:end - relaxations], memory[end - relaxations:end],
        memory[end])


@step
def unpacked_state(memory: Any) -> RigState:
    """Return the state of a rig as views of its memory."""
    elements, order_before, order_behind = int(memory[0]), int(memory[1]), int(memory[2])
    relaxations, delayed = int(memory[3]), int(memory[4])
    before_at = 10
    hysteresis_at = before_at + order_before
    behind_at = hysteresis_at + state_size(elements)
    displacement_at = behind_at + order_behind
    load_at = displacement_at + 1
    relaxed_at = load_at + STATE_SIZE
    drift_at = relaxed_at + relaxations
    delayed_at = drift_at + 1
    scratch_at = delayed_at + delayed
    return RigState(
        memory[5:before_at], memory[before_at:hysteresis_at],
        memory[hysteresis_at:behind_at], memory[behind_at:displacement_at],
        memory[displacement_at:load_at], memory[load_at:relaxed_at], memory[relaxed_at:drift_at],
        memory[drift_at:delayed_at], memory[delayed_at:scratch_at],
        memory[scratch_at:scratch_at + max(order_before, order_behind)])


@step
def unpacked_rig(
    memory: Any, creep: CreepConstants | None, load: LoadConstants | None,
) -> tuple[RigState, RigConstants]:
    """Return state and constants of a rig as views of its memory."""
    elements, order_before, order_behind = int(memory[0]), int(memory[1]), int(memory[2])
    at = (
        12 + STATE_SIZE + order_before + state_size(elements) + order_behind + int(memory[3])
        + int(memory[4]) + max(order_before, order_behind))
    state = unpacked_state(memory)
    dac = _converter_at(memory, at)
    slew_step_v = memory[at + 4]
    at += 5
    before = _linear_at(memory, at, order_before)
    at += order_before * (order_before + 2) + 1
    hysteresis = _hysteresis_at(memory, at, elements)
    at += _hysteresis_size(memory, at, elements)
    behind = _linear_at(memory, at, order_behind)
    at += order_behind * (order_behind + 2) + 1
    return state, RigConstants(
        dac, slew_step_v, before, hysteresis, behind, memory[at] > 0.0, memory[at + 1],
        _converter_at(memory, at + 2), int(memory[at + 6]), int(memory[at + 7]),
        int(memory[at + 8]), creep, load)


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
    map_at = at + 3 * elements + 5
    knots = int(memory[map_at - 1])
    return HysteresisConstants(
        memory[at:at + elements], memory[at + elements:at + 2 * elements],
        memory[at + 2 * elements:at + 3 * elements], memory[at + 3 * elements],
        memory[at + 3 * elements + 1], memory[at + 3 * elements + 2], memory[at + 3 * elements + 3],
        AsymmetryConstants(
            memory[map_at:map_at + knots], memory[map_at + knots:map_at + 2 * knots],
            memory[map_at + 2 * knots:map_at + 3 * knots],
            memory[map_at + 3 * knots:map_at + 4 * knots]))


@step
def _hysteresis_size(memory: Any, at: int, elements: int) -> int:
    """Return how many numbers the constants of a hysteresis take, the size of their map too."""
    return 3 * elements + 5 + 4 * int(memory[at + 3 * elements + 4])
