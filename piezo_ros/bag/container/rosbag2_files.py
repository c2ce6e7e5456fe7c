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

"""Search for the MCAP files of a bag."""

import re
from pathlib import Path
from typing import Any

import yaml

from piezo_ros.bag.errors import BagError

__all__ = ['mcap_files']


def mcap_files(path: Path) -> list[Path]:
    """
    Return the MCAP files of a bag in the order of their recording.

    Parameters
    ----------
    path : Path
        A rosbag2 directory, with or without ``metadata.yaml``, or one MCAP file.

    Returns
    -------
    list of Path
        At least one file.

    Raises
    ------
    BagError
        If there is no such path, no MCAP file, or files are stored in another way.

    """
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise BagError(f'there is no bag {path}')
    listed = _listed(path)
    files = sorted(path.glob('*.mcap'), key=_recording_order) if listed is None else listed
    if not files:
        databases = ', '.join(file.name for file in sorted(path.glob('*.db3')))
        raise BagError(
            f'{path} is no bag with MCAP storage: it has {databases or "no *.mcap file"}')
    return files


def _recording_order(file: Path) -> list[tuple[int, str]]:
    """Return a key by which bag_10.mcap comes behind bag_9.mcap."""
    return [
        (int(part), '') if part.isdecimal() else (-1, part)
        for part in re.split(r'(\d+)', file.stem)
    ]


def _listed(path: Path) -> list[Path] | None:
    """Return the files named in ``metadata.yaml``, None if it is missing or empty."""
    try:
        text = (path / 'metadata.yaml').read_text(encoding='utf-8')
        entries: dict[str, Any] = yaml.load(
            text, getattr(yaml, 'CSafeLoader', yaml.SafeLoader))['rosbag2_bagfile_information']
        storage = entries['storage_identifier']
        mode = entries.get('compression_mode') or ''
        names = [Path(name).name for name in entries['relative_file_paths']]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError, AttributeError):
        return None  # a recorder that was killed leaves no whole metadata.yaml
    if storage != 'mcap':
        raise BagError(
            f'{path} has the storage {storage!r}, only mcap is read; `ros2 bag convert` '
            'turns one into the other')
    if mode.lower() not in ('', 'none'):
        raise BagError(
            f'{path} is compressed by rosbag2 (compression_mode {mode}), only the '
            'compression within MCAP is read; `ros2 bag convert` turns one into the other')
    missing = [name for name in names if not (path / name).is_file()]
    if missing:
        raise BagError(f'{path} lacks the file {missing[0]} that its metadata.yaml names')
    return [path / name for name in names]
