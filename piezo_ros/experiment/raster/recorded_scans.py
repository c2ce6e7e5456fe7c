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
"""The scans in the output of a plan: their record, and their images."""

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from piezo_ros.bag import read
from piezo_ros.experiment.plan.raster_scan import AXES, FAST, SLOW
from piezo_ros.report.files import write_atomically
from piezo_ros.report.scanned_image import ScannedImage, scanned_image

__all__ = ['ScanRecord', 'has_scans', 'imaged', 'recorded_scans', 'write_records']

_RECORD: Final = 'scans.json'
_FORMAT_VERSION: Final = 1


@dataclass(frozen=True)
class ScanRecord:
    """
    What is kept of a scan beside its bags.

    Attributes
    ----------
    name, case, variant : str
        As `ScannedImage` has them.
    pixels : int
        Pixels of a line.
    central : float
        Share of a line that is in the image.

    """

    name: str
    case: str
    variant: str
    pixels: int
    central: float

    def __post_init__(self) -> None:
        for field, kind in self.__annotations__.items():
            if not isinstance(getattr(self, field), kind):
                raise ValueError(f'{field} is {getattr(self, field)!r}, no {kind.__name__}')
        if Path(self.name).name != self.name:
            raise ValueError(f'name is {self.name!r}, it must be that of a directory')


def write_records(directory: Path, records: Sequence[ScanRecord]) -> None:
    """Write the record of the scans in an output directory."""
    write_atomically(directory / _RECORD, json.dumps({
        'format_version': _FORMAT_VERSION, 'scans': [asdict(record) for record in records],
    }, indent=2) + '\n')


def has_scans(directory: Path) -> bool:
    """Return whether a directory is the output of a plan with raster scans."""
    return (directory / _RECORD).is_file()


def recorded_scans(directory: Path, output: Path) -> list[ScannedImage]:
    """
    Return the images of the scans in an output directory.

    Parameters
    ----------
    directory : Path
        The output of a plan with raster scans.
    output : Path
        Directory of the new report, to which the paths of the bags are relative.

    Raises
    ------
    BagError
        If a bag cannot be read.
    ValueError
        If the record of the scans is damaged.

    """
    path = directory / _RECORD
    try:
        content = json.loads(path.read_text(encoding='utf-8'))
        records = [ScanRecord(**record) for record in content['scans']]
        version = content['format_version']
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f'{path} is damaged: {error}') from None
    if version != _FORMAT_VERSION:
        raise ValueError(
            f'{path}: format_version is {version!r}, only {_FORMAT_VERSION} is known')
    return [imaged(directory, output, record) for record in records]


def imaged(directory: Path, output: Path, record: ScanRecord) -> ScannedImage:
    """
    Return the images of one scan.

    Parameters
    ----------
    directory : Path
        Where its bags are.
    output : Path
        Directory of the report.
    record : ScanRecord
        What is kept of it.

    Raises
    ------
    BagError
        If a bag cannot be read.
    ValueError
        If the bags are no raster scan.

    """
    bags = {axis: directory / 'bags' / record.name / axis for axis in AXES}
    return scanned_image(
        read(bags[FAST]), read(bags[SLOW]), name=record.name, case=record.case,
        variant=record.variant, pixels=record.pixels, central=record.central,
        bags=(os.path.relpath(bags[FAST], output), os.path.relpath(bags[SLOW], output)))
