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

"""Where a stream is cut into blocks carries no meaning: any cutting gives the same samples."""

import numpy as np
from fake_transport import PERIOD_S, FakeTransport, take_all
from hypothesis import given
from hypothesis import strategies as st

from piezo_ros.runtime.streams.bursts import answer_waiting

SIZES = st.lists(st.integers(1, 40) | st.just(1), max_size=30)


def samples_of(sizes):
    return np.sin(np.arange(float(sum(sizes)))) * 3.0


def pieces(samples, sizes):
    ends = np.cumsum(sizes, dtype=int)
    return [samples[end - size:end] for end, size in zip(ends, sizes, strict=True)]


def endpoints():
    transport = FakeTransport()
    reader = transport.reader('command')
    writer = transport.writer('command')
    reader.start(5, PERIOD_S)
    writer.start(5, PERIOD_S)
    return transport, reader, writer


class RunningSum:
    """An element with memory: answers depend on all samples before."""

    def __init__(self):
        self._sum = 0.0

    def answer(self, index, samples):
        answers = np.empty(samples.size)
        for place, sample in enumerate(samples.tolist()):
            self._sum = 0.9 * self._sum + sample + index + place
            answers[place] = self._sum
        return answers


@given(SIZES)
def test_a_reader_gets_the_samples_that_were_written(sizes):
    _, reader, writer = endpoints()
    samples = samples_of(sizes)
    for piece in pieces(samples, sizes):
        writer.publish(piece)
    writer.end()
    assert take_all(reader) == samples.tolist()
    assert reader.ended
    assert writer.sent == reader.received == samples.size


@given(SIZES, st.lists(st.sampled_from(['fill', 'fill_many', 'take_from', 'pull', 'drop'])))
def test_the_queue_holds_the_newest_samples_however_they_were_taken(sizes, actions):
    _, reader, writer = endpoints()
    samples = samples_of(sizes)
    for piece in pieces(samples, sizes):
        writer.publish(piece)
    for action in actions:
        {'fill': reader.fill, 'fill_many': lambda: reader.fill_many(3),
         'take_from': lambda: reader.take_from(reader.queue_index + 2),
         'pull': lambda: reader.queue.pull(4),
         'drop': lambda: reader.drop_before(reader.queue_index + 3)}[action]()
        first = reader.queue_index - 5
        assert reader.queue.waiting.tolist() == samples[first:reader.received].tolist()


@given(SIZES, st.integers(0, 50))
def test_answers_are_the_same_however_the_questions_were_cut_and_came(sizes, turns_between):
    transport, reader, writer = endpoints()
    answers = transport.reader('voltage')
    answer_writer = transport.writer('voltage')
    answers.start(5, PERIOD_S)
    answer_writer.start(5, PERIOD_S)
    element, samples = RunningSum(), samples_of(sizes)
    for number, piece in enumerate(pieces(samples, sizes)):
        writer.publish(piece)
        if turns_between and number % turns_between == 0:
            answer_waiting(reader, answer_writer, element.answer)
    while answer_waiting(reader, answer_writer, element.answer):
        pass
    assert take_all(answers) == RunningSum().answer(5, samples).tolist()


@given(SIZES, st.integers(1, 20))
def test_a_copy_has_the_samples_of_its_stream(sizes, copy_samples):
    transport = FakeTransport()
    writer = transport.writer('voltage', copy_samples=copy_samples)
    recorded = transport.reader('voltage', topic='recorded/voltage')
    recorded.start(5, PERIOD_S)
    writer.start(5, PERIOD_S)
    samples = samples_of(sizes)
    for piece in pieces(samples, sizes):
        writer.publish(piece)
    writer.end()
    assert take_all(recorded) == samples.tolist()
    assert recorded.ended
