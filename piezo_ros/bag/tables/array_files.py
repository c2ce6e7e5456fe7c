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

"""Tables in files of arrays: MATLAB (v5 and v7.3), HDF5, TDMS, NumPy and Parquet."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag.tables.table import (
    Column,
    Table,
    TableError,
    columns_of_array,
    missing_library,
)
from piezo_ros.bag.tables.units import unit_of_name

__all__ = ['READERS']

_HDF5_MAGIC: Final = b'\x89HDF\r\n\x1a\n'
_UNIT_ATTRIBUTES: Final = ('units', 'unit', 'Units', 'Unit', 'unit_string')
_DEEPEST: Final = 8  # structures within structures


def read_mat(path: Path) -> Table:
    """Find the arrays of a MATLAB file of any version, those in structures as ``s.field``."""
    with path.open('rb') as file:
        head = file.read(520)
    # v7.3 is HDF5 behind a user block of 512 bytes.
    if head[512:].startswith(_HDF5_MAGIC) or head.startswith(_HDF5_MAGIC):
        return read_hdf5(path)
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError
    try:
        content = loadmat(path, struct_as_record=True)
    except (MatReadError, ValueError, TypeError, NotImplementedError, KeyError, EOFError) as error:
        raise TableError(f'{path} is no MATLAB file that can be read: {error}') from None
    return Table(path, tuple(
        column for name, value in content.items() if not name.startswith('__')
        for column in _columns_of_value(name, value)))


def _columns_of_value(name: str, value: Any, depth: int = 0) -> Iterator[Column]:
    array = np.asarray(value)
    if array.dtype.names and array.size == 1 and depth < _DEEPEST:
        for key in array.dtype.names:
            yield from _columns_of_value(f'{name}.{key}', array.ravel()[0][key], depth + 1)
    elif array.dtype.names and array.ndim <= 2:
        for key in array.dtype.names:
            yield from _plain_columns(f'{name}.{key}', array[key])
    elif array.dtype == object and array.size == 1 and depth < _DEEPEST:
        yield from _columns_of_value(name, array.ravel()[0], depth + 1)
    else:
        yield from _plain_columns(name, array)


def _plain_columns(name: str, array: NDArray[Any], unit: str | None = None) -> list[Column]:
    if not _is_real(array.dtype):
        return []
    return columns_of_array(name, array.shape, lambda: array, unit or unit_of_name(name))


def _is_real(dtype: Any) -> bool:
    return bool(np.issubdtype(dtype, np.integer) or np.issubdtype(dtype, np.floating))


def read_hdf5(path: Path) -> Table:
    """Find the arrays of an HDF5 file, by their paths."""
    try:
        import h5py
    except ImportError:
        raise missing_library(path, 'h5py') from None
    columns: list[Column] = []

    def reader(name: str, key: str | None) -> Callable[[], NDArray[Any]]:
        def read() -> NDArray[Any]:
            with h5py.File(path, 'r') as file:
                data = file[name]
                return np.asarray(data[()] if key is None else data[key])
        return read

    def visit(name: str, found: Any) -> None:
        if not isinstance(found, h5py.Dataset) or name.startswith('#refs#'):
            return
        attributes = found.attrs
        if attributes.get('MATLAB_class', b'double') in (b'char', b'cell', b'logical'):
            return
        shown = name.replace('/', '.') if 'MATLAB_class' in attributes else name
        if found.dtype.names:
            for key in found.dtype.names:
                if _is_real(found.dtype[key]) and found.ndim == 1:
                    columns.append(Column(
                        f'{shown}.{key}', reader(name, key), unit_of_name(key)))
        elif _is_real(found.dtype):
            columns.extend(columns_of_array(
                shown, found.shape, reader(name, None),
                _told_unit(attributes) or unit_of_name(shown)))

    try:
        with h5py.File(path, 'r') as file:
            file.visititems(visit)
    except (OSError, RuntimeError) as error:
        raise TableError(f'{path} is no HDF5 file that can be read: {error}') from None
    return Table(path, tuple(columns))


def _told_unit(attributes: Mapping[str, Any]) -> str | None:
    for name in _UNIT_ATTRIBUTES:
        if name in attributes:
            unit = attributes[name]
            return unit.decode(errors='replace') if isinstance(unit, bytes) else str(unit)
    return None


def read_tdms(path: Path) -> Table:
    """Find the channels of a TDMS file, as ``group/channel``, with their sample periods."""
    try:
        from nptdms import TdmsFile
    except ImportError:
        raise missing_library(path, 'npTDMS') from None

    def reader(group: str, channel: str) -> Callable[[], NDArray[Any]]:
        def read() -> NDArray[Any]:
            with TdmsFile.open(path) as file:
                return np.asarray(file[group][channel][:])
        return read

    columns = []
    try:
        with TdmsFile.open(path) as file:
            for group in file.groups():
                for channel in group.channels():
                    if not _is_real(np.dtype(channel.dtype or object)):
                        continue
                    name = f'{group.name}/{channel.name}'
                    period_s = channel.properties.get('wf_increment')
                    columns.append(Column(
                        name, reader(group.name, channel.name),
                        _told_unit(channel.properties) or unit_of_name(channel.name),
                        float(period_s) if period_s else None))
    except (ValueError, KeyError, EOFError, TypeError, IndexError) as error:
        raise TableError(f'{path} is no TDMS file that can be read: {error}') from None
    return Table(path, tuple(columns))


def read_numpy(path: Path) -> Table:
    """Find the arrays of an ``.npz`` file, or the columns of the one of an ``.npy`` file."""
    try:
        content = np.load(path, allow_pickle=False)
        if isinstance(content, np.ndarray):
            content = {path.stem: content}
        return Table(path, tuple(
            column for name in content for column in _columns_of_value(name, content[name])))
    except TableError:
        raise
    except (ValueError, EOFError, KeyError, OSError) as error:
        if isinstance(error, FileNotFoundError | PermissionError | IsADirectoryError):
            raise
        raise TableError(f'{path} is no NumPy file that can be read: {error}') from None


def read_parquet(path: Path) -> Table:
    """Find the columns of a Parquet file."""
    try:
        from pyarrow import ArrowException, parquet
    except ImportError:
        raise missing_library(path, 'pyarrow') from None

    def reader(name: str) -> Callable[[], NDArray[Any]]:
        return lambda: parquet.read_table(path, columns=[name])[name].to_numpy()

    try:
        schema = parquet.read_schema(path)
    except ArrowException as error:
        raise TableError(f'{path} is no Parquet file that can be read: {error}') from None
    return Table(path, tuple(
        Column(name, reader(name), unit_of_name(name)) for name in schema.names))


READERS: Final[Mapping[str, Callable[[Path], Table]]] = {
    '.mat': read_mat, '.h5': read_hdf5, '.hdf5': read_hdf5, '.tdms': read_tdms,
    '.npz': read_numpy, '.npy': read_numpy, '.parquet': read_parquet,
}
