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

"""A table of measured columns, whichever file it is in."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag.bag_error import BagError
from piezo_ros.parameters.errors import PlanError
from piezo_ros.suggestions import did_you_mean

__all__ = ['Column', 'Table', 'TableError', 'columns_of_array', 'missing_library']

_MOST_COLUMNS: Final = 10_000
_MOST_NAMED: Final = 12  # in a message


class TableError(BagError):
    """A file without a table that can be read; the text names file, place, value and cause."""


@dataclass(frozen=True)
class Column:
    """
    One column, which is read when it is asked for.

    Attributes
    ----------
    name : str
        Its name in the file.
    read : callable
        Returns its values, shape (N,).
    unit : str or None
        The unit that the file tells.
    sample_period_s : float or None
        Sample period, seconds, if the file tells it.

    """

    name: str
    read: Callable[[], NDArray[Any]]
    unit: str | None = None
    sample_period_s: float | None = None


@dataclass(frozen=True)
class Table:
    """
    Columns of one file.

    Attributes
    ----------
    path : Path
        The file.
    columns : tuple of Column
        The columns, in the order of the file.
    first_row : int
        What the file calls its first row of values: the number of its line in a text.
    row : str
        What a row is called: ``'line'`` of a text, else ``'sample'``.
    lines : sequence of int
        The number of the line of each row of a text, where lines without a row are in between.

    """

    path: Path
    columns: tuple[Column, ...]
    first_row: int = 0
    row: str = 'sample'
    lines: Sequence[int] = ()
    _by_name: Mapping[str, list[Column]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Group the columns by name."""
        if not self.columns:
            raise TableError(f'{self.path} has no column of numbers')
        by_name: dict[str, list[Column]] = {}
        for column in self.columns[:_MOST_COLUMNS]:
            by_name.setdefault(column.name, []).append(column)
        object.__setattr__(self, '_by_name', by_name)

    def has(self, name: str) -> bool:
        """Return whether there is such a column, by its name or its number."""
        return bool(self._found(name))

    def column(self, name: str) -> Column:
        """
        Return a column.

        Parameters
        ----------
        name : str
            Its name, the last part of it if there is no other such, or its number, counted
            from 1.

        Raises
        ------
        PlanError
            If there is no such column, or several.

        """
        found = self._found(name)
        if len(found) == 1:
            return found[0]
        if found:
            raise PlanError(
                f'{self.path} has {len(found)} columns {name!r}: take one by its number, 1 … '
                f'{len(self.columns)}')
        raise PlanError(
            f'{self.path} has no column {name!r}; it has {_listed(self._by_name)}'
            f'{did_you_mean(name, self._by_name)}')

    def _found(self, name: str) -> list[Column]:
        if name in self._by_name:
            return self._by_name[name]
        ends = [
            column for column in self.columns
            if name and column.name.endswith((f'/{name}', f'.{name}'))]
        if ends:
            return ends
        if name.isdecimal() and 1 <= int(name) <= len(self.columns):
            return [self.columns[int(name) - 1]]
        return []

    def place(self, index: int) -> str:
        """Return what to call one of the rows, counted from 0."""
        return f'{self.row} {self.lines[index] if self.lines else self.first_row + index}'


def _listed(names: Iterable[str]) -> str:
    every = list(names)
    more = f' … ({len(every)} columns)' if len(every) > _MOST_NAMED else ''
    return ', '.join(map(repr, every[:_MOST_NAMED])) + more


def columns_of_array(
    name: str, shape: tuple[int, ...], read: Callable[[], NDArray[Any]], unit: str | None = None,
) -> list[Column]:
    """
    Return the columns of an array of numbers: one for a vector, for a matrix one of each column.

    Parameters
    ----------
    name : str
        Its name in the file.
    shape : tuple of int
        Its shape. A matrix has its samples along the longer side.
    read : callable
        Returns the array.
    unit : str, optional
        The unit that the file tells.

    Returns
    -------
    list of Column
        None for a scalar and for more than two dimensions. The columns of a matrix ``data`` are
        ``data@1``, ``data@2`` …

    """
    long = [length for length in shape if length > 1]
    if not long or len(shape) > 2:
        return []
    if len(long) == 1:
        return [Column(name, lambda: np.ravel(read()), unit)]
    across = shape[0] < shape[1]

    def part(number: int) -> NDArray[Any]:
        values = read()
        return np.asarray(values[number] if across else values[:, number])

    return [
        Column(f'{name}@{number + 1}', lambda number=number: part(number), unit)  # type: ignore[misc]
        for number in range(min(shape))]


def missing_library(path: Path, library: str) -> TableError:
    """Return the error that a library of the extra ``data`` is not there."""
    return TableError(
        f"{path}: files {path.suffix} need {library}: pip install 'piezo_ros[data]'")
