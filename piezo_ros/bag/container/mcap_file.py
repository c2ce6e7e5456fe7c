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

The index at the end of a file is not used: what is read is what is there, and a file whose writer
was killed is read like any other up to its last whole record.
"""

import io
import os
import struct
import zlib
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from piezo_ros.bag.container.chunk_scan import HEAD_BYTES, Records, scan, unaligned
from piezo_ros.bag.errors import BagError

__all__ = ['McapFile', 'Piece']

_LOOSE_BYTES: Final = 1 << 20  # messages outside chunks are handed on in pieces of this size
_CHANNEL_OFFSET: Final = 9
# Chunks are decompressed ahead in threads, which hold no lock meanwhile.
_THREADS: Final = max(1, min(4, (os.cpu_count() or 1) - 1))
_AHEAD_PIECES: Final = 8
_AHEAD_BYTES: Final = 64 << 20
_read_head = struct.Struct('<BQ').unpack
_read_chunk_head = struct.Struct('<QQQII').unpack_from
_Index = list[NDArray[np.int64]]


class Piece(NamedTuple):
    """
    A buffer with whole message records.

    Attributes
    ----------
    data : bytes
        The buffer.
    messages : ndarray of int64
        Offsets of the message records in it, in the order of the file.
    number : int
        Its place among the pieces of the file.
    end : int
        Offset in the file behind it.

    """

    data: bytes
    messages: NDArray[np.int64]
    number: int = 0
    end: int = 0

    def by_channel(self) -> Iterator[tuple[int, NDArray[np.int64]]]:
        """Yield the number of each channel and the offsets of its messages."""
        channels = unaligned(self.data, '<u2')[self.messages + _CHANNEL_OFFSET]
        for number in np.flatnonzero(np.bincount(channels)).tolist():
            yield number, self.messages[channels == number]


class _Raw(NamedTuple):
    """A piece as it stands in the file: a chunk, or messages outside of chunks."""

    number: int
    position: int | None  # offset of the chunk; None outside of chunks
    body: bytes
    offsets: NDArray[np.int64] | None  # where messages are said to be
    end: int


class McapFile:
    """
    One MCAP file.

    `pieces` reads the file; the attributes are complete once it is exhausted, and whatever a
    message needs is there by the time its piece is yielded.

    Parameters
    ----------
    path : Path
        The file.

    Attributes
    ----------
    schemas, channels : dict
        Records by their numbers.
    metadata : list of Metadata
        All metadata records.
    attachments : list of Attachment
        All attachments.
    complete : bool
        Whether the writer came to the end of the data.

    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.metadata: list[Metadata] = []
        self.attachments: list[Attachment] = []
        self.complete = False
        self._damage: list[tuple[int, str]] = []

    @property
    def damage(self) -> list[str]:
        """Sentences that say what is cut off or damaged, in the order of the file."""
        return [text for _, text in sorted(self._damage)]

    def pieces(self, wanted: Sequence[object] | None = None) -> Iterator[Piece]:
        """
        Yield all whole message records of the file, in its order.

        Parameters
        ----------
        wanted : sequence, optional
            Says by its truth, for the number of each chunk, whether to look into it.

        Raises
        ------
        BagError
            If the file cannot be opened or is no MCAP file.

        """
        try:
            with self.path.open('rb') as file:
                yield from self._pieces(file, wanted)
        except OSError as error:
            raise BagError(f'cannot read {self.path}: {error.strerror}') from error

    def _pieces(self, file: BinaryIO, wanted: Sequence[object] | None) -> Iterator[Piece]:
        size = file.seek(0, io.SEEK_END)
        file.seek(0)
        magic = file.read(len(MCAP0_MAGIC))
        if magic != MCAP0_MAGIC:
            raise BagError(
                f'{self.path} is no MCAP file: it begins with {magic!r}, not {MCAP0_MAGIC!r}')
        ahead: deque[tuple[int, Callable[[], Piece | None]]] = deque()
        with ThreadPoolExecutor(_THREADS) as threads:
            for raw in self._raw_pieces(file, size, wanted):
                ahead.append((len(raw.body), self._prepared(threads, raw)))
                while len(ahead) > _AHEAD_PIECES or sum(held for held, _ in ahead) > _AHEAD_BYTES:
                    yield from self._taken(ahead)
            while ahead:
                yield from self._taken(ahead)
        if not self.complete:
            self._lose_at(size, f'{self.path.name} was not closed by its writer')

    def _raw_pieces(
        self, file: BinaryIO, size: int, wanted: Sequence[object] | None,
    ) -> Iterator[_Raw]:
        """Yield chunks and the messages outside of chunks; note everything else."""
        number = 0
        loose: list[bytes] = []
        loose_bytes = 0
        for position, opcode, length in self._records(file, size):
            if opcode == Opcode.MESSAGE:
                loose.append(struct.pack('<BQ', opcode, length) + file.read(length))
                loose_bytes += len(loose[-1])
                if loose_bytes < _LOOSE_BYTES:
                    continue
            if loose:
                yield _Raw(number, None, b''.join(loose), None, position)
                number, loose, loose_bytes = number + 1, [], 0
            if opcode == Opcode.CHUNK:
                if wanted is None or (number < len(wanted) and wanted[number]):
                    body = file.read(length)
                    index = self._message_index(file, size)
                    yield _Raw(number, position, body, index, file.tell())
                else:
                    file.seek(length, io.SEEK_CUR)
                number += 1
            elif opcode != Opcode.MESSAGE:
                self._keep(position, opcode, file.read(length))
        if loose:
            yield _Raw(number, None, b''.join(loose), None, file.tell())

    def _prepared(self, threads: ThreadPoolExecutor, raw: _Raw) -> Callable[[], Piece | None]:
        """Begin to decompress a piece and return how to get it."""
        if raw.position is None:
            return lambda: Piece(raw.body, scan(raw.body).messages, raw.number, raw.end)
        position = raw.position
        inside = threads.submit(self._uncompressed, position, raw.body)
        return lambda: self._chunk(position, inside.result(), raw)

    @staticmethod
    def _taken(ahead: deque[tuple[int, Callable[[], Piece | None]]]) -> Iterator[Piece]:
        _, result = ahead.popleft()
        piece = result()
        if piece is not None:
            yield piece

    def _records(self, file: BinaryIO, size: int) -> Iterator[tuple[int, int, int]]:
        """
        Yield offset, opcode and length of each whole record of the data section.

        The body is left to the caller, who reads it or seeks behind it. Of a chunk that is cut off
        the length is what is left.
        """
        while True:
            position = file.tell()
            head = file.read(HEAD_BYTES)
            if len(head) < HEAD_BYTES:
                break
            opcode, length = _read_head(head)
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                self.complete = True
                return
            left = size - file.tell()
            if opcode == 0 or length > left:
                if opcode == Opcode.CHUNK:
                    yield position, opcode, left
                    return
                break
            yield position, opcode, length
        if position < size:
            self._lose(position, f'{size - position} bytes of a record that is not whole')

    def _message_index(self, file: BinaryIO, size: int) -> NDArray[np.int64] | None:
        """Read the message index that follows a chunk, None if there is none."""
        parts: _Index = []
        while True:
            position = file.tell()
            head = file.read(HEAD_BYTES)
            if len(head) == HEAD_BYTES:
                opcode, length = _read_head(head)
                if opcode == Opcode.MESSAGE_INDEX and 6 <= length <= size - file.tell():
                    body = file.read(length)
                    pairs = np.frombuffer(body, '<i8', offset=6, count=(length - 6) // 16 * 2)
                    parts.append(pairs[1::2])
                    continue
            file.seek(position)
            return np.concatenate(parts) if parts else None

    def _chunk(
        self, position: int, inside: tuple[bytes, bool] | None, raw: _Raw,
    ) -> Piece | None:
        if inside is None:
            return None
        data, whole = inside
        records = scan(data, raw.offsets)
        self._keep_all(position, data, records)
        if records.end < len(data) or not whole:
            self._lose(position, 'the end of a chunk')
        return Piece(data, records.messages, raw.number, raw.end)

    def _uncompressed(self, position: int, body: bytes) -> tuple[bytes, bool] | None:
        """Return the inside of a chunk and whether it is all of it; None if nothing is whole."""
        try:
            _, _, size, crc, name_length = _read_chunk_head(body)
            compression = body[32:32 + name_length].decode()
            (stored,) = struct.unpack_from('<Q', body, 32 + name_length)
        except (struct.error, UnicodeDecodeError):
            self._lose(position, 'a chunk cut within its head')
            return None
        packed = memoryview(body)[40 + name_length:40 + name_length + stored]
        if len(packed) < stored:
            if compression:
                self._lose(position, f'a chunk of which {len(packed)} of {stored} bytes are left')
                return None
            return bytes(packed), False
        try:
            data = _decompress(packed, compression, size)
        except (zstandard.ZstdError, RuntimeError, MemoryError, OverflowError) as error:
            self._lose(position, f'a chunk that does not decompress ({error})')
            return None
        if len(data) != size or (crc != 0 and zlib.crc32(data) != crc):
            self._lose(position, 'a chunk whose checksum is wrong')
            return None
        return data, True

    def _keep_all(self, position: int, data: bytes, records: Records) -> None:
        for start in records.others:
            opcode, length = _read_head(data[start:start + HEAD_BYTES])
            body_start = start + HEAD_BYTES
            self._keep(position, opcode, data[body_start:body_start + length])

    def _keep(self, position: int, opcode: int, body: bytes) -> None:
        """Note a record that is no message."""
        stream = ReadDataStream(io.BytesIO(body))
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self.schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(stream)
                self.channels[channel.id] = channel
            elif opcode == Opcode.METADATA:
                self.metadata.append(Metadata.read(stream))
            elif opcode == Opcode.ATTACHMENT:
                if zlib.crc32(body[:-4]) != int.from_bytes(body[-4:], 'little') != 0:
                    self._lose(position, 'an attachment whose checksum is wrong')
                    return
                self.attachments.append(Attachment.read(stream))
        except (McapError, struct.error, UnicodeDecodeError) as error:
            self._lose(position, f'a record of kind {opcode} that does not parse ({error})')

    def _lose(self, position: int, what: str) -> None:
        self._lose_at(position, f'{self.path.name}: {what}, from byte {position} on')

    def _lose_at(self, position: int, text: str) -> None:
        self._damage.append((position, text))


def _decompress(data: memoryview, compression: str, size: int) -> bytes:
    if compression == 'zstd':
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    if compression == 'lz4':
        return bytes(lz4.frame.decompress(data))
    if compression == '':
        return bytes(data)
    raise BagError(f'chunk compression {compression!r} is none of zstd, lz4 and none')
