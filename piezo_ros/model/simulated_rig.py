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
The simulated rig: voltages in, readings of the sensor out.

The voltage u[k] is held from t[k] to t[k+1], and y[k+1] is the reading at the end of that period.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.model.noise import NoiseSource
from piezo_ros.model.packing import (
    packed_creep,
    packed_load,
    packed_rig,
    unpacked_rig,
    unpacked_state,
)
from piezo_ros.model.rig import (
    RigConstants,
    RigParameters,
    RigState,
    initial_state,
    measure_step,
    rig_constants,
    sample_step,
)
from piezo_ros.model.step import step
from piezo_ros.series import finite_series

__all__ = ['Rig']


class Rig:
    """
    The simulated rig with its state, at rest at its operating point and never driven.

    Parameters
    ----------
    parameters : RigParameters, optional
        The rig; the published values without mismatch by default.
    sample_period_s : float, optional
        Sample period, seconds.
    compiled : bool, optional
        Whether to compute in compiled code: quicker for each sample, a second more to start. The
        bits are the same.

    Attributes
    ----------
    index : int
        Index of the newest reading, 0 before the first voltage.

    Raises
    ------
    ValueError
        If the sample period is not finite and positive.

    Examples
    --------
    A step of 1 V, one sample at a time and all at once, gives the same bits:

    >>> one, other = Rig(), Rig()
    >>> readings_um = [one.step(1.0) for _ in range(200)]
    >>> readings_um == other.run([1.0] * 200).tolist()
    True

    """

    def __init__(
        self, parameters: RigParameters | None = None, sample_period_s: float = 1e-5, *,
        compiled: bool = True,
    ) -> None:
        self.parameters = parameters or RigParameters()
        self.sample_period_s = sample_period_s
        self.constants, self._memory_at_rest = _at_rest(self.parameters, sample_period_s)
        self.is_compiled = compiled
        self._kernel: Callable[..., None] | None = None
        if compiled:
            from piezo_ros.model import model_kernels
            self._kernel = (
                model_kernels.full_rig_array if self.constants.creep else model_kernels.rig_array)
        self.reset()

    @property
    def sample_step(self) -> Callable[..., float]:
        """One sample in compiled code: memory, noise of shape (1, M), place in it, k, u[k]."""
        return _full_sample if self.constants.creep else _sample

    def noise_around(self, index: int) -> tuple[int, NDArray[np.float64]]:
        """Return noise for `sample_step`, shape (1, M), and the k of its first sample."""
        first, noise = self._noise.window(index + 1)
        return first - 1, noise.reshape(1, -1)

    def reset(self) -> None:
        """Return to rest at the operating point, never driven, index 0."""
        self.memory = self._memory_at_rest.copy() if self.is_compiled else np.empty(0)
        self._state = (
            unpacked_state(self.memory) if self.is_compiled else initial_state(self.constants))
        self.index = 0
        self._noise = NoiseSource(self.parameters.seed)

    @property
    def state(self) -> RigState:
        """Everything it remembers, as lists."""
        return RigState(*(list(map(float, values)) for values in self._state))

    @property
    def commanded_v(self) -> float:
        """The newest voltage that was asked for, a deviation from the operating point."""
        return float(self._state.drive_v[3])

    @property
    def driven_v(self) -> float:
        """What drives the rig: that voltage behind the rails and the slew limit."""
        return float(self._state.drive_v[0])

    @property
    def saturated_samples(self) -> tuple[int, int]:
        """How many voltages were beyond a rail, and how many beyond the slew limit."""
        return int(self._state.drive_v[1]), int(self._state.drive_v[2])

    @property
    def average_current_samples(self) -> int:
        """How many voltages were beyond the average current of the amplifier."""
        return int(self._state.load[1])

    def measure(self) -> float:
        """Return the reading at the present index, micrometres; the rig does not move."""
        unit_noise = (
            float(self.noise(self.index, 1)[0]) if self.is_compiled else self._noise(self.index))
        return measure_step(self.constants, float(self._state.displacement_um[0]), unit_noise)

    def noise(self, index: int, samples: int) -> NDArray[np.float64]:
        """Return the unit noise of consecutive readings from an index on, shape (samples,)."""
        return self._noise.block(index, samples)

    def answer(self, index: int, voltage_v: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Hold voltages for a sample period each and return the readings at their ends.

        Parameters
        ----------
        index : int
            k of the first voltage u[k].
        voltage_v : ndarray of float64, shape (N,)
            u[k] … u[k+N-1], finite, deviations from the operating point.

        Returns
        -------
        ndarray of float64, shape (N,)
            y[k+1] … y[k+N], micrometres, deviations from the operating point.

        """
        self.index = index + voltage_v.size
        return self._hold(voltage_v, self._noise.block(index + 1, voltage_v.size))

    def drive(self, voltage_v: NDArray[np.float64]) -> None:
        """Hold voltages for a sample period each, shape (N,), without taking a reading."""
        self._hold(voltage_v, np.zeros(voltage_v.size))

    def _hold(
        self, voltage_v: NDArray[np.float64], unit_noise: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        if self._kernel:
            readings_um = np.empty(voltage_v.size)
            self._kernel(self.memory, voltage_v, unit_noise, readings_um)
            return readings_um
        state, constants = self._state, self.constants
        return np.array([
            sample_step(state, constants, voltage, noise)
            for voltage, noise in zip(voltage_v.tolist(), unit_noise.tolist(), strict=True)])

    def step(self, voltage_v: float) -> float:
        """
        Hold a voltage for one sample period and return the reading at its end.

        Parameters
        ----------
        voltage_v : float
            Voltage, deviation from the operating point.

        Returns
        -------
        float
            Measured displacement, micrometres, deviation from the operating point.

        Raises
        ------
        ValueError
            If the voltage is not finite.

        """
        if voltage_v - voltage_v != 0.0:
            raise ValueError(f'voltage_v is {voltage_v}, it must be finite')
        return float(self.answer(self.index, np.array([voltage_v], dtype=np.float64))[0])

    def run(self, voltage_v: ArrayLike) -> NDArray[np.float64]:
        """
        Return the readings that a voltage causes, the same bits as `step` one by one.

        Parameters
        ----------
        voltage_v : array_like, shape (N,)
            Voltages, deviations from the operating point.

        Returns
        -------
        ndarray, shape (N,)
            ``y[k]`` is the reading at the end of the period in which ``voltage_v[k]`` was held.

        Raises
        ------
        ValueError
            If a voltage is not finite, or the shape is wrong.

        """
        return self.answer(self.index, finite_series('voltage_v', voltage_v))


@lru_cache(maxsize=64)
def _at_rest(
    parameters: RigParameters, sample_period_s: float,
) -> tuple[RigConstants, NDArray[np.float64]]:
    """Return constants and memory of a rig at rest, not to be changed: they are shared."""
    constants = rig_constants(parameters, sample_period_s)
    memory = packed_rig(initial_state(constants), constants)
    memory.setflags(write=False)
    return constants, memory


@step
def _sample(memory: Any, noise: Any, at: int, k: int, voltage_v: float) -> float:
    state, constants = unpacked_rig(memory, None, None)
    return sample_step(state, constants, voltage_v, noise[0, at])


@step
def _full_sample(memory: Any, noise: Any, at: int, k: int, voltage_v: float) -> float:
    state, constants = unpacked_rig(memory, packed_creep(memory), packed_load(memory))
    return sample_step(state, constants, voltage_v, noise[0, at])
