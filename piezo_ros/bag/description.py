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

Both may come several times in a bag, as more is learned during the run; later entries win. MCAP has
a checksum for attachments but none for metadata, therefore the record carries a digest of its own.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from mcap.records import Attachment, Metadata

from piezo_ros.bag.bag_error import BagError
from piezo_ros.bag.recorded_topics import NAMESPACE_KEY, TOPIC_KEY
from piezo_ros.parameters.bounded_yaml import YamlError, yaml_content

__all__ = [
    'FORMAT_VERSION',
    'LOST_KEY',
    'PARAMETERS_NAME',
    'RECORD_NAME',
    'checked_metadata',
    'intact_records',
    'recorded_metadata',
    'recorded_parameters',
    'with_digest',
]

FORMAT_VERSION: Final = '1'
RECORD_NAME: Final = 'piezo_ros'
PARAMETERS_NAME: Final = 'parameters.yaml'
LOST_KEY: Final = 'lost'  # entry in which a salvaged bag names its losses
_DIGEST_KEY: Final = 'digest'


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
        if key in ('format_version', NAMESPACE_KEY, _DIGEST_KEY) or key.startswith(TOPIC_KEY):
            raise ValueError(f"metadata entry {key!r} is the writer's own")
    return {**metadata, 'format_version': FORMAT_VERSION}


def with_digest(entries: Mapping[str, str]) -> dict[str, str]:
    """Return the entries of a metadata record with their digest."""
    return {**entries, _DIGEST_KEY: _digest(entries)}


def _digest(entries: Mapping[str, str]) -> str:
    text = json.dumps(sorted(entries.items()))
    return f'sha256:{hashlib.sha256(text.encode()).hexdigest()}'


def intact_records(records: Iterable[Metadata]) -> tuple[list[Metadata], list[str]]:
    """
    Return metadata records without those of this package that have changed since.

    Parameters
    ----------
    records : iterable of Metadata
        Records of any name.

    Returns
    -------
    intact : list of Metadata
        The others, without their digests; a record of this package without one is intact.
    lost : list of str
        A sentence that says how many have another digest than they should; empty for none.

    """
    intact, damaged = [], 0
    for record in records:
        if record.name == RECORD_NAME:
            entries = dict(record.metadata)
            digest = entries.pop(_DIGEST_KEY, None)
            if digest not in (None, _digest(entries)):
                damaged += 1
                continue
            record = Metadata(name=record.name, metadata=entries)
        intact.append(record)
    lost = [f'{damaged} metadata records of piezo_ros with a wrong digest'] if damaged else []
    return intact, lost


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
            sections = _sections(yaml_content(attachment.data))
        except (YamlError, _OtherFormError) as error:
            raise BagError(
                f'{path}: the attachment {PARAMETERS_NAME} is no ROS parameter file '
                f'({error})') from error
        for node, values in sections.items():
            parameters.setdefault(node, {}).update(values)
    return parameters


class _OtherFormError(ValueError):
    """YAML that is no ROS parameter file."""


def _sections(content: Any) -> dict[str, Mapping[str, Any]]:
    """Return node name to parameters of a ROS parameter file without nested namespaces."""
    sections: dict[str, Mapping[str, Any]] = {}
    if not isinstance(content or {}, Mapping):
        raise _OtherFormError('the top level is no mapping')
    for node, section in (content or {}).items():
        if not isinstance(section, Mapping) or 'ros__parameters' not in section:
            raise _OtherFormError(f'{node!r} has no mapping ros__parameters')
        values = section['ros__parameters'] or {}
        if not isinstance(values, Mapping) or not all(
                isinstance(name, str) for name in (node, *values)):
            raise _OtherFormError(f'the parameters of {node!r} are no mapping of names')
        sections[node] = values
    return sections
