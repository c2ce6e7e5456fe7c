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

"""The controller with its state: reference, feedforward and readings in, commands out."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.control_law import ControlLaw
from piezo_ros.control.controller_packing import (
    CONSTANTS,
    packed_controller,
    unpacked_controller,
    unpacked_state,
)
from piezo_ros.control.controller_step import (
    ControllerParameters,
    controller_constants,
    controller_step,
    initial_state,
    prepare_transfer,
    recall_measurement,
)
from piezo_ros.model.step import step

__all__ = ['PiController']


class PiController(ControlLaw):
    """
    The PI controller under any of its schemes, at rest.

    Parameters
    ----------
    parameters : ControllerParameters
        Gains and scheme; what it remembers has the size that these give it.
    sample_period_s : float
        Sample period, seconds.
    compiled : bool, optional
        Whether to compute in compiled code: quicker for each sample, a second more to start. The
        bits are the same.

    """

    def __init__(
        self, parameters: ControllerParameters, sample_period_s: float, *, compiled: bool = True,
    ) -> None:
        super().__init__(parameters, sample_period_s)
        self.is_compiled = compiled
        self._state = initial_state(parameters)
        self._constants = controller_constants(parameters, sample_period_s)
        self.memory = np.empty(0)
        self._kernel: Callable[..., None] | None = None
        if compiled:
            from piezo_ros.control.loop_kernels import controller_array
            self._kernel = controller_array
            self.memory = packed_controller(self._state, self._constants)
            self._state = unpacked_state(self.memory)

    @property
    def sample_step(self) -> Callable[..., float]:
        """One sample in compiled code: memory, y_d and u_ff (2, M), place in them, k, y[k]."""
        return _sample

    def change(self, parameters: ControllerParameters, *, bumpless: bool) -> None:
        """Take over other gains or another scheme, see `ControlLaw.change`."""
        super().change(parameters, bumpless=bumpless)
        self._constants = controller_constants(parameters, self.sample_period_s)
        if self.is_compiled:
            self.memory[:CONSTANTS] = self._constants
        if bumpless:
            prepare_transfer(self._state)

    @property
    def recalled_samples(self) -> int:
        """How many of the last readings a scheme with feedback needs before its first sample."""
        return len(self._state.measured_um)

    def recall(self, index: int, displacement_um: float) -> None:
        """Take note of a reading that came while the scheme had no use for it."""
        recall_measurement(self._state, index, displacement_um)

    def answer(
        self, index: int, reference_um: NDArray[np.float64], feedforward_um: NDArray[np.float64],
        displacement_um: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return the commands of consecutive samples, see `ControlLaw.answer`."""
        if self._kernel:
            command_um = np.empty(reference_um.size)
            self._kernel(
                self.memory, index, reference_um, feedforward_um, displacement_um, command_um)
            return command_um
        state, constants = self._state, self._constants
        samples = zip(
            reference_um.tolist(), feedforward_um.tolist(), displacement_um.tolist(), strict=True)
        return np.array([
            controller_step(state, constants, index + k, *sample)
            for k, sample in enumerate(samples)])


@step
def _sample(memory: Any, target_um: Any, at: int, k: int, displacement_um: float) -> float:
    state, constants = unpacked_controller(memory)
    return controller_step(
        state, constants, k, target_um[0, at], target_um[1, at], displacement_um)
