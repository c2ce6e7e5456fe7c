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

"""The summary section behind the data of an MCAP file: what its writer has counted."""

import io
import struct
import zlib
from collections.abc import Callable
from typing import BinaryIO, Final, NamedTuple, TypeVar

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema, Statistics
from mcap.writer import MCAP0_MAGIC

from piezo_ros.bag.container.chunk_scan import HEAD_BYTES, read_head

__all__ = ['PARSE_ERRORS', 'Summary', 'checksum_holds', 'parsed', 'read_summary']

PARSE_ERRORS: Final = (McapError, struct.error, UnicodeDecodeError, OverflowError, MemoryError)
_LARGEST_BYTES: Final = 256 << 20
_FOOTER_BYTES: Final = HEAD_BYTES + 20
_CHECKSUM_BYTES: Final = 4
_PART_BYTES: Final = 1 << 20
_Record = TypeVar('_Record')


class Summary(NamedTuple):
    """
    What is said at the end of a file of all that is before.

    Attributes
    ----------
    schemas, channels : list
        The records, which stand in the data as well.
    statistics : Statistics or None
        Numbers of records of each kind; None if the writer has not counted.

    """

    schemas: list[Schema]
    channels: list[Channel]
    statistics: Statistics | None


def parsed(read: Callable[[ReadDataStream], _Record], body: bytes) -> _Record:
    """Return the record with this body."""
    return read(ReadDataStream(io.BytesIO(body)))


def checksum_holds(file: BinaryIO, end: int, checksum: int) -> bool:
    """
    Return whether the checksum that ends the data is right, or the writer gave none.

    Writers differ in whether it begins with the file or behind the header: both are taken.

    Parameters
    ----------
    file : file
        The file.
    end : int
        Where the record that ends the data begins.
    checksum : int
        That of the file up to there.

    """
    file.seek(end + HEAD_BYTES)
    told = int.from_bytes(file.read(_CHECKSUM_BYTES), 'little')
    if told in (0, checksum):
        return True
    file.seek(len(MCAP0_MAGIC))
    _, header_length = read_head(file.read(HEAD_BYTES))
    return _checksum(file, len(MCAP0_MAGIC) + HEAD_BYTES + header_length, end) == told


def _checksum(file: BinaryIO, start: int, end: int) -> int:
    """Return the checksum of a part of a file."""
    file.seek(start)
    checksum = 0
    while start < end and (part := file.read(min(_PART_BYTES, end - start))):
        checksum = zlib.crc32(part, checksum)
        start += len(part)
    return checksum


def read_summary(file: BinaryIO, start: int) -> Summary | None:
    """
    Read the summary of a file.

    Parameters
    ----------
    file : file
        The file.
    start : int
        Where the record that ends the data begins.

    Returns
    -------
    Summary or None
        None if it is cut off, damaged or has no checksum: the data can be whole all the same.

    """
    size = file.seek(0, io.SEEK_END)
    if size - start > _LARGEST_BYTES:
        return None
    file.seek(start)
    data = file.read(size - start)
    if not data.endswith(MCAP0_MAGIC) or len(data) < HEAD_BYTES + _FOOTER_BYTES:
        return None
    _, length = read_head(data)
    first = HEAD_BYTES + length
    last = len(data) - len(MCAP0_MAGIC) - _FOOTER_BYTES
    opcode, _ = read_head(data, last)
    end = len(data) - len(MCAP0_MAGIC) - _CHECKSUM_BYTES
    checksum = int.from_bytes(data[end:end + _CHECKSUM_BYTES], 'little')
    if opcode != Opcode.FOOTER or checksum != zlib.crc32(data[first:end]):
        return None
    summary = Summary([], [], None)
    position = first
    while position < last:
        opcode, length = read_head(data, position)
        body = data[position + HEAD_BYTES:position + HEAD_BYTES + length]
        position += HEAD_BYTES + length
        try:
            if opcode == Opcode.SCHEMA:
                summary.schemas.append(parsed(Schema.read, body))
            elif opcode == Opcode.CHANNEL:
                summary.channels.append(parsed(Channel.read, body))
            elif opcode == Opcode.STATISTICS:
                summary = summary._replace(statistics=parsed(Statistics.read, body))
        except PARSE_ERRORS:
            return None
    return summary
