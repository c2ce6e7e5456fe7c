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

"""Chunks that contain more than they claim, or claim more than is reasonable (A5)."""

import struct
import tracemalloc
import zlib

import lz4.frame
import pytest
import zstandard
from mcap.records import Chunk

from piezo_ros.bag import BagError, open_recording, read, salvage
from piezo_ros.bag.container.chunk_data import ChunkError, allowed_bytes, chunk_data

BOMB_BYTES = 100_000_000
BOMB = {
    'zstd': lambda: zstandard.compress(bytes(BOMB_BYTES)),
    'zstd without a size': lambda: zstandard.ZstdCompressor(
        write_content_size=False).compress(bytes(BOMB_BYTES)),
    'lz4': lambda: lz4.frame.compress(bytes(BOMB_BYTES)),
}
FUNCTIONS = {'zstd': zstandard.compress, 'lz4': lz4.frame.compress, '': bytes}


def _chunk(data, claimed, compression, crc=0):
    return Chunk(
        compression=compression, data=data, message_end_time=0, message_start_time=0,
        uncompressed_crc=crc, uncompressed_size=claimed)


@pytest.mark.parametrize('kind', BOMB)
def test_a5_a_chunk_takes_no_more_memory_than_it_claims(kind):
    bomb = BOMB[kind]()
    tracemalloc.start()
    with pytest.raises(ChunkError) as error:
        chunk_data(_chunk(bomb, 1000, kind.split()[0]))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 10_000_000
    if kind == 'zstd':
        assert str(error.value) == f'a chunk of {BOMB_BYTES} bytes that should hold 1000'
    elif kind == 'lz4':
        assert str(error.value) == 'a chunk of more than 1000 bytes that should hold 1000'


@pytest.mark.parametrize('compression', ['zstd', 'lz4'])
def test_a5_a_chunk_may_not_claim_more_than_is_reasonable(compression):
    data = FUNCTIONS[compression](b'5' * 1000)
    with pytest.raises(ChunkError, match='claims 4200000000 bytes from .* more than the 67108864'):
        chunk_data(_chunk(data, 4_200_000_000, compression))
    assert allowed_bytes(10 << 20) == 2500 << 20


@pytest.mark.parametrize('compression', FUNCTIONS)
@pytest.mark.parametrize('size', [0, 1, 70_000, 5_000_000])
def test_what_is_as_large_as_it_claims_comes_back(compression, size):
    data = (b'0123456789abcdef' * (size // 16 + 1))[:size]
    chunk = _chunk(FUNCTIONS[compression](data), size, compression, zlib.crc32(data))
    assert chunk_data(chunk) == data


@pytest.mark.parametrize('compression', ['zstd', 'lz4'])
@pytest.mark.parametrize('cut', [1, 3, 20])
def test_a_chunk_that_ends_early_is_refused(compression, cut):
    data = FUNCTIONS[compression](bytes(range(256)) * 100)
    with pytest.raises(ChunkError):
        chunk_data(_chunk(data[:-cut], 25_600, compression))


def _with_bomb(path, compression):
    """Put a chunk that contains more than it claims ahead of the end of a file."""
    bomb = BOMB[compression]()
    body = struct.pack('<QQQII', 0, 0, 1000, 0, len(compression)) + compression.encode()
    body += struct.pack('<Q', len(bomb)) + bomb
    raw = path.read_bytes()
    end = raw.index(struct.pack('<BQ', 0x0F, 4))
    path.write_bytes(raw[:end] + struct.pack('<BQ', 0x06, len(body)) + body + raw[end:])
    return end


@pytest.mark.parametrize('compression', ['zstd', 'lz4'])
def test_a5_the_chunk_is_named_with_both_sizes_and_the_rest_is_read(
    tmp_path, write_run, compression,
):
    write_run(tmp_path / 'bag', 50)
    position = _with_bomb(tmp_path / 'bag' / 'bag_0.mcap', compression)
    size = BOMB_BYTES if compression == 'zstd' else 'more than 1000'
    words = f'bag_0.mcap: a chunk of {size} bytes that should hold 1000, from byte {position} on'
    with pytest.raises(BagError, match=words):
        read(tmp_path / 'bag')
    assert open_recording(tmp_path / 'bag', allow_loss=True).samples == 50
    assert len(salvage(tmp_path / 'bag', tmp_path / 'whole').lost) == 1
    assert read(tmp_path / 'whole').samples == 50
