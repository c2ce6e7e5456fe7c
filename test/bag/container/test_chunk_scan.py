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

import struct
import tracemalloc

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from piezo_ros.bag.container.chunk_scan import scan

MESSAGE = 0x05


def _record(opcode, body):
    return struct.pack('<BQ', opcode, len(body)) + body


messages = st.binary(min_size=22, max_size=60).map(lambda body: _record(MESSAGE, body))
# A record that contains what looks like a message.
decoys = messages.map(lambda message: _record(0x0C, message))
others = st.tuples(st.sampled_from([0x03, 0x04, 0x0C, 0x80]), st.binary(max_size=40)).map(
    lambda pair: _record(*pair))
short_records = st.lists(st.one_of(messages, messages, others, decoys), max_size=20)
# Records that are long on the average are found in another way than many short ones.
records = st.tuples(short_records, st.booleans()).map(
    lambda pair: pair[0] + [_record(MESSAGE, bytes(200_000))] * pair[1])


def _offsets(parts, opcode=None):
    starts = np.cumsum([0, *map(len, parts)])[:-1].tolist()
    return [
        start for start, part in zip(starts, parts, strict=True)
        if opcode is None or part[0] == opcode
    ]


@given(records)
def test_every_record_is_found(parts):
    found = scan(b''.join(parts))
    inside = _offsets(parts)
    assert found.messages.tolist() == _offsets(parts, MESSAGE)
    assert sorted([*found.messages.tolist(), *found.others]) == inside
    assert found.end == sum(map(len, parts))


def _walked(data):
    """Find the records of a buffer one after the other."""
    starts, position = [], 0
    while position + 9 <= len(data):
        opcode, length = struct.unpack_from('<BQ', data, position)
        if opcode == 0 or position + 9 + length > len(data):
            break
        if opcode == MESSAGE and length < 22:
            break
        starts.append(position)
        position += 9 + length
    return starts, position


@given(records, st.integers(0, 2000), st.integers(0, 2000), st.integers(0, 255))
def test_in_a_damaged_buffer_the_same_is_found_as_by_a_plain_walk(parts, left_out, place, byte):
    whole = b''.join(parts)
    data = bytearray(whole[:max(len(whole) - left_out, 0)])
    if place < len(data):
        data[place] = byte
    found = scan(bytes(data))
    starts, end = _walked(data)
    assert found.messages.tolist() == [start for start in starts if data[start] == MESSAGE]
    assert found.others == [start for start in starts if data[start] != MESSAGE]
    assert found.end == end


def test_a_message_within_another_record_is_not_found():
    decoy = _record(0x0C, _record(MESSAGE, bytes(30)))
    found = scan(decoy + _record(MESSAGE, bytes(30)))
    assert (found.messages.tolist(), found.others) == ([len(decoy)], [0])


def test_a_message_within_a_message_is_not_found():
    decoy = _record(MESSAGE, bytes(22) + _record(MESSAGE, bytes(30)) * 2)
    found = scan(decoy * 3)
    assert found.messages.tolist() == [0, len(decoy), 2 * len(decoy)]


def test_a_message_that_is_cut_off_is_not_found():
    cut = (_record(MESSAGE, bytes(30)) * 2)[:-1]
    found = scan(cut)
    assert found.messages.tolist() == [0]
    assert found.end == 39


@given(records, st.integers(0, 2000))
def test_of_a_cut_buffer_the_whole_records_are_found(parts, left_out):
    length = max(sum(map(len, parts)) - left_out, 0)
    found = scan(b''.join(parts)[:length])
    ends = np.cumsum(list(map(len, parts)), dtype=int)
    assert found.messages.size + len(found.others) == int((ends <= length).sum())


@given(st.binary(max_size=200))
def test_any_bytes_end_the_scan_without_an_error(data):
    assert 0 <= scan(data).end <= len(data)


def test_zeros_as_a_loss_of_power_leaves_them_end_the_scan():
    good = _record(MESSAGE, bytes(22))
    found = scan(good + bytes(100))
    assert (found.messages.tolist(), found.others, found.end) == ([0], [], len(good))


def test_a_message_shorter_than_its_head_ends_the_scan():
    good = _record(MESSAGE, bytes(22))
    assert scan(good + _record(MESSAGE, bytes(21)) + good).messages.tolist() == [0]


def test_candidates_that_are_no_messages_take_little_memory():
    size = 4 << 20
    empty = _record(0x70, b'') * (size // 4096 + 10)
    data = empty + b'\x05' * (size - len(empty))
    tracemalloc.start()
    try:
        found = scan(data)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert found.end == len(empty)
    assert peak < 4 * size + (24 << 20)
