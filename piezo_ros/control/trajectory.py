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
The trajectory generator: reference and feedforward of every sample of a run.

With the waveform w, the soft start r and the feedforward F of (13) in Liu 2015, all functions of
the index k alone::

    y_d[k] = r[k] w[k],   u_ff[k] = r[k] F[k]

Where P periods are exactly M samples, w and F repeat every M samples; in a long run they are
computed once.
"""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.feedforward import (
    FeedforwardConstants,
    feedforward_constants,
    feedforward_step,
)
from piezo_ros.control.waveform import (
    EXCITATIONS,
    REPEATING,
    WaveformConstants,
    WaveformParameters,
    abrupt_step,
    excitation_of,
    ramp_step,
    turns_step,
    waveform_constants,
)
from piezo_ros.model.dynamics import DynamicsParameters, LinearDynamics
from piezo_ros.model.parameters import parameter
from piezo_ros.model.step import as_arrays, step

__all__ = [
    'TrajectoryConstants',
    'TrajectoryParameters',
    'compiled_trajectory',
    'trajectory_blocks',
    'trajectory_constants',
    'trajectory_step',
]

_Samples = list[float] | NDArray[np.float64]
_Block = Callable[[int, int], tuple[_Samples, _Samples]]  # of the first index and the number
_MOST_REPEATED: Final = 4096  # samples
_ROUNDING: Final = 2.0**-50  # of the product of frequency and sample period, relative
_WORTH_KEEPING: Final = 3  # repetitions from which on it is worth computing one in advance


@dataclass(frozen=True, kw_only=True)
class TrajectoryParameters(WaveformParameters, DynamicsParameters):
    """The desired trajectory and the model that its feedforward inverts."""

    harmonics: int = parameter(
        9, '', 'highest harmonic m of the feedforward (13); 0: the reference over the dc gain',
        minimum=0, maximum=9999)

    model_response: str = parameter(
        'continuous', '', 'which response of the model the feedforward inverts: the continuous one '
        'of the paper, or the sampled one, behind the zero-order hold',
        choices=('continuous', 'sampled'))

    def check_together(self) -> None:
        """Refuse harmonics that the waveform or the sampling does not have."""
        super().check_together()
        _feedforward(self)


class TrajectoryConstants(NamedTuple):
    """What the step needs of the parameters; lists in a node, arrays in a kernel."""

    waveform: WaveformConstants
    feedforward: FeedforwardConstants
    table: Any  # (samples,) of a stepped sine or multisine, else empty
    # So many samples, their soft start aside, are repeated for ever; 0 where there is no such
    # number, or it has many digits.
    repeat: int
    repeated_reference_um: Any  # (repeat,), or empty: they need not be known in advance
    repeated_feedforward_um: Any  # as well


@lru_cache(maxsize=64)
def _feedforward(parameters: TrajectoryParameters) -> FeedforwardConstants:
    return feedforward_constants(
        parameters, parameters.harmonics, LinearDynamics(parameters),
        sampled=parameters.model_response == 'sampled')


def trajectory_constants(parameters: TrajectoryParameters) -> TrajectoryConstants:
    """Return the constants of the step as lists."""
    table: list[float] = []
    if parameters.waveform in EXCITATIONS:
        table = excitation_of(parameters).command.tolist()
    return TrajectoryConstants(
        waveform_constants(parameters),
        _feedforward(parameters),
        table,
        _repetition(parameters),
        [], [])


def _repetition(parameters: WaveformParameters) -> int:
    """Return how many samples are repeated, see `TrajectoryConstants`."""
    turns_per_sample = parameters.frequency_hz * parameters.sample_period_s
    ratio = Fraction(turns_per_sample).limit_denominator(_MOST_REPEATED)
    repeats = (
        parameters.waveform in REPEATING
        and abs(float(ratio) - turns_per_sample) <= _ROUNDING * turns_per_sample)
    return ratio.denominator if repeats else 0


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


@step
def trajectory_step(constants: TrajectoryConstants, index: int) -> tuple[float, float]:
    """Return reference and feedforward of one sample, micrometres."""
    if len(constants.table) > 0:
        reference_um = constants.table[index]
        return reference_um, constants.feedforward.dc_inverse * reference_um
    waveform = constants.waveform
    factor = ramp_step(waveform, turns_step(waveform, index))
    if constants.repeat > 0:
        index = index % constants.repeat
    if len(constants.repeated_reference_um) > 0:
        reference_um = constants.repeated_reference_um[index]
        feedforward_um = constants.repeated_feedforward_um[index]
    else:
        turns = turns_step(waveform, index)
        reference_um = abrupt_step(waveform, turns)
        feedforward_um = feedforward_step(constants.feedforward, turns, reference_um)
    return factor * reference_um, factor * feedforward_um
