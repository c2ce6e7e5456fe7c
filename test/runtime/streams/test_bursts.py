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

"""Blocks that have piled up are answered at once, by few messages that fit into a datagram."""

import numpy as np
import pytest
from fake_transport import PERIOD_S, FakeTransport

from piezo_ros.runtime.streams.bursts import (
    BURST_BLOCKS,
    MOST_JOINED,
    answer_taken,
    answer_waiting,
)

DATAGRAM_BYTES = 65_507  # of UDP over IPv4


class Answering:
    """A reader of commands, a writer of voltages, and an element that keeps its questions."""

    def __init__(self):
        transport = FakeTransport()
        self.commands = transport.writer('command')
        self.reader = transport.reader('command')
        self.writer = transport.writer('voltage')
        self.answers = transport.subscribe('voltage')
        for end in (self.commands, self.reader, self.writer):
            end.start(0, PERIOD_S)
        self.asked = []

    def _answer(self, index, samples):
        self.asked.append((index, samples.size))
        return 2.0 * samples

    def answer_waiting(self):
        return answer_waiting(self.reader, self.writer, self._answer)

    def answer_taken(self):
        return answer_taken(self.reader, self.writer, self._answer)

    def sizes(self):
        return [len(samples) for _, samples in self.answers.blocks('voltage')]


@pytest.fixture
def answering():
    return Answering()


def test_nothing_waits(answering):
    assert answering.answer_waiting() == 0
    assert answering.answer_taken() == 0
    assert answering.asked == []
    assert answering.sizes() == []


def test_single_samples_are_answered_one_by_one(answering):
    answering.commands.publish_one(1.0)
    assert answering.answer_waiting() == 1  # the first: with all that waits
    answering.commands.publish_one(2.0)
    answering.commands.publish_one(3.0)
    assert answering.answer_waiting() == 1
    assert answering.answer_waiting() == 1
    assert answering.asked == [(0, 1), (1, 1), (2, 1)]
    assert answering.answers.blocks('voltage') == [(0, [2.0]), (1, [4.0]), (2, [6.0])]


def test_blocks_that_wait_are_one_question_and_one_answer(answering):
    for size in (3, 1, 5):
        answering.commands.publish(np.ones(size))
    assert answering.answer_waiting() == 5  # the longest
    assert answering.asked == [(0, 9)]
    assert answering.sizes() == [9]


def test_no_more_than_a_burst_is_taken_at_once(answering):
    for _ in range(BURST_BLOCKS + 2):
        answering.commands.publish([1.0, 2.0])
    answering.answer_waiting()
    assert answering.asked == [(0, 2 * BURST_BLOCKS)]
    answering.answer_waiting()
    assert answering.asked[1:] == [(2 * BURST_BLOCKS, 4)]


def test_a_burst_stops_at_the_end_marker(answering):
    answering.commands.publish([1.0, 2.0])
    answering.commands.end()
    answering.commands.publish([3.0, 4.0])
    answering.answer_waiting()
    assert answering.reader.ended
    assert answering.asked == [(0, 2)]
    assert answering.reader.refused == 0


def test_refused_blocks_within_a_burst_are_left_out(answering):
    answering.commands.publish([1.0, 2.0])
    answering.commands.publish([np.nan, 2.0])
    answering.commands.next_index = 2
    answering.commands.publish([3.0])
    answering.answer_waiting()
    assert answering.asked == [(0, 3)]
    assert answering.reader.refused == 1


def test_a_message_that_was_taken_before_comes_first(answering):
    answering.commands.publish([1.0, 2.0])
    answering.commands.publish([3.0])
    assert answering.reader.take_raw()
    assert answering.answer_taken() == 2
    assert answering.asked == [(0, 3)]


@pytest.mark.parametrize(('sizes', 'expected'), [
    ([4], [4]),
    ([4000, 3500], [7500]),
    ([4000, 3501], [4000, 3501]),
    ([4000, 3000, 3000], [7000, 3000]),
    ([7500, 1], [7500, 1]),
    ([1, 20_000, 1], [1, 20_000, 1]),  # a longer block stays one, as its question was
    ([20_000, 1], [20_000, 1]),
    ([500] * 16, [7500, 500]),
])
def test_answers_are_joined_up_to_a_datagram(answering, sizes, expected):
    for size in sizes:
        answering.commands.publish(np.arange(float(size)))
    answering.answer_waiting()
    assert answering.sizes() == expected
    assert [size for _, size in answering.asked] == expected


def test_a_message_is_sent_before_the_next_is_computed(answering):
    seen = []
    for _ in range(3):
        answering.commands.publish(np.zeros(5000))
    answer_waiting(
        answering.reader, answering.writer,
        lambda index, samples: seen.append((index, len(answering.answers.messages))) or samples)
    assert seen == [(0, 0), (5000, 1), (10_000, 2)]


def test_a_run_that_begins_in_mid_stream_is_asked_for_its_own_indices(answering):
    answering.reader.start(-1, PERIOD_S)
    answering.commands.start(40, PERIOD_S)
    answering.commands.publish([1.0, 2.0])
    answering.commands.publish([3.0, 4.0])
    answering.answer_waiting()
    assert answering.asked == [(40, 4)]


def test_the_longest_joined_block_fits_into_a_datagram(answering):
    answering.writer.publish(np.zeros(MOST_JOINED))
    (raw,) = answering.answers.messages
    assert len(raw) < DATAGRAM_BYTES - 1000
