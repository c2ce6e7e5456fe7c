"""The trajectory generator: reference and feedforward of every sample of a run."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.feedforward import (
    FeedforwardConstants,
    feedforward_constants,
    feedforward_step,
)
from piezo_ros.control.waveform import (
    EXCITATIONS,
    WaveformConstants,
    WaveformParameters,
    excitation_of,
    ramp_step,
    reference_step,
    turns_step,
    waveform_constants,
)
from piezo_ros.model.dynamics import DynamicsParameters, LinearDynamics
from piezo_ros.model.parameters import parameter
from piezo_ros.model.rig import as_arrays
from piezo_ros.model.step import step

__all__ = [
    'TrajectoryConstants',
    'TrajectoryParameters',
    'trajectory_blocks',
    'trajectory_constants',
    'trajectory_step',
]

_Samples = list[float] | NDArray[np.float64]


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
        table)


def trajectory_blocks(
    parameters: TrajectoryParameters, *, compiled: bool = False,
) -> Callable[[int, int], tuple[_Samples, _Samples]]:
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
    constants = trajectory_constants(parameters)
    if compiled:
        from piezo_ros.control.kernels import trajectory_array
        arrays = as_arrays(constants)

        def compiled_block(start: int, count: int) -> tuple[_Samples, _Samples]:
            reference_um, feedforward_um = np.empty(count), np.empty(count)
            trajectory_array(arrays, start, reference_um, feedforward_um)
            return reference_um, feedforward_um

        return compiled_block

    def block(start: int, count: int) -> tuple[_Samples, _Samples]:
        pairs = [trajectory_step(constants, start + k) for k in range(count)]
        return [pair[0] for pair in pairs], [pair[1] for pair in pairs]

    return block


@step
def trajectory_step(constants: TrajectoryConstants, index: int) -> tuple[float, float]:
    """Return reference and feedforward of one sample, micrometres."""
    if len(constants.table) > 0:
        reference_um = constants.table[index]
        return reference_um, constants.feedforward.dc_inverse * reference_um
    waveform = constants.waveform
    turns = turns_step(waveform, index)
    reference_um = reference_step(waveform, turns)
    feedforward = constants.feedforward
    feedforward_um = feedforward_step(feedforward, turns, reference_um)
    if len(feedforward.real_um) > 0:
        feedforward_um *= ramp_step(waveform, turns)
    return reference_um, feedforward_um
