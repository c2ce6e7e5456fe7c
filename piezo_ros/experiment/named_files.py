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

"""The files that plans, parameter files and models name."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import yaml

from piezo_ros.experiment.motion_files import MOTION_KEY, motion_file
from piezo_ros.parameters.bounded_yaml import MAXIMUM_BYTES, YamlError, yaml_content

__all__ = ['FILE_KEYS', 'file_nodes', 'named_files']

# Keys of a plan of which the values are files, named from the folder of the plan.
FILE_KEYS: Final = (
    'parameter_files', 'known_rig_files', 'model_rig_files', 'uncertainty_bound_file', MOTION_KEY)
_POINTS_KEY: Final = 'points_file'  # of a model
_CHANGES_KEY: Final = 'file_changes'  # of a trajectory; a text that is itself YAML
_IN_EVERY_KEY: Final = b'file'


def file_nodes(
    root: Any, keys: tuple[str, ...] = FILE_KEYS,
) -> Iterator[tuple[str, yaml.ScalarNode]]:
    """
    Yield the scalars of a YAML text that are values of certain keys, each with its key.

    Parameters
    ----------
    root : yaml.Node or None
        The text as PyYAML composes it.
    keys : tuple of str, optional
        The keys, those that name files by default. Each scalar of a list counts.

    """
    if isinstance(root, yaml.MappingNode):
        for key, value in root.value:
            if key.value in keys:
                each = value.value if isinstance(value, yaml.SequenceNode) else [value]
                yield from ((key.value, item) for item in each if isinstance(item, yaml.ScalarNode))
            else:
                yield from file_nodes(value, keys)
    elif isinstance(root, yaml.SequenceNode):
        for item in root.value:
            yield from file_nodes(item, keys)


def named_files(source: Path) -> Iterator[Path]:
    """
    Yield the files that a plan, a parameter file or a model names, and those that these name.

    Nothing is said of what is no YAML or does not exist: the command that reads it says so.

    Parameters
    ----------
    source : Path
        Any file; a bag or a table names none.

    """
    unread, found = [source], {source}
    while unread:
        for file in _named_in(unread.pop()):
            if file not in found and file.is_file():
                found.add(file)
                unread.append(file)
                yield file


def _named_in(source: Path) -> Iterator[Path]:
    nodes = file_nodes(_composed(_bytes_of(source)), (*FILE_KEYS, _POINTS_KEY, _CHANGES_KEY))
    for key, node in nodes:
        name = str(node.value)
        if key == _CHANGES_KEY:
            for _, inner in file_nodes(_composed(name.encode())):
                yield motion_file(source.parent, str(inner.value))
        else:
            is_motion = key == MOTION_KEY
            yield motion_file(source.parent, name) if is_motion else source.parent / name


def _bytes_of(source: Path) -> bytes:
    """Return the content of a file, nothing where it is none or is too large for YAML."""
    try:
        if not source.is_file() or source.stat().st_size > MAXIMUM_BYTES:
            return b''
        return source.read_bytes()
    except OSError:
        return b''


def _composed(content: bytes) -> yaml.Node | None:
    """Return the root of a YAML text, None where it is none or names no file."""
    if _IN_EVERY_KEY not in content or b'\0' in content:
        return None
    try:
        yaml_content(content)  # within bounds, and nothing lies in itself
        root: yaml.Node | None = yaml.compose(content, Loader=yaml.SafeLoader)
    except (YamlError, yaml.YAMLError, ValueError):
        return None
    return root
