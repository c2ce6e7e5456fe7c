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

"""The inverse hysteresis model with its state: commands in, voltages out."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros.model.hysteresis import (
    HysteresisParameters,
    hysteresis_constants,
    hysteresis_state,
    inverse_step,
)
from piezo_ros.model.packing import packed_inverse, unpacked_inverse
from piezo_ros.model.step import step

__all__ = ['InverseHysteresis']


class InverseHysteresis:
    """
    The compensator of (5) in Liu 2015: the exact inverse of an MRC model, of a virgin stage.

    Parameters
    ----------
    parameters : HysteresisParameters
        The hysteresis to invert.
    compiled : bool, optional
        Whether to compute in compiled code: quicker for each sample, a second more to start. The
        bits are the same.

    """

    def __init__(self, parameters: HysteresisParameters, *, compiled: bool = True) -> None:
        self.is_compiled = compiled
        self._constants = hysteresis_constants(parameters)
        self._state = hysteresis_state([0.0] * len(self._constants.width_um))
        self.memory = np.empty(0)
        self._kernel: Callable[..., None] | None = None
        if compiled:
            from piezo_ros.model.kernels import inverse_packed_array
            self._kernel = inverse_packed_array
            self.memory = packed_inverse(self._state, self._constants)

    @property
    def sample_step(self) -> Callable[..., float]:
        """One sample in compiled code: memory, nothing beside it, k, v[k]."""
        return _sample

    def answer(self, index: int, command_um: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Return the voltages of commands.

        Parameters
        ----------
        index : int
            k of the first command; the inverse does not depend on it.
        command_um : ndarray of float64, shape (N,)
            v[k] … v[k+N-1], the linearised commands, finite.

        Returns
        -------
        ndarray of float64, shape (N,)
            u[k] … u[k+N-1], volts.

        """
        if self._kernel:
            voltage_v = np.empty(command_um.size)
            self._kernel(self.memory, command_um, voltage_v)
            return voltage_v
        state, constants = self._state, self._constants
        return np.array([
            inverse_step(state, constants, command) for command in command_um.tolist()])


@step
def _sample(memory: Any, nothing: Any, at: int, k: int, command_um: float) -> float:
    state, constants = unpacked_inverse(memory)
    return inverse_step(state, constants, command_um)
