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

"""Salvage of a bag that was cut off or damaged."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml
from mcap.records import Attachment, Channel, Metadata

from piezo_ros.bag.container.chunk_scan import HEAD_BYTES, MESSAGE_HEAD_BYTES
from piezo_ros.bag.container.mcap_file import McapFile
from piezo_ros.bag.container.rosbag2_files import mcap_files
from piezo_ros.bag.container.rosbag2_writer import Rosbag2Writer, Topic
from piezo_ros.bag.description import FORMAT_VERSION, LOST_KEY, RECORD_NAME
from piezo_ros.bag.errors import BagError
from piezo_ros.bag.topics import remapped_part

__all__ = ['Salvage', 'salvage']

_ROSBAG2_RECORD: Final = 'rosbag2'  # counts of the cut bag; the new bag has its own
_read_message_head = struct.Struct('<xQHIQQ').unpack_from


@dataclass(frozen=True)
class Salvage:
    """
    Result of a salvage.

    Attributes
    ----------
    path : Path
        The new bag.
    messages : dict of str to int
        Topic to number of messages in it.
    lost : tuple of str
        Sentences that name the losses; empty if the bag was whole.

    """

    path: Path
    messages: dict[str, int]
    lost: tuple[str, ...]


def salvage(path: Path | str, output: Path | str, *, compression: str = 'zstd') -> Salvage:
    """
    Write a new whole bag with everything that is whole in a cut or damaged one.

    All topics are kept, with their log times, and so are metadata and attachments. Of a chunk that
    is cut off the whole messages are kept if it is uncompressed, else none. The losses are also
    noted in the new bag, where `read` finds them.

    Parameters
    ----------
    path : Path or str
        A rosbag2 directory with MCAP storage, with or without ``metadata.yaml``, or an MCAP file.
    output : Path or str
        The directory to write; must not exist.
    compression : str, optional
        Compression of the new chunks: ``zstd``, ``lz4`` or ``none``.

    Returns
    -------
    Salvage
        Numbers of messages, and the losses.

    Raises
    ------
    BagExistsError
        If the output exists.
    BagError
        If the bag cannot be read, no message in it is whole, or the output cannot be written.

    """
    files = mcap_files(Path(path))
    # Read twice, because the new bag begins with the losses and the channels, which are known
    # only at the end.
    survey = _Survey()
    for file in files:
        survey.add(file)
    if not survey.messages:
        raise BagError(f'{path} holds no whole message: {"; ".join(survey.lost)}')
    records = survey.records()
    with Rosbag2Writer(Path(output), compression=compression, custom_data=records[0]) as bag:
        for record in records:
            if record:
                bag.add_metadata(RECORD_NAME, record)
        for metadata in survey.metadata:
            bag.add_metadata(metadata.name, metadata.metadata)
        for attachment in survey.attachments:
            bag.add_attachment(attachment.name, attachment.media_type, attachment.data)
        numbers = {topic.name: bag.add_topic(topic) for topic in survey.topics.values()}
        for file in files:
            for name, log_time_ns, publish_time_ns, data in _messages(McapFile(file)):
                if name in numbers:
                    bag.write(numbers[name], log_time_ns, publish_time_ns, data)
    return Salvage(Path(output), dict(survey.messages), tuple(survey.lost))


class _Survey:
    """Everything in the files of a bag but the messages, as far as it is whole."""

    def __init__(self) -> None:
        self.topics: dict[str, Topic] = {}
        self.messages: dict[str, int] = {}
        self.metadata: list[Metadata] = []
        self.attachments: list[Attachment] = []
        self.lost: list[str] = []
        self._own: dict[str, str] = {}
        self._remapped: list[dict[str, str]] = []

    def add(self, path: Path) -> None:
        """Add the content of one file."""
        file = McapFile(path)
        nameless = 0
        for name, *_ in _messages(file):
            if name in self.topics or self._announce(file, name):
                self.messages[name] = self.messages.get(name, 0) + 1
            else:
                nameless += 1
        for channel in file.channels.values():
            if channel.topic not in self.topics:
                self._announce(file, channel.topic)
        self.lost += file.damage
        if nameless:
            self.lost.append(f'{path.name}: {nameless} messages of an unknown topic or type')
        for metadata in file.metadata:
            if metadata.name == RECORD_NAME:
                self._own.update(metadata.metadata)
                remapped = remapped_part(metadata.metadata)
                if remapped and remapped not in self._remapped:
                    self._remapped.append(remapped)
            elif metadata.name != _ROSBAG2_RECORD and metadata not in self.metadata:
                self.metadata.append(metadata)
        for attachment in file.attachments:
            # Of equal attachments the last is kept, because later ones override earlier ones.
            self.attachments = [other for other in self.attachments if other != attachment]
            self.attachments.append(attachment)

    def _announce(self, file: McapFile, name: str) -> bool:
        """Note a topic; False if its channel or its type did not survive."""
        for channel in file.channels.values():
            if channel.topic == name and channel.schema_id in file.schemas:
                schema = file.schemas[channel.schema_id]
                self.topics[name] = Topic(
                    name, schema.name, channel.message_encoding,
                    schema.data.decode('utf-8', 'replace'), schema.encoding,
                    channel.metadata.get('topic_type_hash', ''), _qos(channel))
                return True
        return False

    def records(self) -> list[dict[str, str]]:
        """
        Return the metadata records of this package for the new bag.

        The first may be empty. Where the bag was put together of several rigs, a record with the
        topics of each rig follows.
        """
        record = dict(self._own)
        several = self._remapped if len(self._remapped) > 1 else []
        if several:
            record = {
                key: value for key, value in record.items() if key not in remapped_part(record)}
        lost = [*record.get(LOST_KEY, '').splitlines(), *self.lost]
        if lost:
            record[LOST_KEY] = '\n'.join(lost)
            record.setdefault('format_version', FORMAT_VERSION)
        return [record, *({**part, 'format_version': FORMAT_VERSION} for part in several)]


def _qos(channel: Channel) -> list[dict[str, Any]]:
    """Return the offered quality of service of a channel, none where it does not parse."""
    try:
        profiles = yaml.safe_load(channel.metadata.get('offered_qos_profiles', ''))
    except yaml.YAMLError:
        return []
    return profiles if isinstance(profiles, list) else []


def _messages(file: McapFile) -> Iterator[tuple[str, int, int, bytes]]:
    """Yield topic name (empty if unknown), log time, publish time and bytes of each message."""
    for piece in file.pieces():
        for start in piece.messages.tolist():
            length, number, _, log_time_ns, publish_time_ns = _read_message_head(
                piece.data, start)
            channel = file.channels.get(number)
            data = piece.data[start + MESSAGE_HEAD_BYTES:start + HEAD_BYTES + length]
            yield channel.topic if channel else '', log_time_ns, publish_time_ns, data
