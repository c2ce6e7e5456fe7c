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

"""Pieces of MCAP files, one after the other and by their position; damage between chunks."""

import struct
import zlib

import numpy as np
import pytest

from piezo_ros.bag.container.mcap_file import McapFile
from piezo_ros.streams import BlockCodec

SAMPLES = np.random.default_rng(3).normal(size=(200, 1000))


@pytest.fixture(params=['zstd', 'lz4', 'none', 'unchunked'])
def path(request, record_foreign, tmp_path):
    codec = BlockCodec('voltage')
    blocks = [
        ('/voltage', codec.encode(1000 * number, 1e-5, row)) for number, row in enumerate(SAMPLES)]
    options = (
        {'chunked': False} if request.param == 'unchunked'
        else {'compression': request.param, 'chunk_size': 100_000})
    record_foreign(tmp_path / 'a.mcap', blocks, **options)
    return tmp_path / 'a.mcap'


def test_every_piece_can_be_read_again_by_its_position(path):
    pieces = list(McapFile(path).pieces())
    assert len(pieces) > 1
    assert sum(piece.messages.size for piece in pieces) == len(SAMPLES)
    chosen = pieces[1::2]
    again = list(McapFile(path).pieces(piece.position for piece in chosen))
    assert len(again) == len(chosen)
    for one, other in zip(again, chosen, strict=True):
        assert (one.position, one.data) == (other.position, other.data)
        np.testing.assert_array_equal(one.messages, other.messages)


def _records_before(path, tmp_path, *records):
    """Put records ahead of all others but the header."""
    raw = path.read_bytes()
    start = 8 + 9 + int.from_bytes(raw[9:17], 'little')
    changed = tmp_path / 'changed.mcap'
    changed.write_bytes(raw[:start] + b''.join(
        struct.pack('<BQ', opcode, len(body)) + body for opcode, body in records) + raw[start:])
    return changed


@pytest.mark.parametrize(
    'body', [b'', b'\xff' * 3, b'\xff' * 40, struct.pack('<I', 3) + b'\xff' * 3])
@pytest.mark.parametrize('opcode', [0x03, 0x04, 0x0C])
def test_a_record_that_does_not_parse_is_named_and_the_rest_is_read(path, tmp_path, opcode, body):
    file = McapFile(_records_before(path, tmp_path, (opcode, body)))
    assert sum(piece.messages.size for piece in file.pieces()) == len(SAMPLES)
    (loss,) = file.damage
    assert f'a record of kind {opcode} that does not parse' in loss


def test_an_unknown_record_is_no_damage(path, tmp_path):
    file = McapFile(_records_before(path, tmp_path, (0x80, b'private')))
    assert sum(piece.messages.size for piece in file.pieces()) == len(SAMPLES)
    assert file.damage == []


def test_a_message_shorter_than_its_head_is_named(path, tmp_path):
    file = McapFile(_records_before(path, tmp_path, (0x05, bytes(21)), (0x80, b'')))
    assert sum(piece.messages.size for piece in file.pieces()) == len(SAMPLES)
    (loss,) = file.damage
    assert 'records that are not whole' in loss


def _with_data_checksum(path, start):
    """Let the record that ends the data have a checksum of all before it from an offset on."""
    raw = bytearray(path.read_bytes())
    data_end = raw.rindex(struct.pack('<BQ', 0x0F, 4))
    raw[data_end + 9:data_end + 13] = struct.pack('<I', zlib.crc32(raw[start:data_end]))
    path.write_bytes(raw)
    return bytes(raw), data_end


def _behind_header(raw):
    return 8 + 9 + int.from_bytes(raw[9:17], 'little')


@pytest.mark.parametrize('of_file', [True, False])
def test_a_checksum_of_all_data_is_compared(path, of_file):
    raw, data_end = _with_data_checksum(path, 0 if of_file else _behind_header(path.read_bytes()))
    file = McapFile(path)
    assert sum(piece.messages.size for piece in file.pieces()) == len(SAMPLES)
    assert file.damage == []
    damaged = bytearray(raw)
    damaged[data_end + 9] ^= 1
    path.write_bytes(damaged)
    file = McapFile(path)
    assert sum(piece.messages.size for piece in file.pieces()) == len(SAMPLES)
    (loss,) = file.damage
    assert 'something in it, or the checksum of all, was changed' in loss
