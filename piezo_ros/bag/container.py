"""
Sequential reading of one MCAP file, whole or cut anywhere.

The index at the end of a file is not used: what is read is what is there, and a file whose writer
was killed is read like any other up to its last whole record.
"""

import io
import struct
import zlib
from collections.abc import Iterator
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

from piezo_ros.bag.chunk_scan import HEAD_BYTES, Records, scan
from piezo_ros.bag.errors import BagError

__all__ = ['McapFile', 'Piece']

_LOOSE_BYTES: Final = 1 << 20  # messages outside chunks are handed on in pieces of this size
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

    """

    data: bytes
    messages: NDArray[np.int64]


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
    damage : list of str
        Sentences that say what is cut off or damaged, in the order of the file.
    complete : bool
        Whether the writer came to the end of the data.

    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.metadata: list[Metadata] = []
        self.attachments: list[Attachment] = []
        self.damage: list[str] = []
        self.complete = False

    def pieces(self) -> Iterator[Piece]:
        """
        Yield all whole message records of the file, in its order.

        Raises
        ------
        BagError
            If the file cannot be opened or is no MCAP file.

        """
        try:
            with self.path.open('rb') as file:
                yield from self._pieces(file)
        except OSError as error:
            raise BagError(f'cannot read {self.path}: {error.strerror}') from error

    def _pieces(self, file: BinaryIO) -> Iterator[Piece]:
        size = file.seek(0, io.SEEK_END)
        file.seek(0)
        magic = file.read(len(MCAP0_MAGIC))
        if magic != MCAP0_MAGIC:
            raise BagError(
                f'{self.path} is no MCAP file: it begins with {magic!r}, not {MCAP0_MAGIC!r}')
        loose: list[bytes] = []
        loose_bytes = 0
        for position, opcode, body in self._records(file, size):
            if opcode == Opcode.MESSAGE:
                loose.append(struct.pack('<BQ', opcode, len(body)) + body)
                loose_bytes += len(loose[-1])
                if loose_bytes < _LOOSE_BYTES:
                    continue
            if loose:
                data, loose, loose_bytes = b''.join(loose), [], 0
                yield Piece(data, scan(data).messages)
            if opcode == Opcode.CHUNK:
                yield from self._chunk(position, body, self._message_index(file, size))
            elif opcode != Opcode.MESSAGE:
                self._keep(position, opcode, body)
        if loose:
            data = b''.join(loose)
            yield Piece(data, scan(data).messages)
        if not self.complete:
            self.damage.append(f'{self.path.name} was not closed by its writer')

    def _records(self, file: BinaryIO, size: int) -> Iterator[tuple[int, int, bytes]]:
        """Yield offset, opcode and body of each whole record of the data section."""
        while True:
            position = file.tell()
            head = file.read(HEAD_BYTES)
            if len(head) < HEAD_BYTES:
                break
            opcode, length = _read_head(head)
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                self.complete = True
                return
            if opcode == 0 or length > size - file.tell():
                if opcode == Opcode.CHUNK:
                    yield position, opcode, file.read()
                    return
                break
            yield position, opcode, file.read(length)
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
        self, position: int, body: bytes, index: NDArray[np.int64] | None,
    ) -> Iterator[Piece]:
        inside = self._uncompressed(position, body)
        if inside is None:
            return
        data, whole = inside
        records = scan(data, index)
        self._keep_all(position, data, records)
        if records.end < len(data) or not whole:
            self._lose(position, 'the end of a chunk')
        yield Piece(data, records.messages)

    def _uncompressed(self, position: int, body: bytes) -> tuple[bytes, bool] | None:
        """Return the inside of a chunk and whether it is all of it; None if nothing is whole."""
        try:
            _, _, size, crc, name_length = _read_chunk_head(body)
            compression = body[32:32 + name_length].decode()
            (stored,) = struct.unpack_from('<Q', body, 32 + name_length)
        except (struct.error, UnicodeDecodeError):
            self._lose(position, 'a chunk cut within its head')
            return None
        data = body[40 + name_length:]
        if len(data) < stored:
            if compression:
                self._lose(position, f'a chunk of which {len(data)} of {stored} bytes are left')
                return None
            return data, False
        try:
            data = _decompress(data[:stored], compression, size)
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
        self.damage.append(f'{self.path.name}: {what}, from byte {position} on')


def _decompress(data: bytes, compression: str, size: int) -> bytes:
    if compression == 'zstd':
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    if compression == 'lz4':
        return bytes(lz4.frame.decompress(data))
    if compression == '':
        return data
    raise BagError(f'chunk compression {compression!r} is none of zstd, lz4 and none')
