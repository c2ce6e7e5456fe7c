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

"""A reader takes the blocks of its stream in order, whenever they come."""

import numpy as np
import pytest
from fake_transport import PERIOD_S, take_all
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray, MultiArrayDimension


@pytest.fixture
def reader(transport):
    reader = transport.reader('voltage')
    reader.start(0, PERIOD_S)
    return reader


@pytest.fixture
def writer(transport, reader):
    writer = transport.writer('voltage')
    writer.start(0, PERIOD_S)
    return writer


def test_no_message_is_no_sample_by_any_way_of_taking(reader):
    assert reader.take_one() is None
    assert reader.take_array() is None
    assert reader.take_rest() is None
    assert not reader.take_raw()
    assert not reader.fill()
    assert not reader.fill_many(16)
    assert not reader.take_from(0)
    assert (reader.received, reader.refused, reader.ended, reader.raw) == (0, 0, False, b'')


def test_a_late_message_is_taken_when_it_comes(reader, writer):
    assert reader.take_array() is None
    writer.publish_one(1.5)
    assert take_all(reader) == [1.5]
    assert reader.take_array() is None
    writer.publish([2.5, 3.5])
    assert take_all(reader) == [2.5, 3.5]
    assert reader.next_index == reader.received == 3


def test_single_samples_take_the_quick_way_from_the_second_on(reader, writer):
    for sample in (1.0, 2.0, 3.0):
        writer.publish_one(sample)
    assert reader.take_one() is None  # what comes first is looked at closely
    assert reader.take_rest().tolist() == [1.0]
    assert [reader.take_one(), reader.take_one(), reader.take_one()] == [2.0, 3.0, None]


def test_a_writer_tells_its_newest_sample(writer):
    assert writer.newest == 0.0
    writer.publish_one(1.5)
    assert writer.newest == 1.5
    writer.publish([2.5, 3.5])
    assert writer.newest == 3.5


def test_the_end_marker_ends_a_stream_once(reader, writer):
    writer.publish([1.0, 2.0])
    writer.end()
    writer.end()
    assert len(reader.subscription.messages) == 2
    assert reader.take_array().tolist() == [1.0, 2.0]
    assert not reader.ended
    assert reader.take_array().size == 0
    assert reader.ended
    assert reader.take_array() is None
    assert reader.received == 2


def test_samples_wait_in_the_queue_with_their_index(reader, writer):
    writer.publish([1.0, 2.0, 3.0])
    writer.publish_one(4.0)
    assert reader.fill()
    assert (reader.queue_index, len(reader.queue)) == (0, 3)
    assert reader.fill_many(16)
    reader.drop_before(2)
    assert (reader.queue_index, reader.queue.waiting.tolist()) == (2, [3.0, 4.0])
    reader.drop_before(1)  # nothing is left of that
    assert reader.queue_index == 2


def test_fill_many_takes_no_more_blocks_than_it_is_told(reader, writer):
    for sample in range(5):
        writer.publish_one(float(sample))
    reader.fill_many(3)
    assert reader.queue.waiting.tolist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize(('index', 'kept'), [
    (0, [1.0, 2.0, 3.0, 4.0]), (1, [2.0, 3.0, 4.0]), (3, [4.0]), (4, []), (9, [])])
def test_take_from_keeps_the_samples_from_an_index_on(reader, writer, index, kept):
    writer.publish([1.0, 2.0])
    writer.publish([3.0, 4.0])
    while reader.take_from(index):
        pass
    assert reader.queue.waiting.tolist() == kept
    assert reader.next_index == 4


def test_a_reader_of_any_start_tells_the_node_where_the_stream_begins(transport):
    owner = transport.owner()
    reader = transport.reader('voltage', owner)
    reader.start(-1, PERIOD_S)
    transport.publish_block('voltage', 700, [1.0, 2.0])
    assert take_all(reader) == [1.0, 2.0]
    assert owner.begun_at == [700]
    assert (reader.received, reader.next_index) == (2, 702)


def test_a_reader_without_sample_period_takes_that_of_the_first_block(transport):
    reader = transport.reader('voltage')
    reader.start(0, None)
    transport.publish_block('voltage', 0, [1.0], period_s=0.25)
    transport.publish_block('voltage', 1, [2.0], period_s=0.25)
    assert take_all(reader) == [1.0, 2.0]


def test_typed_messages_of_rclpy_are_taken_as_the_blocks_of_the_codec(transport, reader):
    for index, samples in ((0, [1.0]), (1, [2.0]), (2, [3.0, 4.0]), (4, [5.0, 6.0]), (6, [])):
        message = Float64MultiArray()
        message.layout.dim = [MultiArrayDimension(
            label='voltage_v', size=len(samples), stride=len(samples))]
        message.layout.data_offset = 2
        message.data = [float(index), PERIOD_S, *samples]
        transport.publish_bytes('voltage', serialize_message(message))
    assert take_all(reader) == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert reader.ended


def test_blocks_of_very_many_lengths_are_all_taken(reader, writer):
    sizes = [*range(1, 40), *range(39, 0, -1), 12_000, 2]
    samples = np.arange(float(sum(sizes)))
    first = 0
    for size in sizes:
        writer.publish(samples[first:first + size])
        first += size
    assert take_all(reader) == samples.tolist()
