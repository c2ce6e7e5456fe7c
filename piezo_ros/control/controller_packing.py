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

"""State and constants of a controller in one flat array, see `piezo_ros.model.packing`."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.controller_step import ControllerConstants, ControllerState
from piezo_ros.model.step import step

__all__ = ['CONSTANTS', 'packed_controller', 'unpacked_controller', 'unpacked_state']

CONSTANTS = len(ControllerConstants._fields)  # of the array, at its beginning
_MEASURED = CONSTANTS + 6  # where the measurements begin, behind `ControllerState.memory`


def packed_controller(
    state: ControllerState, constants: ControllerConstants,
) -> NDArray[np.float64]:
    """Return state and constants of a controller as `unpacked_controller` takes them."""
    return np.array(
        [*constants, *state.memory, *state.measured_um, *state.reference_um], dtype=np.float64)


@step
def unpacked_state(memory: Any) -> ControllerState:
    """Return the state of a controller as views of its memory."""
    end = _MEASURED + int(memory[7])
    return ControllerState(
        memory[CONSTANTS:_MEASURED], memory[_MEASURED:end], memory[end:])


@step
def unpacked_controller(memory: Any) -> tuple[ControllerState, ControllerConstants]:
    """Return state and constants of a controller as views of its memory."""
    constants = ControllerConstants(
        memory[0] > 0.0, memory[1] > 0.0, memory[2], memory[3], memory[4], memory[5],
        int(memory[6]), int(memory[7]), memory[8], memory[9], memory[10])
    return unpacked_state(memory), constants
