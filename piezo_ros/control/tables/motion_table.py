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
A motion out of a file: a reference, with or without the command that brings it about.

Samples before ``repeat_from`` are played once, those from there on for ever; without it the motion
ends with its last sample, which is then held. A CSV file has a column ``reference_um``, and may
have ``command_um`` (what the scheme ff sends) and ``time_s``; comment lines at its top may say
``# sample_period_s: 1e-5`` and ``# repeat_from: 0``. An NPZ file has arrays of these names.

Examples
--------
>>> table = MotionTable(np.array([0.0, 1.0, 2.0, 1.0]), None, 1e-5, repeat_from=1)
>>> [float(table.reference_um[table.place(k)]) for k in range(8)]
[0.0, 1.0, 2.0, 1.0, 1.0, 2.0, 1.0, 1.0]

"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.model.parameters import ParameterError
from piezo_ros.model.step import step

__all__ = [
    'MotionTable', 'MotionTableError', 'place_step', 'read_motion_table', 'write_motion_table',
]

MOST_SAMPLES: Final = 10**7
_COLUMNS: Final = ('reference_um', 'command_um', 'time_s')
_SETTINGS: Final = ('sample_period_s', 'repeat_from')
_SAME_PERIOD: Final = 1e-6  # relative
_FILE_BYTES: Final = 2**30
_ROUNDING_SAMPLES: Final = 1e-6

_Floats = NDArray[np.float64]


class MotionTableError(ParameterError):
    """A file that is no motion; the text names the file and what is wrong with it."""


@dataclass(frozen=True)
class MotionTable:
    """
    A motion, sample by sample.

    Attributes
    ----------
    reference_um : ndarray, shape (N,)
        The desired displacement.
    command_um : ndarray, shape (N,), or None
        The feedforward; None where the model of the trajectory makes it out of the reference.
    sample_period_s : float
        Sample period, seconds.
    repeat_from : int or None
        First of the samples that are repeated.

    Raises
    ------
    MotionTableError
        If a value is not finite, or sizes and settings do not belong together.

    """

    reference_um: _Floats
    command_um: _Floats | None
    sample_period_s: float
    repeat_from: int | None = None

    def __post_init__(self) -> None:
        samples = self.reference_um.size
        if not 2 <= samples <= MOST_SAMPLES:
            raise MotionTableError(f'it has {samples} samples, allowed is 2 … {MOST_SAMPLES}')
        if not 0.0 < self.sample_period_s < math.inf:
            raise MotionTableError(
                f'sample_period_s is {self.sample_period_s}, it must be finite and above 0 s')
        for name in ('reference_um', 'command_um'):
            values = getattr(self, name)
            if values is None:
                continue
            if values.shape != (samples,):
                raise MotionTableError(
                    f'{name} has the shape {values.shape}, reference_um has ({samples},)')
            finite = np.isfinite(values)
            if not finite.all():
                place = int(np.argmin(finite))
                raise MotionTableError(f'{name} is {values[place]} at sample {place}')
        if self.repeat_from is not None and not 0 <= self.repeat_from <= samples - 2:
            raise MotionTableError(
                f'repeat_from is {self.repeat_from}, allowed is 0 … {samples - 2} (two samples at '
                'least are repeated)')

    @property
    def first_repeated(self) -> int:
        """First of the samples that are repeated: the last one where it is held."""
        return self.reference_um.size - 1 if self.repeat_from is None else self.repeat_from

    def place(self, index: int) -> int:
        """Return which sample of the table is the sample k of a run."""
        return place_step(self.reference_um.size, self.first_repeated, index)

    @property
    def greatest_um(self) -> float:
        """Largest absolute value of reference and command."""
        command_um = self.reference_um if self.command_um is None else self.command_um
        return float(max(np.abs(self.reference_um).max(), np.abs(command_um).max()))

    def steepest(self) -> tuple[int, float]:
        """
        Return the largest step of the command (else of the reference) and the sample before it.

        The step from the end to the first repeated sample counts.
        """
        values = self.reference_um if self.command_um is None else self.command_um
        following = np.append(values[1:], values[self.first_repeated])
        steps = np.abs(following - values)
        place = int(np.argmax(steps))
        return place, float(steps[place])

    def check_steps(self, most_um: float, name: str = '') -> None:
        """
        Refuse a motion that jumps, also from its end to the first repeated sample.

        Parameters
        ----------
        most_um : float
            Largest step that the stage can follow in a sample period, micrometres.
        name : str, optional
            Name of the file, for the refusal.

        Raises
        ------
        MotionTableError
            If a step is larger.

        """
        place, step_um = self.steepest()
        if step_um > most_um:
            last = self.reference_um.size - 1
            to = 'the first repeated sample' if place == last else f'sample {place + 1}'
            raise MotionTableError(_told(
                name, f'it jumps by {step_um:g} um from sample {place} to {to}, allowed is '
                f'{most_um:g} um in a sample period' + (
                    ': it does not close on itself' if place == last and self.repeat_from == 0
                    else '')))

    def check_start(self, most_um: float, offset_um: float = 0.0, name: str = '') -> None:
        """
        Refuse a motion that does not begin where a run begins, at rest at 0.

        Parameters
        ----------
        most_um : float
            As for `check_steps`.
        offset_um : float, optional
            What is added to every sample, micrometres.
        name : str, optional
            Name of the file, for the refusal.

        Raises
        ------
        MotionTableError
            If the first sample is farther from 0.

        """
        column = 'reference_um' if self.command_um is None else 'command_um'
        first_um = float(getattr(self, column)[0]) + offset_um
        if abs(first_um) > most_um:
            raise MotionTableError(_told(
                name, f'{column} is {first_um:g} um at sample 0'
                + ' with the offset' * (offset_um != 0.0)
                + f', allowed is {-most_um:g} … {most_um:g} um: a run begins at rest at 0'
                + (' (ramp_periods gives a reference without commands a soft start)'
                   if self.command_um is None else '')))

    def check_period(self, frequency_hz: float, score_periods: float, name: str = '') -> None:
        """
        Refuse a motion of which the length does not belong to the frequency of the run.

        Parameters
        ----------
        frequency_hz : float
            Frequency of the scan, hertz.
        score_periods : float
            Periods at the end of the run that will be scored.
        name : str, optional
            Name of the file, for the refusal.

        Raises
        ------
        MotionTableError
            If what is repeated is not a whole number of periods, to half a sample, or what is not
            repeated is shorter than what is scored.

        """
        period = 1.0 / (frequency_hz * self.sample_period_s)  # samples
        if self.repeat_from is None:
            if self.reference_um.size < math.floor(score_periods * period + _ROUNDING_SAMPLES):
                raise MotionTableError(_told(
                    name, f'it has {self.reference_um.size} samples, played once; score_periods is '
                    f'{score_periods:g}, which are {score_periods * period:.6g} samples of '
                    f'frequency_hz {frequency_hz:g} Hz'))
            return
        length = self.reference_um.size - self.repeat_from
        whole = max(round(length / period), 1)
        if abs(length - whole * period) > 0.5:
            raise MotionTableError(_told(
                name, f'it repeats {length} samples, {length / period:.6g} periods of '
                f'frequency_hz {frequency_hz:g} Hz ({period:.6g} samples each), it must be a whole '
                'number of them'))


def _told(name: str, problem: str) -> str:
    return f'{name}: {problem}' if name else problem


@step
def place_step(samples: int, first_repeated: int, index: int) -> int:
    """Return which of the samples of a table is the sample k of a run."""
    if index < samples:
        return index
    return first_repeated + (index - first_repeated) % (samples - first_repeated)


def read_motion_table(path: Path, sample_period_s: float) -> MotionTable:
    """
    Read a motion out of a CSV or NPZ file.

    Parameters
    ----------
    path : Path
        The file; its suffix decides.
    sample_period_s : float
        The sample period of the run; what the file says must agree.

    Raises
    ------
    MotionTableError
        If the file cannot be read, or is no motion, or has another sample period.

    """
    try:
        if path.stat().st_size > _FILE_BYTES:
            raise MotionTableError(f'it has {path.stat().st_size} bytes, allowed is {_FILE_BYTES}')
        if path.suffix == '.npz':
            columns, settings = _read_npz(path)
        elif path.suffix == '.csv':
            columns, settings = _read_csv(path)
        else:
            raise MotionTableError(
                f'its suffix is {path.suffix!r}, allowed are .csv, .npz; piezo bag motion makes a '
                'motion of a bag')
        return _table(columns, settings, sample_period_s)
    except OSError as error:
        raise MotionTableError(f'{path}: {error.strerror or error}') from None
    except MotionTableError as error:
        raise MotionTableError(f'{path}: {error}') from None


def write_motion_table(path: Path, table: MotionTable) -> None:
    """
    Write a motion as an NPZ file, all bits kept.

    Parameters
    ----------
    path : Path
        The file, with the suffix ``.npz``.
    table : MotionTable
        The motion.

    """
    arrays: dict[str, Any] = {
        'reference_um': table.reference_um, 'sample_period_s': table.sample_period_s}
    if table.command_um is not None:
        arrays['command_um'] = table.command_um
    if table.repeat_from is not None:
        arrays['repeat_from'] = table.repeat_from
    with path.open('wb') as file:
        np.savez_compressed(file, **arrays)


def _table(
    columns: Mapping[str, _Floats], settings: Mapping[str, float], sample_period_s: float,
) -> MotionTable:
    if 'reference_um' not in columns:
        raise MotionTableError('it has no reference_um')
    stated_s = settings.get('sample_period_s')
    if 'time_s' in columns:
        stated_s = _period_of(columns['time_s'])
    if stated_s is not None and not abs(stated_s - sample_period_s) <= (
            _SAME_PERIOD * sample_period_s):
        raise MotionTableError(
            f'its sample period is {stated_s:.9g} s, that of the run {sample_period_s:.9g} s')
    repeat_from = settings.get('repeat_from')
    if repeat_from is not None and not float(repeat_from).is_integer():
        raise MotionTableError(f'repeat_from is {repeat_from}, it must be an integer')
    return MotionTable(
        columns['reference_um'], columns.get('command_um'), sample_period_s,
        None if repeat_from is None else int(repeat_from))


def _period_of(time_s: _Floats) -> float:
    steps_s = np.diff(time_s)
    if not steps_s.size or not np.isfinite(steps_s).all():
        raise MotionTableError('time_s is not finite')
    period_s = float((time_s[-1] - time_s[0]) / steps_s.size)
    uneven = np.abs(steps_s - period_s) > 1e-3 * abs(period_s)
    if not period_s > 0.0 or uneven.any():
        place = int(np.argmax(uneven))
        raise MotionTableError(
            f'time_s steps by {steps_s[place]:g} s at sample {place}, on average by '
            f'{period_s:g} s; it must ascend evenly')
    return period_s


def _read_npz(path: Path) -> tuple[dict[str, _Floats], dict[str, float]]:
    import zipfile  # here: every trajectory node imports this module, few read such a file
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise MotionTableError(f'it is no NPZ file of numbers ({error})') from None
    for name, values in arrays.items():
        if name not in (*_COLUMNS, *_SETTINGS):
            raise MotionTableError(
                f'it has an array {name!r}, allowed are {", ".join((*_COLUMNS, *_SETTINGS))}')
        dimensions = 0 if name in _SETTINGS else 1
        if values.ndim != dimensions or values.dtype.kind not in 'fiu':
            raise MotionTableError(
                f'{name} is of {values.ndim} dimensions and type {values.dtype}, it must be '
                f'{"a number" if dimensions == 0 else "a list of numbers"}')
    return (
        {name: np.ascontiguousarray(arrays[name], dtype=np.float64)
         for name in _COLUMNS if name in arrays},
        {name: float(arrays[name]) for name in _SETTINGS if name in arrays})


def _read_csv(path: Path) -> tuple[dict[str, _Floats], dict[str, float]]:
    settings: dict[str, float] = {}
    names: list[str] | None = None
    rows: list[list[float]] = []
    try:
        with path.open(encoding='utf-8-sig') as file:
            for number, line in enumerate(file, start=1):
                text = line.strip()
                if not text:
                    continue
                if text.startswith('#'):
                    _take_setting(settings, text.lstrip('# '), number)
                elif names is None:
                    names = _header(text, number)
                else:
                    rows.append(_row(text, names, number))
    except UnicodeDecodeError:
        raise MotionTableError('it is no text') from None
    if names is None:
        raise MotionTableError(f'it has no header; allowed columns are {", ".join(_COLUMNS)}')
    values = np.array(rows, dtype=np.float64).reshape(-1, len(names))
    return {name: values[:, place].copy() for place, name in enumerate(names)}, settings


def _take_setting(settings: dict[str, float], text: str, number: int) -> None:
    name, colon, value = (part.strip() for part in text.partition(':'))
    if not colon or name not in _SETTINGS:
        return  # a comment
    try:
        settings[name] = float(value)
    except ValueError:
        raise MotionTableError(f'line {number}: {name} is {value!r}, no number') from None


def _header(text: str, number: int) -> list[str]:
    names = [name.strip() for name in text.split(',')]
    for name in names:
        if name not in _COLUMNS:
            raise MotionTableError(
                f'line {number}: column {name!r}, allowed are {", ".join(_COLUMNS)}')
    if len(set(names)) != len(names):
        raise MotionTableError(f'line {number}: a column is there twice')
    return names


def _row(text: str, names: list[str], number: int) -> list[float]:
    cells = text.split(',')
    if len(cells) != len(names):
        raise MotionTableError(
            f'line {number} has {len(cells)} values, the header {len(names)}')
    try:
        return [float(cell) for cell in cells]
    except ValueError:
        raise MotionTableError(f'line {number}: {text[:60]!r} is no list of numbers') from None
