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
What a bag says of its run: the metadata record 'piezo_ros' and the parameters of the nodes.

Both may come several times in a bag, as more is learned during the run; later entries win.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import yaml
from mcap.records import Attachment, Metadata

from piezo_ros.bag.errors import BagError
from piezo_ros.bag.topics import NAMESPACE_KEY, TOPIC_KEY

__all__ = [
    'FORMAT_VERSION',
    'LOST_KEY',
    'PARAMETERS_NAME',
    'RECORD_NAME',
    'checked_metadata',
    'recorded_metadata',
    'recorded_parameters',
]

FORMAT_VERSION: Final = '1'
RECORD_NAME: Final = 'piezo_ros'
PARAMETERS_NAME: Final = 'parameters.yaml'
LOST_KEY: Final = 'lost'  # entry in which a salvaged bag names its losses


def checked_metadata(metadata: Mapping[str, str]) -> dict[str, str]:
    """
    Return the entries of a metadata record to write, with the format version.

    Raises
    ------
    ValueError
        If an entry is no string, or is one of those that the writer makes.

    """
    for key, value in metadata.items():
        if not isinstance(value, str):
            raise ValueError(f'metadata entry {key!r} is {value!r}, it must be a string')
        if key in ('format_version', NAMESPACE_KEY) or key.startswith(TOPIC_KEY):
            raise ValueError(f"metadata entry {key!r} is the writer's own")
    return {**metadata, 'format_version': FORMAT_VERSION}


def recorded_metadata(path: Path, records: Iterable[Metadata]) -> dict[str, str]:
    """
    Return the entries of the metadata records of this package; empty if there is none.

    Raises
    ------
    BagError
        If one of them has another format version.

    """
    entries: dict[str, str] = {}
    for record in records:
        if record.name == RECORD_NAME:
            version = record.metadata.get('format_version')
            if version != FORMAT_VERSION:
                raise BagError(
                    f'{path} has the format_version {version!r}, this release reads '
                    f'{FORMAT_VERSION!r}')
            entries.update(record.metadata)
    return entries


def recorded_parameters(
    path: Path, attachments: Iterable[Attachment],
) -> dict[str, dict[str, Any]]:
    """
    Return the attached parameters by node.

    Raises
    ------
    BagError
        If an attachment of that name is no ROS parameter file.

    """
    parameters: dict[str, dict[str, Any]] = {}
    for attachment in attachments:
        if attachment.name != PARAMETERS_NAME:
            continue
        try:
            nodes = yaml.load(attachment.data, getattr(yaml, 'CSafeLoader', yaml.SafeLoader)) or {}
            for node, content in nodes.items():
                parameters.setdefault(node, {}).update(content['ros__parameters'] or {})
        except (yaml.YAMLError, AttributeError, KeyError, TypeError, ValueError) as error:
            raise BagError(
                f'{path}: the attachment {PARAMETERS_NAME} is no ROS parameter file '
                f'({error})') from error
    return parameters
