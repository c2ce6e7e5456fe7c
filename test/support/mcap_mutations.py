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
Damage to MCAP files as data: each kind of it is a function of a random generator and bytes.

It returns the damaged bytes, and raises IndexError or ValueError where the file has nothing that it
could damage. The same generator gives the same damage.
"""

import struct
import zlib
from functools import partial

import lz4.frame
import zstandard
from mcap.opcode import Opcode

__all__ = ['BYTES', 'CHUNKS', 'MESSAGES', 'RECORDS', 'of_a_chunk', 'records_of']

MAGIC_BYTES = 8
_HEAD = struct.Struct('<BQ')
_CHUNK = struct.Struct('<QQQI')
_SIZES = (0, 1, 2**16, 2**31, 2**32 - 1, 2**40, 2**63, 2**64 - 1)
COMPRESSIONS = ('', 'zstd', 'lz4', 'none', 'ZSTD', 'bzip2', 'zstd ', '\0', 'a' * 300, 'µ')
KINDS = (
    Opcode.HEADER, Opcode.FOOTER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK,
    Opcode.MESSAGE_INDEX, Opcode.CHUNK_INDEX, Opcode.ATTACHMENT, Opcode.ATTACHMENT_INDEX,
    Opcode.STATISTICS, Opcode.METADATA, Opcode.METADATA_INDEX, Opcode.SUMMARY_OFFSET,
    Opcode.DATA_END)
# Of these there are several in a file.
SEVERAL_KINDS = (
    Opcode.CHANNEL, Opcode.CHUNK, Opcode.METADATA, Opcode.CHUNK_INDEX, Opcode.MESSAGE_INDEX)
MOVED_KINDS = (*SEVERAL_KINDS, Opcode.SCHEMA, Opcode.ATTACHMENT, Opcode.STATISTICS)


def records_of(raw):
    """Return opcode and body of each whole record between the magics of an MCAP file."""
    position, records = MAGIC_BYTES, []
    while position + _HEAD.size <= len(raw) - MAGIC_BYTES:
        opcode, length = _HEAD.unpack_from(raw, position)
        position += _HEAD.size
        records.append((opcode, raw[position:position + length]))
        position += length
    return records


def _joined(raw, records):
    return b''.join([
        raw[:MAGIC_BYTES],
        *(_HEAD.pack(opcode, len(body)) + body for opcode, body in records),
        raw[-MAGIC_BYTES:]])


def without_data_checksum(raw):
    """Return an MCAP file as a writer leaves it that gives no checksum of all data, as rosbag2."""
    return _joined(raw, [
        (opcode, bytes(len(body)) if opcode == Opcode.DATA_END else body)
        for opcode, body in records_of(raw)])


# --- bytes of a file ------------------------------------------------------------------------------


def _truncate(generator, raw):
    return raw[:generator.randrange(len(raw))] if raw else raw


def _flip_bit(generator, raw):
    return _overwritten(raw, place := generator.randrange(len(raw)), bytes([
        raw[place] ^ 1 << generator.randrange(8)]))


def _flip_bytes(generator, raw):
    for _ in range(generator.randint(1, 8)):
        raw = _overwritten(raw, generator.randrange(len(raw)), generator.randbytes(1))
    return raw


def _overwrite_range(generator, raw, *, filler=None):
    start, length = generator.randrange(len(raw)), min(2 ** generator.randrange(14), len(raw))
    new = generator.randbytes(length) if filler is None else filler * length
    return _overwritten(raw, start, new)[:len(raw)]


def _delete_range(generator, raw):
    start = generator.randrange(len(raw))
    return raw[:start] + raw[start + 2 ** generator.randrange(12):]


def _insert_bytes(generator, raw):
    start = generator.randrange(len(raw))
    return raw[:start] + generator.randbytes(2 ** generator.randrange(12)) + raw[start:]


def _repeat_range(generator, raw):
    start = generator.randrange(len(raw))
    part = raw[start:start + 2 ** generator.randrange(14)]
    return raw[:start] + part + raw[start:]


def _empty(generator, raw):
    return b''


def _only_random(generator, raw):
    return generator.randbytes(len(raw))


def _append(generator, raw):
    return raw + generator.choice([b'\0', raw, generator.randbytes(100), raw[:MAGIC_BYTES]])


def _overwritten(raw, start, new):
    return raw[:start] + new + raw[start + len(new):]


BYTES = {
    'truncate': _truncate, 'flip a bit': _flip_bit, 'flip bytes': _flip_bytes,
    'overwrite a range': _overwrite_range,
    'zero a range': partial(_overwrite_range, filler=b'\0'),
    'fill a range with ones': partial(_overwrite_range, filler=b'\xff'),
    'delete a range': _delete_range, 'insert bytes': _insert_bytes,
    'repeat a range': _repeat_range, 'empty file': _empty, 'random file': _only_random,
    'append': _append,
}


# --- records of a file ----------------------------------------------------------------------------


def _places(records, kind):
    return [number for number, (opcode, _) in enumerate(records) if opcode == kind]


def _flip_in_record(generator, raw, *, kind):
    """Change a byte of a record of a kind, its opcode and length included."""
    records = records_of(raw)
    number = generator.choice(_places(records, kind))
    start = MAGIC_BYTES + sum(_HEAD.size + len(body) for _, body in records[:number])
    place = start + generator.randrange(_HEAD.size + len(records[number][1]))
    return _overwritten(raw, place, bytes([raw[place] ^ generator.randint(1, 255)]))


def _drop_record(generator, raw, *, kind):
    records = records_of(raw)
    del records[generator.choice(_places(records, kind))]
    return _joined(raw, records)


def _repeat_record(generator, raw, *, kind):
    records = records_of(raw)
    record = records[generator.choice(_places(records, kind))]
    records.insert(generator.randrange(len(records)), record)
    return _joined(raw, records)


def _shuffle_records(generator, raw, *, kind):
    records = records_of(raw)
    places = _places(records, kind)
    shuffled = generator.sample(places, len(places))
    moved = [records[number] for number in shuffled]
    for place, record in zip(places, moved, strict=True):
        records[place] = record
    return _joined(raw, records)


def _wrong_length(generator, raw, *, kind):
    """Change the length of a record but not its body."""
    records = records_of(raw)
    number = generator.choice(_places(records, kind))
    start = MAGIC_BYTES + sum(_HEAD.size + len(body) for _, body in records[:number])
    length = len(records[number][1])
    wrong = generator.choice([
        *_SIZES, length - 1, length + 1, generator.randrange(2 * length + 2),
        generator.getrandbits(64)])
    return _overwritten(raw, start + 1, struct.pack('<Q', wrong % 2**64))


def _other_opcode(generator, raw, *, kind):
    records = records_of(raw)
    number = generator.choice(_places(records, kind))
    records[number] = generator.randrange(256), records[number][1]
    return _joined(raw, records)


RECORDS = {
    'flip a byte of a record': (_flip_in_record, KINDS),
    'drop a record': (_drop_record, MOVED_KINDS),
    'repeat a record': (_repeat_record, MOVED_KINDS),
    'shuffle records': (_shuffle_records, SEVERAL_KINDS),
    'wrong length of a record': (_wrong_length, KINDS),
    'other opcode of a record': (_other_opcode, KINDS),
}


# --- chunks ---------------------------------------------------------------------------------------


class _Chunk:
    """The fields of a chunk record."""

    def __init__(self, body):
        self.start, self.end, self.size, self.crc = _CHUNK.unpack_from(body)
        length = struct.unpack_from('<I', body, _CHUNK.size)[0]
        position = _CHUNK.size + 4 + length
        self.compression = body[_CHUNK.size + 4:position].decode()
        self.data = body[position + 8:]

    def body(self):
        name = self.compression.encode()
        return b''.join([
            _CHUNK.pack(self.start, self.end, self.size, self.crc), struct.pack('<I', len(name)),
            name, struct.pack('<Q', len(self.data)), self.data])

    def content(self):
        """Return opcode and body of the records in it."""
        data = self.data
        if self.compression == 'zstd':
            data = zstandard.ZstdDecompressor().decompress(data, max_output_size=self.size)
        elif self.compression == 'lz4':
            data = lz4.frame.decompress(data)
        padding = bytes(MAGIC_BYTES)
        return records_of(padding + data + padding)

    def pack(self, records):
        """Put records into it, with the right length and CRC."""
        data = b''.join(_HEAD.pack(opcode, len(body)) + body for opcode, body in records)
        self.size, self.crc = len(data), zlib.crc32(data)
        self.data = {
            '': bytes, 'zstd': zstandard.ZstdCompressor().compress, 'lz4': lz4.frame.compress,
        }[self.compression](data)


def of_a_chunk(change):
    """Return the mutation of a file that changes one of its chunks."""
    def mutate(generator, raw):
        records = records_of(raw)
        number = generator.choice(_places(records, Opcode.CHUNK))
        chunk = _Chunk(records[number][1])
        change(generator, chunk)
        records[number] = Opcode.CHUNK, chunk.body()
        return _joined(raw, records)
    return mutate


def _wrong_crc(generator, chunk):
    # A CRC of zero says that there is none.
    chunk.crc = (chunk.crc + generator.randint(1, 2**32 - 1)) % 2**32 or 1


def _other_compression(generator, chunk):
    chunk.compression = generator.choice([
        name for name in COMPRESSIONS if name != chunk.compression])


def _wrong_size(generator, chunk):
    chunk.size = generator.choice([
        size for size in (*_SIZES, chunk.size - 1, chunk.size + 1, 2 * chunk.size)
        if size != chunk.size])


def _no_data(generator, chunk):
    chunk.data = b''


def _wrong_times(generator, chunk):
    chunk.start, chunk.end = generator.getrandbits(64), generator.getrandbits(64)


def _chunk_within(generator, chunk):
    chunk.pack([(Opcode.CHUNK, chunk.body()), *chunk.content()])


def _messages_of(records):
    return _places(records, Opcode.MESSAGE)


def _drop_message(generator, chunk):
    records = chunk.content()
    del records[generator.choice(_messages_of(records))]
    chunk.pack(records)


def _repeat_message(generator, chunk):
    records = chunk.content()
    places = _messages_of(records)
    records.insert(generator.choice(places), records[generator.choice(places)])
    chunk.pack(records)


def _shuffle_messages(generator, chunk):
    records = chunk.content()
    places = _messages_of(records)
    moved = [records[place] for place in generator.sample(places, len(places))]
    for place, record in zip(places, moved, strict=True):
        records[place] = record
    chunk.pack(records)


def _other_channel(generator, chunk):
    records = chunk.content()
    place = generator.choice(_messages_of(records))
    body = records[place][1]
    number = generator.choice([0, 1, 2, 3, 4, 5, 6, 77, 65535])
    records[place] = Opcode.MESSAGE, struct.pack('<H', number) + body[2:]
    chunk.pack(records)


def _other_log_time(generator, chunk):
    records = chunk.content()
    place = generator.choice(_messages_of(records))
    body = records[place][1]
    time_ns = generator.choice([0, 2**63 - 1, 2**63, 2**64 - 5, generator.getrandbits(64)])
    records[place] = Opcode.MESSAGE, _overwritten(body, 6, struct.pack('<Q', time_ns))
    chunk.pack(records)


def _cut_message(generator, chunk):
    records = chunk.content()
    place = generator.choice(_messages_of(records))
    body = records[place][1]
    records[place] = Opcode.MESSAGE, body[:generator.randrange(len(body))]
    chunk.pack(records)


def _malformed_message(generator, chunk):
    """Overwrite the head of the CDR bytes of a message: all but index, period and samples."""
    records = chunk.content()
    place = generator.choice(_messages_of(records))
    head, data = records[place][1][:22], records[place][1][22:]
    what = generator.randrange(4)
    if what == 0:
        data = bytes([0, generator.choice([2, 3, 6, 8, 10, 255])]) + data[2:]
    elif what == 1:
        data = _overwritten(data, 4, struct.pack('<I', generator.choice([0, 2, 2**31])))
    elif what == 2:
        data = _overwritten(data, 8, struct.pack('<I', generator.choice([0, 1, 2**31])))
    else:
        data = _overwritten(data, 12, generator.randbytes(3))
    records[place] = Opcode.MESSAGE, head + data
    chunk.pack(records)


def _not_finite(generator, chunk):
    records = chunk.content()
    place = generator.choice(_messages_of(records))
    body = records[place][1]
    number = struct.pack('<d', generator.choice([float('nan'), float('inf'), -float('inf')]))
    records[place] = Opcode.MESSAGE, body[:-8] + number
    chunk.pack(records)


CHUNKS = {
    'wrong CRC of a chunk': _wrong_crc, 'other compression of a chunk': _other_compression,
    'wrong size of a chunk': _wrong_size, 'chunk without data': _no_data,
    'wrong times of a chunk': _wrong_times, 'chunk within a chunk': _chunk_within,
}
# These bags are in order for whatever reads MCAP alone: the CRC of the chunk is right.
MESSAGES = {
    'drop a message': _drop_message, 'repeat a message': _repeat_message,
    'shuffle messages': _shuffle_messages, 'message of another channel': _other_channel,
    'other log time': _other_log_time, 'cut a message': _cut_message,
    'malformed message': _malformed_message, 'sample that is not finite': _not_finite,
}
