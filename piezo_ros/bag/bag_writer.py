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

"""Writing of the streams of a run into a bag."""

import struct
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag.bag_error import BagError
from piezo_ros.bag.container.rosbag2_writer import Rosbag2Writer, Topic
from piezo_ros.bag.description import (
    PARAMETERS_NAME,
    RECORD_NAME,
    checked_metadata,
    with_digest,
)
from piezo_ros.bag.recorded_topics import check_topics, remapped_entries
from piezo_ros.streams import STREAMS, BlockCodec
from piezo_ros.streams.message_type import DEFINITION, STREAM_QOS, TYPE_HASH, TYPE_NAME

__all__ = ['BagWriter']

_NANOSECONDS_PER_SECOND: Final = 1e9


class BagWriter:
    """
    Writer of one run: a rosbag2 directory with its streams, its metadata and its parameters.

    The log time of a block is the simulated time of its first sample, index times sample period.
    The same calls give the same bytes: no clock is read. Each of `topics` has a channel, in the
    order of `STREAMS`, also one that is never written to.

    Parameters
    ----------
    directory : Path
        Created, with its parents; must not exist.
    topics : mapping of str to str, optional
        Stream to resolved topic name, which may be any; by default every stream at the root.
    namespace : str, optional
        Namespace of the rig. Where a topic is not ``<namespace>/<stream>``, the metadata record
        names both, so that readers find the stream. By default what the topics have in common.
    metadata : mapping of str to str, optional
        Entries of the metadata record 'piezo_ros'; 'format_version' is added.
    compression : str, optional
        Compression of the chunks: ``zstd``, ``lz4`` or ``none``.

    Raises
    ------
    ValueError
        If a stream, a topic name, a metadata entry or the compression is invalid.
    BagExistsError
        If the directory exists.
    BagError
        If the directory cannot be created or written.

    """

    def __init__(
        self,
        directory: Path,
        *,
        topics: Mapping[str, str] | None = None,
        namespace: str | None = None,
        metadata: Mapping[str, str] | None = None,
        compression: str = 'zstd',
    ) -> None:
        names = {stream: f'/{stream}' for stream in STREAMS} if topics is None else topics
        check_topics(names, namespace)
        record = {**checked_metadata(metadata or {}), **remapped_entries(names, namespace)}
        self._bag = Rosbag2Writer(directory, compression=compression, custom_data=record)
        # Ahead of the first chunk, so that they outlive a cut of the file anywhere behind.
        self._bag.add_metadata(RECORD_NAME, with_digest(record))
        self._streams: dict[str, tuple[int, BlockCodec]] = {}
        for stream in STREAMS:
            if stream in names:
                topic = Topic(
                    names[stream], TYPE_NAME, 'cdr', DEFINITION, 'ros2msg', TYPE_HASH,
                    STREAM_QOS)
                self._streams[stream] = (self._bag.add_topic(topic), BlockCodec(stream))

    @property
    def path(self) -> Path:
        """The directory being written."""
        return self._bag.path

    def attach_parameters(self, yaml_text: str) -> None:
        """
        Attach the parameters of all nodes, as 'parameters.yaml'.

        Call it before the first `write`: then the parameters outlive any later cut of the file.

        Parameters
        ----------
        yaml_text : str
            A ROS parameter file, ``/namespace/node: {ros__parameters: {…}}``.

        """
        self._check_open()
        self._bag.add_attachment(PARAMETERS_NAME, 'application/yaml', yaml_text.encode())

    def describe(self, metadata: Mapping[str, str], yaml_text: str | None = None) -> None:
        """
        Add to the description of the run, or correct it, after the bag was begun.

        The addition stands behind the blocks written so far: a cut of the file may lose it.

        Parameters
        ----------
        metadata : mapping of str to str
            Entries of the metadata record 'piezo_ros'; they replace those of the same name.
        yaml_text : str, optional
            A ROS parameter file, as `attach_parameters` takes it; its parameters replace those of
            the same name.

        Raises
        ------
        ValueError
            If a metadata entry is invalid.
        BagError
            If the writer is closed, or the disk is full or fails.

        """
        record = checked_metadata(metadata)
        self._check_open()
        self._bag.add_metadata(RECORD_NAME, with_digest(record))
        self._bag.add_custom_data(record)
        if yaml_text is not None:
            self.attach_parameters(yaml_text)

    def write(self, stream: str, raw: bytes) -> None:
        """
        Write one serialized block (hot path: layout and samples are not checked).

        Parameters
        ----------
        stream : str
            One of the streams in `topics`.
        raw : bytes
            CDR bytes of a block, as `BlockCodec` reads and writes them.

        Raises
        ------
        MalformedBlockError
            If the bytes are no block of this stream.
        BagError
            If the writer is closed, the stream is not in `topics`, or the disk is full or fails.

        """
        if stream not in self._streams:
            raise self._missing(stream)
        channel, codec = self._streams[stream]
        try:
            index, sample_period_s = codec.index_and_period(raw)
            time_ns = round(index * sample_period_s * _NANOSECONDS_PER_SECOND)
        except (struct.error, ValueError, OverflowError):
            codec.decode(raw)  # names what is wrong
            raise
        if self._bag.closed:
            self._check_open()
        self._bag.write(channel, time_ns, time_ns, raw)

    def write_block(
        self,
        stream: str,
        index: int,
        sample_period_s: float,
        samples: NDArray[np.float64] | list[float],
    ) -> None:
        """
        Write one block.

        Parameters
        ----------
        stream : str
            One of the streams in `topics`.
        index : int
            Index of the first sample.
        sample_period_s : float
            Sample period, seconds.
        samples : array_like of float, shape (N,)
            The samples in the stream's unit; N = 0 ends the stream.

        Raises
        ------
        BagError
            As `write`.

        """
        if stream not in self._streams:
            raise self._missing(stream)
        codec = self._streams[stream][1]
        self.write(stream, codec.encode(index, sample_period_s, samples))

    @property
    def closed(self) -> bool:
        """Whether nothing more can be written, because of `close` or of an error of the disk."""
        return self._bag.closed

    def flush(self) -> None:
        """
        Hand everything written so far to the operating system, as whole chunks.

        A recorder that is killed later loses at most the blocks that it wrote after this call.
        """
        self._check_open()
        self._bag.flush()

    def close(self) -> None:
        """Write the index and ``metadata.yaml``; does nothing the second time."""
        self._bag.close()

    def __enter__(self) -> 'BagWriter':
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

    def _missing(self, stream: str) -> BagError:
        return BagError(
            f'stream {stream!r} is not in this bag, which has {", ".join(self._streams)}')

    def _check_open(self) -> None:
        if self._bag.closed:
            raise BagError(f'the writer of {self._bag.path} is closed')
