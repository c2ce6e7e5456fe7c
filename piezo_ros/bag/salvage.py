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

import hashlib
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from mcap.records import Attachment, Channel, Metadata
from numpy.typing import NDArray

from piezo_ros.bag.bag_error import BagError, BagExistsError, BagWriteError
from piezo_ros.bag.container.chunk_scan import HEAD_BYTES, MESSAGE_HEAD_BYTES, unaligned
from piezo_ros.bag.container.mcap_file import McapFile, Piece
from piezo_ros.bag.container.rosbag2_files import BagFiles, bag_files
from piezo_ros.bag.container.rosbag2_writer import MAXIMUM_TIME_NS, Rosbag2Writer, Topic
from piezo_ros.bag.contents import Contents
from piezo_ros.bag.description import (
    FORMAT_VERSION,
    LOST_KEY,
    RECORD_NAME,
    intact_records,
    with_digest,
)
from piezo_ros.bag.recorded_topics import remapped_part
from piezo_ros.bag.samples.sinks import Sink
from piezo_ros.bag.topic_messages import MessageCounts
from piezo_ros.parameters.bounded_yaml import YamlError, yaml_content
from piezo_ros.parameters.errors import cause_of

__all__ = ['Salvage', 'salvage']

_ROSBAG2_RECORD: Final = 'rosbag2'  # counts of the cut bag; the new bag has its own
_LOG_TIME_OFFSET: Final = 15
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
    is cut off the whole messages are kept if it is uncompressed, else none. Of a chunk that comes
    twice, as in equal files, the first is kept. The losses are also noted in the new bag, where
    `read` finds them. The new bag appears once it is whole.

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
        If the bag cannot be read or no message in it is whole.
    BagWriteError
        If the output cannot be written; nothing of it is left, and the bag is as it was.

    """
    output = Path(output)
    files = bag_files(Path(path))
    # Read twice, because the new bag begins with the losses and the channels, which are known
    # only at the end.
    survey = _surveyed(files, {})
    if survey.counts.early():
        survey = _surveyed(files, survey.files)
    if not survey.messages:
        raise BagError(f'{path} holds no whole message: {"; ".join(survey.lost)}')
    try:
        with _put_in_place(output) as unfinished:
            _write(survey, unfinished, compression)
            # Samples that are no numbers are not lost, hence they may be in the streams.
            found = Contents(unfinished, _no_sink, keep_not_finite=True)
    except BagWriteError as error:
        whole = sum(survey.messages.values())
        raise BagWriteError(
            f'cannot write {output}: {error.cause}; nothing of it is left, {whole} messages are '
            f'whole in {path}', error.cause, whole) from error
    return Salvage(output, dict(survey.messages), (*survey.lost, *found.problems()))


def _no_sink() -> Sink:
    return lambda index, samples: None


def _surveyed(files: BagFiles, known: Mapping[Path, McapFile]) -> '_Survey':
    survey = _Survey(known)
    for path in files.paths:
        survey.add(path)
    survey.finish(files)
    return survey


@contextmanager
def _put_in_place(output: Path) -> Iterator[Path]:
    """Yield a directory beside the output, which becomes the output unless an error is raised."""
    if output.exists() or output.is_symlink():
        raise BagExistsError(f'{output} exists; a bag is never overwritten')
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix='.salvage-', dir=output.parent) as beside:
            # The name of the file is that of the directory.
            unfinished = Path(beside) / output.resolve().name
            yield unfinished
            unfinished.rename(output)
    except OSError as error:
        if isinstance(error, BagError):
            raise
        cause = cause_of(error)
        raise BagWriteError(f'cannot create the bag {output}: {cause}', cause) from error


def _write(survey: '_Survey', directory: Path, compression: str) -> None:
    """Write what has been surveyed into a new bag."""
    records = survey.records()
    with Rosbag2Writer(directory, compression=compression, custom_data=records[0]) as bag:
        for record in records:
            if record:
                bag.add_metadata(RECORD_NAME, with_digest(record))
        for metadata in survey.metadata:
            bag.add_metadata(metadata.name, metadata.metadata)
        for attachment in survey.attachments:
            bag.add_attachment(attachment.name, attachment.media_type, attachment.data)
        numbers = {topic.name: bag.add_topic(topic) for topic in survey.topics.values()}
        for path in survey.files:
            for name, log_time_ns, publish_time_ns, data in survey.whole_messages(path):
                bag.write(numbers[name], log_time_ns, publish_time_ns, data)


class _Survey:
    """
    Everything in the files of a bag but the messages, as far as it is whole.

    Parameters
    ----------
    known : mapping of Path to McapFile
        The files, where they were read before.

    """

    def __init__(self, known: Mapping[Path, McapFile]) -> None:
        self.topics: dict[str, Topic] = {}
        self.messages: dict[str, int] = {}
        self.metadata: list[Metadata] = []
        self.attachments: list[Attachment] = []
        self.lost: list[str] = []
        self.files: dict[Path, McapFile] = {}
        self.counts = MessageCounts()
        self._known = known
        self._seen: set[bytes] = set()  # digests of pieces
        self._repeated: dict[Path, set[int]] = {}  # positions of pieces that came before
        self._own: dict[str, str] = {}
        self._remapped: list[dict[str, str]] = []

    def add(self, path: Path) -> None:
        """Add the content of one file."""
        file = McapFile(path, self._known.get(path))
        self.files[path] = file
        self._repeated[path] = set()
        self.counts.begin(file)
        repeated = nameless = mistimed = 0
        for piece in file.pieces():
            is_repeated = self._is_repeated(path, piece)
            repeated += piece.messages.size if is_repeated else 0
            for number, messages in piece.by_channel():
                self.counts.add(file, number, messages.size)
                channel = file.channels.get(number)
                if is_repeated:
                    continue
                if channel is None or not self._announce(file, channel):
                    nameless += messages.size
                    continue
                late = _beyond_times(piece, messages)
                mistimed += late
                if messages.size > late:
                    self.messages[channel.topic] = (
                        self.messages.get(channel.topic, 0) + messages.size - late)
        for channel in file.channels.values():
            self._announce(file, channel)
        self.lost += file.damage
        self.lost += [
            f'{path.name}: {number} {words}' for number, words in (
                (nameless, 'messages of an unknown topic or type'),
                (mistimed, 'messages with a log time beyond 2**63 - 1 ns'),
                (repeated, 'messages that came before, byte by byte'))
            if number]
        self._describe(file)

    def _is_repeated(self, path: Path, piece: Piece) -> bool:
        """Return whether a piece came before, in this or another file."""
        if not piece.messages.size:
            return False
        digest = hashlib.blake2b(piece.data).digest()
        if digest in self._seen:
            self._repeated[path].add(piece.position)
            return True
        self._seen.add(digest)
        return False

    def _describe(self, file: McapFile) -> None:
        """Add the metadata and attachments of a file."""
        intact, lost = intact_records(file.metadata)
        self.lost += [f'{file.path.name}: {loss}' for loss in lost]
        for metadata in intact:
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

    def finish(self, files: BagFiles) -> None:
        """Add what all files together have lost."""
        self.lost = [*files.lost, *self.lost, *self.counts.missing(files.messages)]

    def _announce(self, file: McapFile, channel: Channel) -> bool:
        """Note a topic; False if its type did not survive or is not that of its other channels."""
        schema = file.schemas.get(channel.schema_id)
        if schema is None:
            return False
        if channel.topic not in self.topics:
            self.topics[channel.topic] = Topic(
                channel.topic, schema.name, channel.message_encoding,
                schema.data.decode('utf-8', 'replace'), schema.encoding,
                channel.metadata.get('topic_type_hash', ''), _qos(channel))
        topic = self.topics[channel.topic]
        return (topic.type_name, topic.serialization) == (schema.name, channel.message_encoding)

    def whole_messages(self, path: Path) -> Iterator[tuple[str, int, int, bytes]]:
        """Yield topic name, log time, publish time and bytes of each message to keep."""
        file = McapFile(path, self.files[path])
        names: dict[int, str] = {}  # of channels
        for number, channel in file.channels.items():
            if self._announce(file, channel):
                names[number] = channel.topic
        for piece in file.pieces():
            if piece.position in self._repeated[path]:
                continue
            for start in piece.messages.tolist():
                length, number, _, log_time_ns, publish_time_ns = _read_message_head(
                    piece.data, start)
                if number in names and log_time_ns <= MAXIMUM_TIME_NS:
                    data = piece.data[start + MESSAGE_HEAD_BYTES:start + HEAD_BYTES + length]
                    yield names[number], log_time_ns, publish_time_ns, data

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
        profiles = yaml_content(channel.metadata.get('offered_qos_profiles', ''))
    except YamlError:
        return []
    whole = isinstance(profiles, list) and all(isinstance(each, dict) for each in profiles)
    return profiles if whole else []


def _beyond_times(piece: Piece, messages: NDArray[np.int64]) -> int:
    """Return how many messages have a log time that is too late for rosbag2."""
    times_ns = unaligned(piece.data, '<u8')[messages + _LOG_TIME_OFFSET]
    return int((times_ns > np.uint64(MAXIMUM_TIME_NS)).sum())
