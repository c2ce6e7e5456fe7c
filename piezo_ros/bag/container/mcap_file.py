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
Sequential reading of one MCAP file, whole or cut anywhere.

The index at the end of a file is not needed, so that a file that was cut off is read like any
other, up to its last whole record; what it counts is kept for comparison. The library mcap parses
and decompresses the records. Only the step from record to record is done here:
`mcap.stream_reader.StreamReader` stops at the first record that does not parse, and it parses the
message index behind each chunk entry by entry, which takes longer than all the rest where each
message contains one sample.
"""

import io
import os
import struct
import zlib
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from itertools import islice
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from piezo_ros.bag.bag_error import BagError
from piezo_ros.bag.container.chunk_data import COMPRESSIONS, ChunkError, chunk_data
from piezo_ros.bag.container.chunk_scan import HEAD_BYTES, read_head, scan, unaligned
from piezo_ros.bag.container.file_formats import HEAD_LENGTH, other_format
from piezo_ros.bag.container.summary import (
    PARSE_ERRORS,
    Summary,
    checksum_holds,
    parsed,
    read_summary,
)

__all__ = ['McapFile', 'Piece']

_LOOSE_BYTES: Final = 1 << 20  # messages outside of chunks are handed on in pieces of this size
_CHANNEL_OFFSET: Final = 9
# Chunks are decompressed ahead in threads, which do not keep the interpreter's lock meanwhile.
_THREADS: Final = max(1, min(4, (os.cpu_count() or 1) - 1))
_PIECES_AHEAD: Final = 2 * _THREADS


class Piece(NamedTuple):
    """
    A buffer with whole message records: the inside of a chunk, or messages outside of chunks.

    Attributes
    ----------
    data : bytes
        The buffer.
    messages : ndarray of int64
        Offsets of the message records in it, in the order of the file.
    position : int
        Offset in the file of the chunk, or of the first of the messages.

    """

    data: bytes
    messages: NDArray[np.int64]
    position: int = 0

    def by_channel(self) -> Iterator[tuple[int, NDArray[np.int64]]]:
        """Yield the number of each channel and the offsets of its messages."""
        channels = unaligned(self.data, '<u2')[self.messages + _CHANNEL_OFFSET]
        for number in np.flatnonzero(np.bincount(channels)).tolist():
            yield number, self.messages[channels == number]


class _Views:
    """Reads a buffer as a file is read, but without a copy of it: chunks are large."""

    def __init__(self, data: bytes) -> None:
        self._rest = memoryview(data)

    def read(self, length: int) -> memoryview:
        """Return the next bytes, fewer at the end."""
        part, self._rest = self._rest[:length], self._rest[length:]
        return part


class _Unpacked(NamedTuple):
    """A piece, the offsets of the other records in it, and the loss in it, if there is one."""

    piece: Piece
    others: list[int]
    loss: str | None


class McapFile:
    """
    Reader of one MCAP file.

    The attributes are complete once `pieces` has read the whole file; schema and channel of a
    message are there by the time its piece is yielded.

    Parameters
    ----------
    path : Path
        The file.
    known : McapFile, optional
        The same file, read before: schemas and channels are known from the beginning.

    Attributes
    ----------
    schemas, channels : dict
        Records by their numbers.
    metadata : list of Metadata
        All metadata records.
    attachments : list of Attachment
        All attachments.
    summary : Summary or None
        What the writer says at the end of the file; None if that is cut off or damaged.

    """

    def __init__(self, path: Path, known: 'McapFile | None' = None) -> None:
        self.path = path
        self.schemas: dict[int, Schema] = {} if known is None else dict(known.schemas)
        self.channels: dict[int, Channel] = {} if known is None else dict(known.channels)
        self.summary: Summary | None = None
        self._kept: Counter[int] = Counter()  # opcode -> number of records, whole or not
        self.metadata: list[Metadata] = []
        self.attachments: list[Attachment] = []
        self._damage: list[tuple[int, str]] = []
        self._is_checksum_wrong = False

    @property
    def damage(self) -> list[str]:
        """Sentences that say what is cut off, damaged or missing, in the order of the file."""
        damage = [*(text for _, text in sorted(self._damage)), *self._vanished()]
        if self._is_checksum_wrong and not damage:
            damage = [f'{self.path.name}: something in it, or the checksum of all, was changed']
        return damage

    def _vanished(self) -> list[str]:
        """Return sentences that say how many records are missing by the count of the writer."""
        if self.summary is None or self.summary.statistics is None:
            return []
        statistics = self.summary.statistics
        return [
            f'{self.path.name}: {count - self._kept[opcode]} of {count} {name} are missing'
            for opcode, count, name in (
                (Opcode.METADATA, statistics.metadata_count, 'metadata records'),
                (Opcode.ATTACHMENT, statistics.attachment_count, 'attachments'))
            if count > self._kept[opcode]]

    def pieces(self, positions: Iterable[int] | None = None) -> Iterator[Piece]:
        """
        Read all whole message records of the file, in its order.

        Parameters
        ----------
        positions : iterable of int, optional
            The `Piece.position` of the pieces to read; by default the whole file is read.

        Yields
        ------
        Piece
            The next messages.

        Raises
        ------
        BagError
            If the file cannot be read, is no MCAP file, or has a chunk of unknown compression.

        """
        try:
            with self.path.open('rb') as file, ThreadPoolExecutor(_THREADS) as threads:
                ahead: deque[Future[_Unpacked]] = deque()
                for unpack in self._packed_pieces(file, positions):
                    ahead.append(threads.submit(unpack))
                    if len(ahead) > _PIECES_AHEAD:
                        yield self._unpacked_piece(ahead.popleft())
                while ahead:
                    yield self._unpacked_piece(ahead.popleft())
        except OSError as error:
            raise BagError(f'cannot read {self.path}: {error.strerror}') from error

    def _packed_pieces(
        self, file: BinaryIO, positions: Iterable[int] | None,
    ) -> Iterator[Callable[[], _Unpacked]]:
        """Yield functions that unpack one piece each."""
        head = file.read(HEAD_LENGTH)
        magic = head[:len(MCAP0_MAGIC)]
        if magic != MCAP0_MAGIC:
            raise BagError(f'{self.path} is no MCAP file: ' + (
                other_format(head) or f'it begins with {magic!r}, not {MCAP0_MAGIC!r}'))
        file.seek(len(MCAP0_MAGIC))
        if positions is None:
            yield from self._packed_from(file, zlib.crc32(magic))
            return
        for position in positions:
            file.seek(position)
            yield from islice(self._packed_from(file), 1)

    def _packed_from(
        self, file: BinaryIO, checksum: int | None = None,
    ) -> Iterator[Callable[[], _Unpacked]]:
        """Yield the pieces from here to the end of the file; keep the records between them."""
        loose: list[bytes] = []
        loose_position = loose_bytes = 0
        for position, opcode, length, body in self._records(file, checksum):
            if opcode == Opcode.MESSAGE:
                if not loose:
                    loose_position, loose_bytes = position, 0
                loose.append(struct.pack('<BQ', opcode, length) + body)
                loose_bytes += len(loose[-1])
                if loose_bytes < _LOOSE_BYTES:
                    continue
            if loose:
                yield partial(_scanned, loose_position, b''.join(loose))
                loose = []
            if opcode == Opcode.CHUNK:
                yield partial(_unpacked_chunk, self.path, position, length, body)
            elif opcode != Opcode.MESSAGE:
                self._keep(position, opcode, body)
        if loose:
            yield partial(_scanned, loose_position, b''.join(loose))

    def _records(
        self, file: BinaryIO, checksum: int | None,
    ) -> Iterator[tuple[int, int, int, bytes]]:
        """
        Yield offset, opcode, length and body of each record of the data section from here on.

        Message indices are left out. The last record may be a chunk of which the end is cut
        off; every other record is whole. The checksum is that of the file up to here; without it
        the one at the end of the data is not compared.
        """
        position = file.tell()
        size = file.seek(0, io.SEEK_END)
        file.seek(position)
        while position + HEAD_BYTES <= size:
            head = file.read(HEAD_BYTES)
            opcode, length = read_head(head)
            end = position + HEAD_BYTES + length
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                if opcode == Opcode.DATA_END and checksum is not None and not checksum_holds(
                        file, position, checksum):
                    self._is_checksum_wrong = True
                self._summarise(file, position)
                return
            if opcode == 0 or (end > size and opcode != Opcode.CHUNK):
                break
            if opcode == Opcode.MESSAGE_INDEX and checksum is None:
                file.seek(end)
                position = end
                continue
            body = file.read(length if end <= size else -1)
            if checksum is not None:
                checksum = zlib.crc32(body, zlib.crc32(head, checksum))
            if opcode != Opcode.MESSAGE_INDEX:
                yield position, opcode, length, body
            position = end
        if position < size:
            self._lose(position, f'{size - position} bytes of a record that is not whole')
        self._damage.append((size, f'{self.path.name} was not closed by its writer'))

    def _summarise(self, file: BinaryIO, position: int) -> None:
        """Keep what the writer says at the end, also of channels of which the record is lost."""
        self.summary = read_summary(file, position)
        if self.summary is not None:
            for schema in self.summary.schemas:
                self.schemas.setdefault(schema.id, schema)
            for channel in self.summary.channels:
                self.channels.setdefault(channel.id, channel)

    def _unpacked_piece(self, future: Future[_Unpacked]) -> Piece:
        """Return a piece once it is unpacked; keep the other records in it."""
        piece, others, loss = future.result()
        for start in others:
            opcode, length = read_head(piece.data, start)
            body_start = start + HEAD_BYTES
            self._keep(piece.position, opcode, piece.data[body_start:body_start + length])
        if loss is not None:
            self._lose(piece.position, loss)
        return piece

    def _keep(self, position: int, opcode: int, body: bytes) -> None:
        """Keep a record that is no message."""
        self._kept[opcode] += 1
        try:
            if opcode == Opcode.SCHEMA:
                schema = parsed(Schema.read, body)
                self.schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                channel = parsed(Channel.read, body)
                self.channels[channel.id] = channel
            elif opcode == Opcode.METADATA:
                self.metadata.append(parsed(Metadata.read, body))
            elif opcode == Opcode.ATTACHMENT:
                # The library skips this checksum.
                if zlib.crc32(body[:-4]) != int.from_bytes(body[-4:], 'little') != 0:
                    self._lose(position, 'an attachment with a wrong checksum')
                    return
                self.attachments.append(parsed(Attachment.read, body))
        except PARSE_ERRORS as error:
            self._lose(position, f'a record of kind {opcode} that does not parse ({error})')

    def _lose(self, position: int, loss: str) -> None:
        self._damage.append((position, f'{self.path.name}: {loss}, from byte {position} on'))


def _scanned(position: int, data: bytes, loss: str | None = None) -> _Unpacked:
    """Find the records in a buffer of which something may be lost already."""
    records = scan(data)
    if records.end < len(data):
        loss = loss or 'records that are not whole'
    return _Unpacked(Piece(data, records.messages, position), records.others, loss)


def _unpacked_chunk(path: Path, position: int, length: int, body: bytes) -> _Unpacked:
    """
    Decompress a chunk and find the records in it.

    Parameters
    ----------
    path, position : Path, int
        Where it is.
    length : int
        Length of the body.
    body : bytes
        As much of it as is left.

    """
    nothing = partial(_scanned, position, b'')
    try:
        chunk = Chunk.read(ReadDataStream(_Views(body)))  # type: ignore[arg-type]
    except PARSE_ERRORS:
        return nothing('a chunk cut within its head')
    if chunk.compression not in COMPRESSIONS:
        raise BagError(
            f'{path}: chunk compression {chunk.compression!r} is none of zstd, lz4 and none')
    missing = length - len(body)
    if missing and chunk.compression:
        left = len(chunk.data)
        return nothing(f'a chunk of which {left} of {left + missing} bytes are left')
    if missing:
        return _scanned(position, bytes(chunk.data), 'the end of a chunk')
    try:
        return _scanned(position, chunk_data(chunk))
    except ChunkError as error:
        return nothing(str(error))
