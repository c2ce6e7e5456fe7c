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

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from piezo_ros.bag.container.chunk_scan import scan

MESSAGE = 0x05


def _record(opcode, body):
    return struct.pack('<BQ', opcode, len(body)) + body


messages = st.binary(min_size=22, max_size=60).map(lambda body: _record(MESSAGE, body))
# A record that holds what looks like a message, at an offset a wrong index may name.
decoys = messages.map(lambda message: _record(0x0C, message))
others = st.tuples(st.sampled_from([0x03, 0x04, 0x0C, 0x80]), st.binary(max_size=40)).map(
    lambda pair: _record(*pair))
records = st.lists(st.one_of(messages, messages, others, decoys), max_size=20)


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


@given(records, st.data())
def test_an_index_right_or_wrong_or_partial_changes_nothing(parts, data):
    whole = b''.join(parts)
    cut = whole[:data.draw(st.integers(0, len(whole)))]
    right = _offsets(parts, MESSAGE)
    index = data.draw(st.one_of(
        st.permutations(right),
        st.permutations(_offsets(parts)),
        st.lists(st.sampled_from(right)) if right else st.just([]),
        st.just([offset + 9 for offset in _offsets(parts, 0x0C)] + right),
        st.lists(st.integers(-2**63, 2**63 - 1)),
        st.lists(st.integers(0, max(len(cut), 1))),
    ))
    plain = scan(cut)
    helped = scan(cut, np.array(index, dtype=np.int64))
    assert helped.messages.tolist() == plain.messages.tolist()
    assert helped.others == plain.others
    assert helped.end == plain.end


def test_an_index_of_a_record_of_another_kind_changes_nothing():
    other = _record(0x04, bytes(30))
    found = scan(_record(MESSAGE, bytes(30)) + other, np.array([0, 39]))
    assert (found.messages.tolist(), found.others) == ([0], [39])


def test_an_index_into_another_record_changes_nothing():
    decoy = _record(0x0C, _record(MESSAGE, bytes(30)))
    found = scan(decoy + _record(MESSAGE, bytes(30)), np.array([9, len(decoy)]))
    assert (found.messages.tolist(), found.others) == ([len(decoy)], [0])


def test_an_index_of_a_message_that_is_cut_off_changes_nothing():
    cut = (_record(MESSAGE, bytes(30)) * 2)[:-1]
    found = scan(cut, np.array([0, 39]))
    assert found.messages.tolist() == [0]
    assert found.end == 39


@given(records, st.integers(0, 2000))
def test_of_a_cut_buffer_the_whole_records_are_found(parts, length):
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
