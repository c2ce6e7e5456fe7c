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

"""The samples of a bag as a table that other programs read: CSV, MATLAB, HDF5, NumPy, Parquet."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag.recording import Recording
from piezo_ros.bag.tables.table import TableError, missing_library
from piezo_ros.parameters.errors import PlanError
from piezo_ros.streams import STREAMS
from piezo_ros.streams.names import label_of

__all__ = ['EXPORT_SUFFIXES', 'check_export_suffix', 'export_table']

_AT_ONCE: Final = 100_000  # samples
_LONGEST_MAT: Final = (1 << 31) // 8 - 1  # samples of an array of MATLAB v5
_UNITS: Final = {'time_s': 's', **{
    label_of(stream): 'V' if unit == 'v' else unit for stream, unit in STREAMS.items()}}

_Columns = dict[str, NDArray[np.float64]]


def _pieces(recording: Recording) -> Iterator[_Columns]:
    names = _names(recording)
    for piece in recording.pieces(_AT_ONCE):
        yield {name: getattr(piece, name) for name in names}


def _names(recording: Recording) -> list[str]:
    return ['time_s', *map(label_of, recording.streams)]


def _whole(recording: Recording) -> _Columns:
    pieces = list(_pieces(recording))
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}


def _write_csv(recording: Recording, path: Path) -> None:
    with path.open('w', encoding='utf-8') as file:
        file.write(','.join(_names(recording)) + '\n')
        for piece in _pieces(recording):
            # 17 significant digits: the same bits come back.
            np.savetxt(file, np.column_stack(list(piece.values())), fmt='%.17g', delimiter=',')


def _write_mat(recording: Recording, path: Path) -> None:
    from scipy.io import savemat
    if recording.samples > _LONGEST_MAT:
        raise TableError(
            f'{recording.path} has {recording.samples} samples, an array of a .mat file at most '
            f'{_LONGEST_MAT}; .h5 takes them, which MATLAB reads by h5read')
    columns = {name: values[:, np.newaxis] for name, values in _whole(recording).items()}
    with path.open('wb') as file:
        arrays = {**columns, 'sample_period_s': recording.sample_period_s}
        savemat(file, arrays)  # type: ignore[arg-type, unused-ignore]


def _write_npz(recording: Recording, path: Path) -> None:
    with path.open('wb') as file:
        np.savez(file, **_whole(recording), sample_period_s=recording.sample_period_s)  # type: ignore[arg-type]


def _write_hdf5(recording: Recording, path: Path) -> None:
    try:
        import h5py
    except ImportError:
        raise missing_library(path.with_suffix('.h5'), 'h5py') from None
    with h5py.File(path, 'w') as file:
        file.attrs['sample_period_s'] = recording.sample_period_s
        file.attrs['namespace'] = recording.namespace
        for name in _names(recording):
            data = file.create_dataset(
                name, shape=(recording.samples,), dtype=np.float64, chunks=True,
                compression='gzip', shuffle=True)
            data.attrs['units'] = _UNITS[name]
        start = 0
        for piece in _pieces(recording):
            for name, values in piece.items():
                file[name][start:start + values.size] = values
            start += piece['time_s'].size


def _write_parquet(recording: Recording, path: Path) -> None:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise missing_library(path.with_suffix('.parquet'), 'pyarrow') from None
    schema = pyarrow.schema(
        [pyarrow.field(name, pyarrow.float64(), metadata={'units': _UNITS[name]})
         for name in _names(recording)],
        metadata={
            'sample_period_s': repr(recording.sample_period_s),
            'namespace': recording.namespace})
    with parquet.ParquetWriter(path, schema) as writer:
        for piece in _pieces(recording):
            writer.write_table(pyarrow.table(piece, schema=schema))


_WRITERS: Final[Mapping[str, Callable[[Recording, Path], None]]] = {
    '.csv': _write_csv, '.mat': _write_mat, '.h5': _write_hdf5, '.hdf5': _write_hdf5,
    '.npz': _write_npz, '.parquet': _write_parquet,
}
EXPORT_SUFFIXES: Final = tuple(_WRITERS)


def check_export_suffix(path: Path) -> None:
    """
    Refuse a file of a kind that is not written.

    Raises
    ------
    PlanError
        If its suffix is none of `EXPORT_SUFFIXES`.

    """
    if path.suffix.lower() not in _WRITERS:
        raise PlanError(
            f'-o {path} ends in {path.suffix or "no suffix"!r}, allowed are '
            f'{", ".join(EXPORT_SUFFIXES)}')


def export_table(recording: Recording, unfinished: Path, suffix: str) -> None:
    """
    Write the aligned samples of a run; the suffix tells as what.

    Parameters
    ----------
    recording : Recording
        The run. CSV, HDF5 and Parquet are written piece by piece, the others from the memory.
    unfinished : Path
        Where to write, under any name.
    suffix : str
        One of `EXPORT_SUFFIXES`.

    Raises
    ------
    TableError
        If the library for it is missing, or the run is too long for it.
    BagError
        If the bag cannot be read.

    """
    _WRITERS[suffix.lower()](recording, unfinished)
