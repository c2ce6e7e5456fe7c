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
Writing of a rosbag2 directory: one MCAP file and the ``metadata.yaml`` of version 9.

Topics of any type can be written. No clock is read and
no version of a library is written, so that the same calls give the same bytes.
"""

import errno
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Final, NamedTuple

import yaml
from mcap.writer import CompressionType, Writer

from piezo_ros.bag.bag_error import BagError, BagExistsError, BagWriteError
from piezo_ros.bag.container.whole_chunks import count_whole_chunks
from piezo_ros.parameters.errors import cause_of

__all__ = ['COMPRESSIONS', 'MAXIMUM_TIME_NS', 'Rosbag2Writer', 'Topic', 'plain_yaml']

COMPRESSIONS: Final = {
    'zstd': CompressionType.ZSTD,
    'lz4': CompressionType.LZ4,
    'none': CompressionType.NONE,
}
_CHUNK_BYTES: Final = 1 << 20
MAXIMUM_TIME_NS: Final = 2**63 - 1  # rosbag2 keeps times as signed 64-bit integers
_UNKNOWN_DISTRIBUTION: Final = 'unknown'  # where no ROS is sourced


class Topic(NamedTuple):
    """
    Description of one topic in a bag.

    Attributes
    ----------
    name, type_name, serialization : str
        Resolved topic name, message type, such as ``std_msgs/msg/String``, and encoding of the
        messages, ``cdr`` in all of ROS 2.
    definition, definition_encoding : str
        Text of the type with all types in it, and its language (``ros2msg`` or ``ros2idl``).
    type_hash : str
        Hash of the type (``RIHS01_…``); empty when unknown.
    qos : list of dict
        Offered quality of service, one mapping per publisher.

    """

    name: str
    type_name: str
    serialization: str
    definition: str
    definition_encoding: str
    type_hash: str
    qos: list[dict[str, Any]]


class Rosbag2Writer:
    """
    Writer of a rosbag2 directory.

    Parameters
    ----------
    directory : Path
        Created, with its parents; must not exist.
    compression : str
        Compression of the chunks: ``zstd``, ``lz4`` or ``none``.
    custom_data : mapping of str to str
        The entry ``custom_data`` of ``metadata.yaml``, to which `add_custom_data` may add.

    Raises
    ------
    ValueError
        If the compression is unknown.
    BagExistsError
        If the directory exists.
    BagWriteError
        If it cannot be created.

    """

    def __init__(
        self, directory: Path, *, compression: str, custom_data: Mapping[str, str],
    ) -> None:
        if compression not in COMPRESSIONS:
            raise ValueError(
                f'compression {compression!r} is none of {", ".join(COMPRESSIONS)}')
        self.path = Path(directory)
        self.file_path = self.path / f'{self.path.resolve().name}_0.mcap'
        self._custom_data = dict(custom_data)
        self._topics: list[Topic] = []
        self._messages: list[int] = []  # of each topic
        self._schemas: dict[tuple[str, str, str], int] = {}
        self._first_ns = MAXIMUM_TIME_NS
        self._last_ns = 0
        try:
            self.path.mkdir(parents=True)
            self._file = self.file_path.open('xb')
        except FileExistsError:
            raise BagExistsError(f'{self.path} exists; a bag is never overwritten') from None
        except OSError as error:
            cause = cause_of(error)
            raise BagWriteError(f'cannot create the bag {self.path}: {cause}', cause) from error
        with self._disk():
            # Only what is in chunks has a checksum otherwise, not what describes the run.
            self._writer = Writer(
                self._file, chunk_size=_CHUNK_BYTES, compression=COMPRESSIONS[compression],
                enable_data_crcs=True)
            self._writer.start(profile='ros2', library='piezo_ros')

    @contextmanager
    def _disk(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise self._failure(error) from error

    def _failure(self, error: OSError) -> BagWriteError:
        """Give the file up after an error of the disk and return the error to raise."""
        # Not the buffered close, which would try the failed write again.
        self._file.raw.close()
        cause = cause_of(error)
        return BagWriteError(
            f'cannot write {self.file_path}: {cause}; {self._what_is_left()}', cause)

    def _what_is_left(self) -> str:
        chunks = count_whole_chunks(self.file_path)
        if chunks is None:
            return 'nothing of it is left there'
        if not chunks:
            return 'it holds no whole chunk of messages'
        return (
            f'its first {chunks} chunks are whole, `piezo bag salvage {self.path} -o DIR` saves '
            'them where there is room')

    def _check_place(self) -> None:
        """Notice that the file was deleted or moved: writing to it would go on without error."""
        try:
            there = os.path.samestat(os.fstat(self._file.fileno()), self.file_path.stat())
        except FileNotFoundError:
            there = False
        if not there:
            raise FileNotFoundError(
                errno.ENOENT, 'it was deleted or moved while it was being written')

    @property
    def closed(self) -> bool:
        """Whether nothing more can be written, because of `close` or of an error of the disk."""
        return self._file.closed

    def add_topic(self, topic: Topic) -> int:
        """Announce a topic and return the number of its channel."""
        key = (topic.type_name, topic.definition_encoding, topic.definition)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(
                topic.type_name, topic.definition_encoding, topic.definition.encode())
        self._topics.append(topic)
        self._messages.append(0)
        return self._writer.register_channel(
            topic.name, topic.serialization, self._schemas[key],
            {
                'offered_qos_profiles': plain_yaml(topic.qos),
                'topic_type_hash': topic.type_hash,
            })

    def add_metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Write a metadata record, ahead of the messages that are not in the file yet."""
        with self._disk():
            self._writer.add_metadata(name, dict(entries))

    def add_custom_data(self, entries: Mapping[str, str]) -> None:
        """Add to the entry ``custom_data``, in place of entries of the same name."""
        self._custom_data.update(entries)

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Write an attachment of time 0, ahead of the messages that are not in the file yet."""
        with self._disk():
            self._writer.add_attachment(0, 0, name, media_type, data)

    def write(self, channel: int, log_time_ns: int, publish_time_ns: int, data: bytes) -> None:
        """
        Write one message (hot path).

        Raises
        ------
        BagWriteError
            If the disk is full or fails; the text says what of the bag is whole.
        BagError
            If the log time is outside 0 … 2**63 - 1 ns.

        """
        if not 0 <= log_time_ns <= MAXIMUM_TIME_NS:
            raise BagError(f'log time {log_time_ns} ns is outside 0 … 2**63 - 1 ns')
        if log_time_ns < self._first_ns:
            self._first_ns = log_time_ns
        if log_time_ns > self._last_ns:
            self._last_ns = log_time_ns
        self._messages[channel - 1] += 1
        try:
            self._writer.add_message(channel, log_time_ns, data, publish_time_ns)
        except OSError as error:
            raise self._failure(error) from error

    def flush(self) -> None:
        """Hand everything written so far to the operating system, as whole chunks."""
        with self._disk():
            self._check_place()
            self._writer.flush()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """Write the index and ``metadata.yaml``; does nothing the second time."""
        if self.closed:
            return
        information = self._information()
        with self._disk():
            self._check_place()
            self._writer.add_metadata(
                'rosbag2', {'serialized_metadata': plain_yaml(information)})
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._file.close()
            text = plain_yaml({'rosbag2_bagfile_information': information})
            unfinished = self.path / 'metadata.yaml.part'
            unfinished.write_text(text, encoding='utf-8')
            os.replace(unfinished, self.path / 'metadata.yaml')

    def __enter__(self) -> 'Rosbag2Writer':
        """Return the writer."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the writer, so that the bag is whole up to an error."""
        self.close()

    def _information(self) -> dict[str, Any]:
        """Return the body of ``metadata.yaml``; rosbag2 needs every one of these keys."""
        messages = sum(self._messages)
        start_ns = self._first_ns if messages else 0
        starting_time = {'nanoseconds_since_epoch': start_ns}
        duration = {'nanoseconds': self._last_ns - start_ns}
        return {
            'version': 9,
            'storage_identifier': 'mcap',
            'duration': duration,
            'starting_time': starting_time,
            'message_count': messages,
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': topic.name,
                        'type': topic.type_name,
                        'serialization_format': topic.serialization,
                        'offered_qos_profiles': topic.qos,
                        'type_description_hash': topic.type_hash,
                    },
                    'message_count': count,
                }
                for topic, count in zip(self._topics, self._messages, strict=True)
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [self.file_path.name],
            'files': [{
                'path': self.file_path.name,
                'starting_time': starting_time,
                'duration': duration,
                'message_count': messages,
            }],
            'custom_data': self._custom_data,
            'ros_distro': os.environ.get('ROS_DISTRO') or _UNKNOWN_DISTRIBUTION,
        }


class _PlainDumper(getattr(yaml, 'CSafeDumper', yaml.SafeDumper)):  # type: ignore[misc]
    """Dumper that repeats equal parts in place of anchors, which some readers do not know."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def plain_yaml(value: object) -> str:
    """Return a value as block-style YAML without anchors, keys in their own order."""
    return yaml.dump(value, Dumper=_PlainDumper, sort_keys=False, allow_unicode=True)
