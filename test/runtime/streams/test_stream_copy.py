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

"""The copy of a stream for a recorder: single samples in long blocks, long blocks as they are."""

import pytest
from fake_transport import PERIOD_S, FakeTransport

from piezo_ros.runtime.streams.fault import SendGivenUpError
from piezo_ros.runtime.streams.stream_copy import copy_topic

LONGEST = 4


class Copied:
    """A writer with a copy, and what both have published."""

    def __init__(self, first=0):
        transport = FakeTransport()
        self.owner = transport.owner('writer')
        self.writer = transport.writer('voltage', self.owner, copy_samples=LONGEST)
        self.stream = transport.subscribe('voltage')
        self.recorded = transport.subscribe(copy_topic('voltage'))
        self.writer.start(first, PERIOD_S)

    def send(self, first, stop):
        for sample in range(first, stop):
            self.writer.publish_one(float(sample))

    def blocks(self):
        """Return index and number of samples of what came on the copy since the last time."""
        blocks = self.recorded.blocks('voltage')
        for index, samples in blocks:
            assert samples == [float(index + k) for k in range(len(samples))]
        return [(index, len(samples)) for index, samples in blocks]


@pytest.fixture
def copied():
    return Copied()


def test_the_topic_of_a_copy():
    assert copy_topic('voltage') == 'recorded/voltage'


def test_single_samples_are_sent_when_a_block_is_due(copied):
    copied.send(0, 3)
    assert copied.blocks() == []
    copied.send(3, 4)
    assert copied.blocks() == [(0, 4)]
    copied.send(4, 13)
    assert copied.blocks() == [(4, 4), (8, 4)]
    assert len(copied.stream.messages) == 13


def test_a_flush_sends_what_was_collected_and_nothing_twice(copied):
    copied.writer.flush()
    assert copied.blocks() == []
    copied.send(0, 3)
    copied.writer.flush()
    assert copied.blocks() == [(0, 3)]
    copied.writer.flush()
    assert copied.blocks() == []
    copied.send(3, 8)  # due at multiples of the block length
    assert copied.blocks() == [(3, 1), (4, 4)]


def test_a_block_is_passed_on_after_what_was_collected(copied):
    copied.send(0, 2)
    copied.writer.publish([2.0, 3.0, 4.0, 5.0, 6.0, 7.0])
    assert copied.blocks() == [(0, 2), (2, 6)]
    copied.send(8, 12)
    assert copied.blocks() == [(8, 4)]


def test_a_block_that_is_passed_on_is_the_same_bytes(copied):
    copied.writer.publish([0.0, 1.0, 2.0])
    assert copied.stream.messages == copied.recorded.messages


def test_the_end_comes_after_what_was_collected(copied):
    copied.send(0, 3)
    copied.writer.end()
    assert copied.blocks() == [(0, 3), (3, 0)]


def test_a_run_may_begin_anywhere_and_another_elsewhere():
    copied = Copied(first=6)
    copied.send(6, 9)
    assert copied.blocks() == [(6, 2)]
    copied.writer.end()
    assert copied.blocks() == [(8, 1), (9, 0)]
    copied.writer.start(0, PERIOD_S)
    copied.send(0, 4)
    assert copied.blocks() == [(0, 4)]


def test_a_run_that_learns_where_it_begins_has_a_copy_from_there(copied):
    copied.writer.begin_at(42)
    copied.send(42, 44)
    copied.writer.begin_at(7)  # too late
    assert copied.writer.next_index == 44
    assert copied.blocks() == [(42, 2)]


def test_readers_of_the_copy_count_as_readers(copied):
    assert copied.writer.count_readers() == 2
    assert len(copied.writer.publishers) == 2


def give_up(copied, action):
    """Let the reader of the copy not take while an action sends, and the node stop."""
    copied.owner.stop_requested = True
    copied.writer.copy.outlet.publisher.refusals = 1
    with pytest.raises(SendGivenUpError, match='^/rig/recorded/voltage was not sent'):
        action()


def test_single_samples_that_were_given_up_are_sent_with_the_end(copied):
    give_up(copied, lambda: copied.send(0, 4))
    assert copied.writer.sent == 4  # on the stream itself
    copied.writer.end()
    assert copied.blocks() == [(0, 4), (4, 0)]


@pytest.mark.parametrize('before', [0, 2])
def test_a_block_that_was_given_up_is_the_end_of_the_copy(copied, before):
    copied.send(0, before)
    block = [float(before + k) for k in range(6)]
    give_up(copied, lambda: copied.writer.publish(block))
    assert copied.writer.sent == before + 6
    copied.writer.flush()
    copied.writer.end()
    assert copied.blocks() == [(0, 0)]
    assert len(copied.stream.messages) == before + 2


def test_the_copy_ends_also_where_the_end_of_its_stream_is_given_up(copied):
    copied.send(0, 3)
    copied.owner.stop_requested = True
    copied.writer.publisher.refusals = 1
    with pytest.raises(SendGivenUpError, match='^/rig/voltage was not sent from sample 3 on'):
        copied.writer.end()
    assert copied.blocks() == [(0, 3), (3, 0)]
    copied.writer.end()
    assert copied.blocks() == []


def test_a_new_run_has_a_copy_again(copied):
    give_up(copied, lambda: copied.writer.publish([0.0, 1.0]))
    copied.writer.start(0, PERIOD_S)
    copied.send(0, 4)
    assert copied.blocks() == [(0, 4)]
