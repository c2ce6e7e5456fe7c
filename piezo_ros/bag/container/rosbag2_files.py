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

"""Search for the MCAP files of a bag, and what its ``metadata.yaml`` says of them."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from piezo_ros.bag.bag_error import BagError
from piezo_ros.parameters.bounded_yaml import MAXIMUM_BYTES, YamlError, yaml_content

__all__ = ['BagFiles', 'bag_files', 'metadata_entries']


class BagFiles(NamedTuple):
    """
    The MCAP files of a bag.

    Attributes
    ----------
    paths : list of Path
        The files, in the order of their recording; at least one.
    lost : list of str
        Sentences that name the files that are missing.
    messages : dict of str to int
        Topic to the number of its messages in all files, as ``metadata.yaml`` counts them.

    """

    paths: list[Path]
    lost: list[str]
    messages: dict[str, int]


class _Listed(NamedTuple):
    """What ``metadata.yaml`` says."""

    storage: str
    compression_mode: str
    names: list[str]
    messages: dict[str, int]


def bag_files(path: Path) -> BagFiles:
    """
    Return the MCAP files of a bag.

    Parameters
    ----------
    path : Path
        A rosbag2 directory, with or without ``metadata.yaml``, or one MCAP file.

    Raises
    ------
    BagError
        If there is no such path, no MCAP file, or files are stored in another way.

    """
    if path.is_file():
        return BagFiles([path], [], {})
    if not path.is_dir():
        raise BagError(
            f'{path} is no file and no directory' if path.exists() else f'there is no bag {path}')
    listed = _listed(path)
    if listed is not None and listed.names:
        return _existing(path, listed)
    files = sorted(path.glob('*.mcap'), key=_recording_order)
    for file in files:
        # A pipe would be waited for without end.
        if not file.is_file():
            raise BagError(f'{file} is no regular file')
    if not files:
        raise BagError(f'{path} is no bag with MCAP storage: it has {_other_files(path)}')
    return BagFiles(files, [], {} if listed is None else listed.messages)


def _existing(path: Path, listed: _Listed) -> BagFiles:
    """Return those of the listed files that are there."""
    # ros2 bag reindex of Humble leaves the storage empty.
    by_name = all(name.endswith('.mcap') for name in listed.names)
    if listed.storage != 'mcap' and not (listed.storage == '' and by_name):
        raise BagError(
            f'{path} has the storage {listed.storage!r}, only mcap is read; `ros2 bag convert` '
            'turns one into the other')
    if listed.compression_mode.lower() not in ('', 'none'):
        raise BagError(
            f'{path} is compressed by rosbag2 (compression_mode {listed.compression_mode}), only '
            'the compression within MCAP is read; `ros2 bag convert` turns one into the other')
    present = [name for name in listed.names if _is_file(path / name)]
    missing = [name for name in listed.names if name not in present]
    if not present:
        raise BagError(f'{path} lacks the file {missing[0]} that its metadata.yaml names')
    return BagFiles(
        [path / name for name in present],
        [f'the file {name} that metadata.yaml names is missing' for name in missing],
        listed.messages)


def _is_file(path: Path) -> bool:
    """Return whether there is such a file; a name may be too long for one."""
    try:
        return path.is_file()
    except OSError:
        return False


def _other_files(path: Path) -> str:
    """Return the files of other formats in a directory, with the tool that converts them."""
    databases = ', '.join(file.name for file in sorted(path.glob('*.db3')))
    if databases:
        return f'{databases} (sqlite3), `ros2 bag convert` turns it into one'
    ros1 = ', '.join(file.name for file in sorted(path.glob('*.bag')))
    if ros1:
        return f'{ros1} (ROS 1), `rosbags-convert --dst-storage mcap` turns it into one'
    return 'no *.mcap file'


def _recording_order(file: Path) -> list[tuple[int, str]]:
    """Return a key by which bag_10.mcap comes behind bag_9.mcap."""
    return [
        (int(part), '') if part.isdecimal() else (-1, part)
        for part in re.split(r'(\d+)', file.stem)
    ]


def metadata_entries(path: Path) -> Mapping[Any, Any] | None:
    """
    Return what ``metadata.yaml`` says, unchecked.

    Parameters
    ----------
    path : Path
        The bag, a directory.

    Returns
    -------
    mapping or None
        The entries by their keys; None if the file is missing, empty, no regular file or of
        another form.

    """
    file = path / 'metadata.yaml'
    if not file.is_file():
        return None  # a pipe would keep the reader waiting
    try:
        with file.open('rb') as stream:
            content = yaml_content(stream.read(MAXIMUM_BYTES + 1))
    except (OSError, YamlError):
        return None  # a recorder that was killed leaves no whole metadata.yaml
    entries = content.get('rosbag2_bagfile_information') if isinstance(content, Mapping) else None
    return entries if isinstance(entries, Mapping) else None


def _listed(path: Path) -> _Listed | None:
    """Return what ``metadata.yaml`` says of the files, None if it is not of its form."""
    entries = metadata_entries(path)
    if entries is None:
        return None
    storage = entries.get('storage_identifier')
    mode = entries.get('compression_mode') or ''
    names = entries.get('relative_file_paths')
    if not isinstance(storage, str) or not isinstance(mode, str) or not isinstance(names, list):
        return None
    if not all(isinstance(name, str) for name in names):
        return None
    return _Listed(
        storage, mode, list(dict.fromkeys(Path(name).name for name in names)),
        _message_counts(entries.get('topics_with_message_count')))


def _message_counts(topics: Any) -> dict[str, int]:
    """Return the numbers of messages in ``metadata.yaml``, none where they have another form."""
    counts: dict[str, int] = {}
    for entry in topics if isinstance(topics, list) else []:
        topic = entry.get('topic_metadata') if isinstance(entry, Mapping) else None
        name = topic.get('name') if isinstance(topic, Mapping) else None
        count = entry.get('message_count') if isinstance(entry, Mapping) else None
        if isinstance(name, str) and isinstance(count, int):
            counts[name] = counts.get(name, 0) + count
    return counts
