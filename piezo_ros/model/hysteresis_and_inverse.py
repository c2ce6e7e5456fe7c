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
The MRC hysteresis and its inverse: over arrays, and the inverse as the element that compensates.

Both do the steps of `piezo_ros.model.hysteresis`, which begins with the equations.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros import paper
from piezo_ros.model.creep import (
    CreepConstants,
    CreepParameters,
    creep_constants,
    inverse_creep_step,
)
from piezo_ros.model.hysteresis import (
    HysteresisConstants,
    HysteresisParameters,
    compensation_step,
    hysteresis_constants,
    hysteresis_state,
)
from piezo_ros.model.packing import packed_inverse, packed_inverse_creep, unpacked_inverse
from piezo_ros.model.step import as_arrays, step
from piezo_ros.series import finite_series

__all__ = ['CompensatorParameters', 'InverseHysteresis', 'MaxwellResistiveCapacitor']


@dataclass(frozen=True, kw_only=True)
class CompensatorParameters(HysteresisParameters, CreepParameters):
    """The hysteresis that the compensator inverts, and the creep, which is off by default."""


class MaxwellResistiveCapacitor:
    """
    The MRC operator: voltage to displacement, and back.

    Parameters
    ----------
    kappa_um_per_v : sequence of float, shape (n + 1,)
        Compliances of the elements, the last one unlimited; Table 1 in Liu 2015 by default.
    saturation_v : sequence of float, shape (n,)
        Saturation voltages of the limited elements.
    asymmetry_threshold_um, asymmetry_weight : sequence of float, shape (m,), optional
        The map S behind the elements, see `piezo_ros.model.hysteresis`; none by default. The
        displacement of the operator is then S(H(u)).

    Raises
    ------
    ParameterError
        If the lengths do not belong together or a value is out of range.

    Examples
    --------
    >>> operator = MaxwellResistiveCapacitor()  # Table 1 in Liu 2015
    >>> voltage_v, _ = operator.inverse([0.5, 1.0, 0.5])
    >>> [round(u, 3) for u in voltage_v.tolist()]  # depends on the turn at 1.0 um
    [0.603, 1.111, 0.467]
    >>> displacement_um, _ = operator.forward(voltage_v)
    >>> [round(x, 9) for x in displacement_um.tolist()]
    [0.5, 1.0, 0.5]

    """

    def __init__(
        self,
        kappa_um_per_v: Sequence[float] = paper.KAPPA_UM_PER_V,
        saturation_v: Sequence[float] = paper.SATURATION_V,
        asymmetry_threshold_um: Sequence[float] = (),
        asymmetry_weight: Sequence[float] = (),
    ) -> None:
        self.parameters = HysteresisParameters(
            kappa_um_per_v=tuple(kappa_um_per_v), saturation_v=tuple(saturation_v),
            asymmetry_threshold_um=tuple(asymmetry_threshold_um),
            asymmetry_weight=tuple(asymmetry_weight))
        constants = hysteresis_constants(self.parameters)
        self._constants = constants._replace(
            slope_v_per_um=np.array(constants.slope_v_per_um, dtype=np.float64),
            width_um=np.array(constants.width_um, dtype=np.float64),
            saturation_v=np.array(constants.saturation_v, dtype=np.float64),
            asymmetry=as_arrays(constants.asymmetry))

    @classmethod
    def of(cls, parameters: HysteresisParameters) -> 'MaxwellResistiveCapacitor':
        """Return the operator of a parameter set, which may have more than that."""
        return cls(
            parameters.kappa_um_per_v, parameters.saturation_v,
            parameters.asymmetry_threshold_um, parameters.asymmetry_weight)

    def virgin_state(self) -> NDArray[np.float64]:
        """Return the play values of the never driven operator, shape (n,), micrometres."""
        return np.zeros(len(self.parameters.saturation_v))

    def forward(
        self, voltage_v: ArrayLike, state: NDArray[np.float64] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Return the displacement that a voltage causes, (1) to (4) in Liu 2015.

        Parameters
        ----------
        voltage_v : array_like, shape (N,)
            Voltages, in order of time.
        state : ndarray, shape (n,), optional
            Play values before the first sample, micrometres; the virgin state by default. It is
            not changed.

        Returns
        -------
        displacement_um : ndarray, shape (N,)
            Displacements.
        state : ndarray, shape (n,)
            Play values after the last sample.

        Raises
        ------
        ValueError
            If a voltage is not finite, a shape is wrong, or no input leads to the state.

        """
        from piezo_ros.model.model_kernels import forward_array
        return self._run(forward_array, 'voltage_v', voltage_v, state)

    def inverse(
        self, displacement_um: ArrayLike, state: NDArray[np.float64] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Return the voltage that causes a displacement: the inverse model, section 2 of Liu 2015.

        Parameters
        ----------
        displacement_um : array_like, shape (N,)
            Displacements, in order of time.
        state : ndarray, shape (n,), optional
            Play values before the first sample, micrometres; the virgin state by default. It is
            not changed.

        Returns
        -------
        voltage_v : ndarray, shape (N,)
            Voltages.
        state : ndarray, shape (n,)
            Play values after the last sample.

        Raises
        ------
        ValueError
            If a displacement is not finite, a shape is wrong, or no input leads to the state.

        """
        from piezo_ros.model.model_kernels import inverse_array
        return self._run(inverse_array, 'displacement_um', displacement_um, state)

    def _run(
        self, array_kernel: Any, name: str, values: ArrayLike, state: NDArray[np.float64] | None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        inputs = finite_series(name, values)
        play = self.virgin_state() if state is None else self._checked(state)
        whole = np.array(hysteresis_state(play.tolist()))
        outputs = np.empty_like(inputs)
        array_kernel(whole, self._constants, inputs, outputs)
        return outputs, whole[:play.size].copy()

    def _checked(self, state: ArrayLike) -> NDArray[np.float64]:
        """Return a copy of a state that this operator can be in."""
        play = np.array(state, dtype=np.float64)
        if play.shape != self._constants.width_um.shape:
            raise ValueError(
                f'state has shape {play.shape}, it must be {self._constants.width_um.shape}')
        if not np.isfinite(play).all():
            raise ValueError(f'state is {play}, every value must be finite')
        # Some displacement must lie within the reach of every play, else no input leads there.
        gap_um = float(np.max(play - self._constants.width_um, initial=-np.inf)
                       - np.min(play + self._constants.width_um, initial=np.inf))
        if gap_um > 1e-9 * (1.0 + float(np.max(np.abs(play), initial=0.0))):
            raise ValueError(
                f'state is {play}: plays {gap_um:g} um out of reach of each other belong to no '
                'state of this operator')
        return play


class InverseHysteresis:
    """
    The compensator of section 2 in Liu 2015: the exact inverse of an MRC model, of a virgin stage.

    Parameters
    ----------
    parameters : HysteresisParameters
        The hysteresis to invert; of `CompensatorParameters` the creep too, before the hysteresis.
    sample_period_s : float, optional
        Sample period, seconds, for the creep.
    compiled : bool, optional
        Whether to compute in compiled code: quicker for each sample, a second more to start. The
        bits are the same.

    Examples
    --------
    To hold 1 um on a stage that creeps by 2 % a decade, less and less voltage is needed:

    >>> inverse = InverseHysteresis(CompensatorParameters(creep_per_decade=0.02), 0.1)
    >>> voltage_v = inverse.answer(0, np.ones(1000))
    >>> bool(np.all(np.diff(voltage_v) < 0.0))
    True

    """

    def __init__(
        self, parameters: HysteresisParameters, sample_period_s: float = 1e-5, *,
        compiled: bool = True,
    ) -> None:
        self.is_compiled = compiled
        self._constants, self._creep, memory_at_rest = _at_rest(parameters, sample_period_s)
        self._relaxed_um = [0.0] * (len(self._creep.rate) if self._creep else 0)
        self._state = hysteresis_state([0.0] * len(self._constants.width_um))
        self.memory = np.empty(0)
        self._kernel: Callable[..., None] | None = None
        if compiled:
            from piezo_ros.model import model_kernels
            self._kernel = (
                model_kernels.creep_inverse_packed_array if self._creep
                else model_kernels.inverse_packed_array)
            self.memory = memory_at_rest.copy()

    @property
    def sample_step(self) -> Callable[..., float]:
        """One sample in compiled code: memory, nothing beside it, k, v[k]."""
        return _sample_with_creep if self._creep else _sample

    @property
    def inverts_creep(self) -> bool:
        """Whether there is any creep to invert."""
        return self._creep is not None

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
        relaxed_um, creep = self._relaxed_um, self._creep
        return np.array([
            compensation_step(state, constants, inverse_creep_step(relaxed_um, creep, command))
            for command in command_um.tolist()])


@lru_cache(maxsize=64)
def _at_rest(
    parameters: HysteresisParameters, sample_period_s: float,
) -> tuple[HysteresisConstants, CreepConstants | None, NDArray[np.float64]]:
    """Return constants and memory of a virgin inverse, not to be changed: they are shared."""
    creep = creep_constants(parameters, sample_period_s) if isinstance(
        parameters, CompensatorParameters) else None
    constants = hysteresis_constants(parameters)
    memory = packed_inverse(
        hysteresis_state([0.0] * len(constants.width_um)), constants,
        [0.0] * (len(creep.rate) if creep else 0), creep)
    memory.setflags(write=False)
    return constants, creep, memory


@step
def _sample(memory: Any, nothing: Any, at: int, k: int, command_um: float) -> float:
    state, constants = unpacked_inverse(memory)
    return compensation_step(state, constants, command_um)


@step
def _sample_with_creep(memory: Any, nothing: Any, at: int, k: int, command_um: float) -> float:
    state, constants = unpacked_inverse(memory)
    relaxed_um, creep = packed_inverse_creep(memory)
    return compensation_step(state, constants, inverse_creep_step(relaxed_um, creep, command_um))
