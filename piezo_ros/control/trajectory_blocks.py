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

"""A trajectory block by block, by the step of `trajectory`; what repeats is computed once."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.trajectory import (
    TrajectoryConstants,
    TrajectoryParameters,
    trajectory_constants,
    trajectory_step,
)
from piezo_ros.model.step import as_arrays

__all__ = ['compiled_trajectory', 'trajectory_blocks']

_Samples = list[float] | NDArray[np.float64]
_Block = Callable[[int, int], tuple[_Samples, _Samples]]  # of the first index and the number
_WORTH_KEEPING: Final = 3  # repetitions from which on it is worth computing one in advance


def _with_repetition(
    constants: TrajectoryConstants, samples: int,
    make_block: Callable[[TrajectoryConstants], _Block],
) -> TrajectoryConstants:
    """
    Return constants of a trajectory that know in advance what is repeated, if that is worth it.

    Parameters
    ----------
    constants : TrajectoryConstants
        The trajectory, as `trajectory_constants` returns it.
    samples : int
        The length of the run.
    make_block : callable
        Makes a function as `trajectory_blocks` returns it.

    """
    if not constants.repeat or samples < _WORTH_KEEPING * constants.repeat:
        return constants
    abrupt = constants._replace(waveform=constants.waveform._replace(ramp_turns=0.0))
    reference_um, feedforward_um = make_block(abrupt)(0, constants.repeat)
    return constants._replace(
        repeated_reference_um=reference_um, repeated_feedforward_um=feedforward_um)


def compiled_trajectory(parameters: TrajectoryParameters) -> Any:
    """Return the constants of a trajectory for the compiled kernels."""
    constants = as_arrays(trajectory_constants(parameters))
    return _with_repetition(constants, parameters.samples, _compiled_block)


def trajectory_blocks(
    parameters: TrajectoryParameters, *, compiled: bool = False,
) -> _Block:
    """
    Return a trajectory as a function.

    Parameters
    ----------
    parameters : TrajectoryParameters
        The trajectory.
    compiled : bool
        Whether to import the compiler; quicker per sample, slower to start.

    Returns
    -------
    callable
        Takes the index of the first sample and their number, and returns the reference and the
        feedforward, micrometres; as arrays where compiled, else as lists.

    """
    if compiled:
        return _compiled_block(compiled_trajectory(parameters))
    constants = trajectory_constants(parameters)
    return _block(_with_repetition(constants, parameters.samples, _block))


def _block(constants: TrajectoryConstants) -> _Block:
    def block(start: int, count: int) -> tuple[_Samples, _Samples]:
        pairs = [trajectory_step(constants, start + k) for k in range(count)]
        return [pair[0] for pair in pairs], [pair[1] for pair in pairs]

    return block


def _compiled_block(constants: Any) -> _Block:
    from piezo_ros.control.kernels import trajectory_array

    def block(start: int, count: int) -> tuple[_Samples, _Samples]:
        reference_um, feedforward_um = np.empty(count), np.empty(count)
        trajectory_array(constants, start, reference_um, feedforward_um)
        return reference_um, feedforward_um

    return block
