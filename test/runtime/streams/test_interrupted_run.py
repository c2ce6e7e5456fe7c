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

"""A reader that begins a new run keeps the stragglers of the one before out of it."""

import numpy as np
import pytest
from fake_transport import PERIOD_S, FakeTransport, take_all
from hypothesis import given
from hypothesis import strategies as st


@pytest.fixture
def ends(transport):
    """Return a reader and a writer of which a run has begun."""
    reader, writer = transport.reader('voltage'), transport.writer('voltage')
    reader.start(0, PERIOD_S)
    writer.start(0, PERIOD_S)
    return reader, writer


def test_stragglers_that_came_before_the_new_run_are_thrown_away(ends):
    reader, writer = ends
    writer.publish([1.0, 2.0])
    take_all(reader)
    writer.publish([3.0, 4.0])
    writer.end()
    reader.discard_rest()
    writer.start(0, PERIOD_S)
    writer.publish([11.0, 12.0])
    reader.start(0, PERIOD_S)
    assert take_all(reader) == [11.0, 12.0]


def test_stragglers_that_come_after_its_begin_are_no_part_of_it(ends):
    reader, writer = ends
    writer.publish([1.0, 2.0])
    take_all(reader)
    reader.start(0, PERIOD_S)
    writer.publish([3.0, 4.0])
    writer.end()
    writer.start(0, PERIOD_S)
    writer.publish([11.0, 12.0])
    assert reader.take_array() is None
    assert reader.take_array() is None
    assert take_all(reader) == [11.0, 12.0]
    assert (reader.refused, reader.gaps) == (0, 0)


def test_samples_of_the_new_run_that_come_while_none_goes_on_are_held(ends):
    reader, writer = ends
    writer.publish([1.0])
    take_all(reader)
    writer.publish([2.0])
    writer.end()
    writer.start(0, PERIOD_S)
    for sample in (11.0, 12.0, 13.0):
        writer.publish_one(sample)
    reader.discard_rest()
    reader.discard_rest()
    reader.start(0, PERIOD_S)
    writer.publish_one(14.0)
    writer.end()
    assert take_all(reader) == [11.0, 12.0, 13.0, 14.0]
    assert reader.ended
    assert not reader.held


def test_a_run_of_which_nothing_was_taken_ends_with_its_first_end_marker(ends):
    reader, writer = ends
    writer.publish([1.0, 2.0])
    writer.end()
    writer.start(0, PERIOD_S)
    writer.publish([11.0])
    reader.start(0, PERIOD_S)
    assert take_all(reader) == [11.0]


def test_malformed_stragglers_go_with_the_others(ends, transport):
    reader, writer = ends
    writer.publish([1.0])
    take_all(reader)
    transport.publish_bytes('voltage', b'\x00\x01\x00\x00no block')
    writer.end()
    reader.discard_rest()
    reader.start(0, PERIOD_S)
    transport.publish_block('voltage', 0, [11.0])
    assert take_all(reader) == [11.0]
    assert reader.refused == 0


def test_after_a_run_that_ended_well_the_next_begins_at_once(ends):
    reader, writer = ends
    for run in range(3):
        writer.publish([float(run), 0.5])
        writer.end()
        assert take_all(reader) == [run, 0.5]
        reader.discard_rest()
        reader.start(0, PERIOD_S)
        writer.start(0, PERIOD_S)


@given(
    old=st.lists(st.integers(1, 5), min_size=1, max_size=6), taken=st.integers(0, 6),
    new=st.lists(st.integers(1, 5), max_size=6), late=st.integers(0, 12), idle=st.booleans())
def test_a_new_run_is_whole_wherever_the_old_one_was_interrupted(old, taken, new, late, idle):
    transport = FakeTransport()
    reader, writer = transport.reader('voltage'), transport.writer('voltage')
    reader.start(0, PERIOD_S)
    messages = []
    source = transport.subscribe('voltage')
    expected = 100.0 + np.arange(sum(new))
    for samples, sizes in ((np.arange(float(sum(old))), old), (expected, new)):
        writer.start(0, PERIOD_S)
        for size in sizes:
            writer.publish(samples[writer.sent:writer.sent + size])
        writer.end()
    messages, queue = list(source.messages), reader.subscription.messages
    queue.clear()
    taken = min(taken, len(old))
    queue.extend(messages[:taken])
    take_all(reader)
    # Of a run of which nothing was taken, everything is there before the next begins.
    waiting = max(len(messages) - late, taken if taken else len(old) + 1)
    queue.extend(messages[taken:waiting])
    if idle:
        reader.discard_rest()
    reader.start(0, PERIOD_S)
    queue.extend(messages[waiting:])
    samples = []
    while queue or reader.held:
        block = reader.take_array()
        samples.extend([] if block is None else block.tolist())
    assert samples == expected.tolist()
    assert reader.ended
    assert (reader.refused, reader.gaps) == (0, 0)
