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
Decompression of the chunks of an MCAP file within the size that they claim.

The size of the buffer is settled before the first byte is decompressed, so that no chunk takes more
memory than it claims, and no chunk may claim more than `allowed_bytes`.
"""

import zlib
from typing import Final

import lz4.frame
import zstandard
from mcap.records import Chunk

__all__ = ['COMPRESSIONS', 'ChunkError', 'allowed_bytes', 'chunk_data']

COMPRESSIONS: Final = ('zstd', 'lz4', '')
# Recorders write chunks of about 1 MB. Repeated samples shrink a hundred times at most; more is
# taken from a chunk that is small enough anyway.
_ALWAYS_ALLOWED_BYTES: Final = 64 << 20
_ALLOWED_RATIO: Final = 250
_DECOMPRESSION_ERRORS: Final = (zstandard.ZstdError, RuntimeError, MemoryError, OverflowError)


class ChunkError(ValueError):
    """A chunk of which nothing can be used; the text names the cause."""


def allowed_bytes(compressed_bytes: int) -> int:
    """Return the largest size, bytes, that a chunk of this compressed size may claim."""
    return max(_ALWAYS_ALLOWED_BYTES, _ALLOWED_RATIO * compressed_bytes)


def chunk_data(chunk: Chunk) -> bytes:
    """
    Return the records in a chunk.

    Parameters
    ----------
    chunk : Chunk
        A whole chunk, compressed in one of `COMPRESSIONS`.

    Returns
    -------
    bytes
        The records, of the size that the chunk claims.

    Raises
    ------
    ChunkError
        If the chunk claims more than is allowed, contains more or less than it claims, does not
        decompress, or has a wrong checksum.

    """
    claimed = chunk.uncompressed_size
    if claimed > allowed_bytes(len(chunk.data)):
        raise ChunkError(
            f'a chunk that claims {claimed} bytes from {len(chunk.data)} compressed ones, more '
            f'than the {allowed_bytes(len(chunk.data))} allowed')
    try:
        data = _DECOMPRESS[chunk.compression](chunk.data, claimed)
    except _DECOMPRESSION_ERRORS as error:
        raise ChunkError(f'a chunk that does not decompress ({error})') from None
    if len(data) != claimed:
        raise _other_size(str(len(data)), claimed)
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ChunkError('a chunk with a wrong checksum')
    return data


def _zstd(data: bytes, claimed: int) -> bytes:
    # The library allocates what the frame says, whatever limit it is given; -1: not said.
    size = zstandard.frame_content_size(data)
    if size not in (-1, claimed):
        raise _other_size(str(size), claimed)
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=claimed)


def _lz4(data: bytes, claimed: int) -> bytes:
    frame = lz4.frame.LZ4FrameDecompressor()
    found: bytes = frame.decompress(data, max_length=max(claimed, 1))
    # One byte more shows whether there is more; it also reads the end of the frame.
    if not frame.eof and not frame.needs_input and frame.decompress(b'', max_length=1):
        raise _other_size(f'more than {claimed}', claimed)
    if not frame.eof and len(found) >= claimed:
        raise RuntimeError('the frame is not complete')
    return found


def _stored(data: bytes, claimed: int) -> bytes:
    return bytes(data)


_DECOMPRESS: Final = {'zstd': _zstd, 'lz4': _lz4, '': _stored}


def _other_size(size: str, claimed: int) -> ChunkError:
    return ChunkError(f'a chunk of {size} bytes that should hold {claimed}')
