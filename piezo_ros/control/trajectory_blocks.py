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
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.tables.motion_table import MotionTable, MotionTableError
from piezo_ros.control.tables.table_changes import (
    TableChange,
    check_successor,
    nearest_sample,
)
from piezo_ros.control.trajectory_step import (
    TrajectoryConstants,
    TrajectoryParameters,
    trajectory_constants,
    trajectory_step,
)
from piezo_ros.control.waveform import motion_of
from piezo_ros.model.step import as_arrays

__all__ = ['ChangingTable', 'compiled_trajectory', 'trajectory_blocks']

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
    if parameters.file_changes:
        return ChangingTable(parameters, compiled=compiled)
    if compiled:
        return _compiled_block(compiled_trajectory(parameters))
    constants = trajectory_constants(parameters)
    return _block(_with_repetition(constants, parameters.samples, _block))


class _Piece(NamedTuple):
    at_sample: int
    file: str
    table: MotionTable
    block: _Block


class ChangingTable:
    """
    A trajectory of the waveform file of which the file changes at samples of the run.

    Parameters
    ----------
    parameters : TrajectoryParameters
        The trajectory with the changes that are listed.
    compiled : bool
        As for `trajectory_blocks`.

    Raises
    ------
    MotionTableError
        If a file is no table that can follow the one before.

    """

    def __init__(self, parameters: TrajectoryParameters, *, compiled: bool = False) -> None:
        self._parameters = parameters.replaced(file_changes='')
        self._compiled = compiled
        self._pieces = [self._piece(0, parameters.file)]
        for change in parameters.table_changes:
            self.add(*change)
        self._listed = len(self._pieces)

    def __call__(self, start: int, count: int) -> tuple[_Samples, _Samples]:
        """Return reference and feedforward of samples, see `trajectory_blocks`."""
        stops = [piece.at_sample for piece in self._pieces[1:]]
        ranges = [
            (piece.block, max(start, piece.at_sample), min(start + count, stop))
            for piece, stop in zip(self._pieces, [*stops, start + count], strict=True)]
        parts = [block(first, stop - first) for block, first, stop in ranges if first < stop]
        if len(parts) == 1:
            return parts[0]
        reference_um, feedforward_um = (np.concatenate(part) for part in zip(*parts, strict=True))
        if self._compiled:
            return reference_um, feedforward_um
        return reference_um.tolist(), feedforward_um.tolist()

    @property
    def newest(self) -> TableChange:
        """The last file, and from which sample on it is played."""
        return TableChange(self._pieces[-1].at_sample, self._pieces[-1].file)

    @property
    def has_grown(self) -> bool:
        """Whether files were added to those of the parameters."""
        return len(self._pieces) > self._listed

    def nearest_sample(self, file: str, earliest: int) -> int:
        """
        Return a sample at which another file may follow with hardly a jump.

        Raises
        ------
        MotionTableError
            If the file is no table.

        """
        last = self._pieces[-1]
        table = motion_of(self._parameters.replaced(file=file))
        return nearest_sample(last.table, table, max(earliest, last.at_sample + 1))

    def add(self, at_sample: int, file: str) -> None:
        """
        Play another file from a sample on; after a refusal nothing has changed.

        Raises
        ------
        MotionTableError
            If it is no table that can follow the last one at this sample.

        """
        last = self._pieces[-1]
        if (at_sample, file) == (last.at_sample, last.file):
            return  # the same change once more
        if at_sample <= last.at_sample:
            raise MotionTableError(
                f'{file}: at_sample is {at_sample}, it must be above {last.at_sample}, from which '
                f'{last.file} is played')
        if at_sample >= self._parameters.samples:
            raise MotionTableError(
                f'{file}: at_sample is {at_sample}, the run has {self._parameters.samples} samples')
        piece = self._piece(at_sample, file)
        try:
            check_successor(last.table, piece.table, at_sample)
        except MotionTableError as error:
            raise MotionTableError(f'{file}: {error}') from None
        self._pieces.append(piece)

    def _piece(self, at_sample: int, file: str) -> _Piece:
        parameters = self._parameters.replaced(file=file)
        return _Piece(
            at_sample, file, motion_of(parameters),
            trajectory_blocks(parameters, compiled=self._compiled))


def _block(constants: TrajectoryConstants) -> _Block:
    def block(start: int, count: int) -> tuple[_Samples, _Samples]:
        pairs = [trajectory_step(constants, start + k) for k in range(count)]
        return [pair[0] for pair in pairs], [pair[1] for pair in pairs]

    return block


def _compiled_block(constants: Any) -> _Block:
    from piezo_ros.control.loop_kernels import trajectory_array

    def block(start: int, count: int) -> tuple[_Samples, _Samples]:
        reference_um, feedforward_um = np.empty(count), np.empty(count)
        trajectory_array(constants, start, reference_um, feedforward_um)
        return reference_um, feedforward_um

    return block
