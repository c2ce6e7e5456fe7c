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
Changes of the table that a trajectory plays, during a run and at a sample of it.

A table may follow another one if it repeats the same samples in the same phase and jumps nowhere:
neither within itself nor from the last sample of the one to the first of the other. What it may
step by is twice the largest step of the table in use.
"""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.tables.motion_table import MotionTable, MotionTableError
from piezo_ros.model.parameters import ParameterError

__all__ = [
    'TableChange', 'check_successor', 'nearest_sample', 'table_changes', 'table_changes_entry',
]

_FILE: Final = 'file'
_STEP_FACTOR: Final = 2.0  # of the largest step of the table in use


class TableChange(NamedTuple):
    """From which sample on which file is played."""

    at_sample: int
    file: str


def table_changes(entries: Sequence[tuple[int, dict[str, Any]]]) -> tuple[TableChange, ...]:
    """
    Return listed changes of the table.

    Parameters
    ----------
    entries : sequence of (int, dict)
        Samples, ascending, and what changes there.

    Raises
    ------
    ParameterError
        If something else than the file changes, or it is no path.

    """
    changes = []
    for at_sample, values in entries:
        if values.keys() != {_FILE} or not isinstance(values[_FILE], str) or not values[_FILE]:
            raise ParameterError(
                f'file_changes has {values!r} at sample {at_sample}, allowed is file, a path')
        changes.append(TableChange(at_sample, values[_FILE]))
    return tuple(changes)


def table_changes_entry(change: TableChange) -> dict[str, Any]:
    """Return a change as an entry of the list in the parameter ``file_changes``."""
    return {'at_sample': change.at_sample, _FILE: change.file}


def check_successor(present: MotionTable, new: MotionTable, at_sample: int) -> None:
    """
    Refuse a table that cannot follow another one at a sample of the run.

    Parameters
    ----------
    present, new : MotionTable
        The table in use and the one that shall follow.
    at_sample : int
        First sample of the new one.

    Raises
    ------
    MotionTableError
        If it does not repeat the same samples in the same phase, or jumps.

    """
    if present.repeat_from is None or new.repeat_from is None:
        which = 'the table in use' if present.repeat_from is None else 'it'
        raise MotionTableError(
            f'repeat_from is not set: {which} is played once, and only a table that is repeated '
            'can change during a run')
    samples = _repeated(present)
    if _repeated(new) != samples:
        raise MotionTableError(
            f'it repeats {_repeated(new)} samples, the table in use {samples}')
    if (new.first_repeated - present.first_repeated) % samples:
        raise MotionTableError(
            f'repeat_from is {new.repeat_from}, that of the table in use {present.repeat_from}; '
            f'allowed is a difference of whole repetitions, {samples} samples')
    if (new.command_um is None) != (present.command_um is None):
        has = 'has no' if new.command_um is None else 'has'
        raise MotionTableError(f'it {has} command_um, unlike the table in use')
    for name, before, after in (
            ('reference_um', present.reference_um, new.reference_um),
            ('command_um', present.command_um, new.command_um)):
        if before is None or after is None:
            continue
        allowed_um = _STEP_FACTOR * _largest_step(before, present.first_repeated)
        step_um = _largest_step(after, new.first_repeated)
        if step_um > allowed_um:
            raise MotionTableError(
                f'{name} steps by {step_um:.6g} um in a sample period, allowed is '
                f'{allowed_um:.6g} um, {_STEP_FACTOR:g} times the largest step of the table in use')
        jump_um = abs(float(
            after[new.place(at_sample)] - before[present.place(max(at_sample - 1, 0))]))
        if jump_um > allowed_um:
            raise MotionTableError(
                f'{name} jumps by {jump_um:.6g} um at sample {at_sample} from the table in use, '
                f'allowed is {allowed_um:.6g} um')


def nearest_sample(present: MotionTable, new: MotionTable, earliest: int) -> int:
    """
    Return the sample of a repetition at which two tables are nearest to each other.

    Parameters
    ----------
    present, new : MotionTable
        The table in use and the one that shall follow; both repeat the same samples.
    earliest : int
        The first sample that is allowed.

    """
    places = range(earliest, earliest + _repeated(present))
    pairs = [(present.reference_um, new.reference_um), (present.command_um, new.command_um)]
    apart: NDArray[np.float64] = np.zeros(len(places))
    for before, after in pairs:
        if before is not None and after is not None:
            apart += np.abs(
                after[[new.place(k) for k in places]] - before[[present.place(k) for k in places]])
    return earliest + int(np.argmin(apart))


def _repeated(table: MotionTable) -> int:
    return table.reference_um.size - table.first_repeated


def _largest_step(values: NDArray[np.float64], first_repeated: int) -> float:
    following = np.append(values[1:], values[first_repeated])
    return float(np.abs(following - values).max())
