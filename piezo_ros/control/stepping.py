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
The controller one sample at a time behind a compiled call: state and constants in one flat array.

See `piezo_ros.model.stepping`, which does the same for the rig and the inverse hysteresis.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.controller import (
    ControllerConstants,
    ControllerParameters,
    ControllerState,
    controller_step,
    initial_state,
)
from piezo_ros.model.step import step

__all__ = ['PackedController', 'controller_packed']

_CONSTANTS = len(ControllerConstants._fields)
_MEMORY = 3


class PackedController:
    """
    A controller at rest whose state and constants lie in one array.

    Parameters
    ----------
    parameters : ControllerParameters
        The controller; what it remembers has the size that these give it.

    Attributes
    ----------
    packed : ndarray of float64
        The constants, then the state; what `controller_packed` takes.
    state : ControllerState
        Views of the state therein: `controller_step` may go on where a compiled call left off.

    """

    def __init__(self, parameters: ControllerParameters) -> None:
        start = initial_state(parameters)
        self.packed = np.array(
            [*[0.0] * _CONSTANTS, *start.memory, *start.measured_um], dtype=np.float64)
        at = _CONSTANTS + _MEMORY
        self.state = ControllerState(self.packed[_CONSTANTS:at], self.packed[at:])

    def use(self, constants: ControllerConstants) -> None:
        """Take over other constants from the next sample on."""
        self.packed[:_CONSTANTS] = constants


@step
def controller_packed(
    packed: NDArray[np.float64], index: int, reference_um: float, feedforward_um: float,
    displacement_um: float,
) -> float:
    """Take constants and state apart, do what `controller_step` says."""
    constants = ControllerConstants(
        packed[0] > 0.0, packed[1] > 0.0, packed[2], packed[3], packed[4], packed[5],
        int(packed[6]))
    state: Any = ControllerState(packed[7:10], packed[10:])
    return controller_step(
        state, constants, index, reference_um, feedforward_um, displacement_um)
