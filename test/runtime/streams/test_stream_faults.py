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

"""What a reader refuses, what ends the run, and that all samples before a fault are used."""

import math

import numpy as np
import pytest
from fake_transport import PERIOD_S, take_all

from piezo_ros.runtime.streams.bursts import answer_waiting
from piezo_ros.runtime.streams.fault import StreamFault
from piezo_ros.streams import BlockCodec


@pytest.fixture
def reader(transport, owner):
    reader = transport.reader('voltage', owner)
    reader.start(0, PERIOD_S)
    return reader


@pytest.fixture
def send(transport):
    return lambda index, samples, **other: transport.publish_block(
        'voltage', index, samples, **other)


@pytest.mark.parametrize('samples', [[3.0], [3.0, 4.0]])
@pytest.mark.parametrize('before', [[], [1.0], [1.0, 1.5]])
def test_a_gap_is_a_fault_that_names_the_missing_samples(reader, send, before, samples):
    if before:
        send(0, before)
        assert take_all(reader) == before
    missing = len(before)
    send(missing + 5, samples)
    with pytest.raises(StreamFault, match=f'/rig/voltage lacks the samples {missing} … '
                                          f'{missing + 4}'):
        reader.take_array()
    assert reader.gaps == 1


@pytest.mark.parametrize('before', [[], [1.0], [1.0, 1.5]])
def test_another_sample_period_is_a_fault(reader, send, before):
    if before:
        send(0, before)
        take_all(reader)
    send(len(before), [2.0], period_s=2e-5)
    with pytest.raises(StreamFault, match='has the sample period 2e-05 s, expected 1e-05 s'):
        reader.take_array()


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize('place', [0, 1])
def test_a_sample_that_is_no_number_is_refused(reader, send, owner, bad, place):
    send(0, [1.0])
    send(1, [2.0])
    assert take_all(reader) == [1.0, 2.0]
    samples = [3.0, 4.0]
    samples[place] = bad
    send(2, samples)
    send(2, [bad])
    assert reader.take_array() is None
    assert reader.take_one() is None
    assert reader.take_rest() is None
    assert reader.refused == 2
    assert 'must be finite' in owner.logger.warnings[0]
    send(2, [3.0, 4.0])
    assert take_all(reader) == [3.0, 4.0]


@pytest.mark.filterwarnings('ignore:overflow')
def test_finite_samples_whose_squares_overflow_are_taken(reader, send):
    send(0, [1e200, 1e200])
    send(2, [1e200, -1e200])
    assert take_all(reader) == [1e200, 1e200, 1e200, -1e200]
    assert reader.refused == 0


def test_a_block_of_another_stream_is_refused(reader, transport, owner):
    raw = BlockCodec('displacement').encode(0, PERIOD_S, [1.0])
    transport.publish_bytes('voltage', raw)
    assert reader.take_array() is None
    assert reader.refused == 1
    assert "label is 'displacement_um'" in owner.logger.warnings[0]


@pytest.mark.parametrize('raw', [
    b'\x00', b'neither CDR nor XCDR2', b'\x00\x07\x00\x00' + b'\xff' * 40,
    b'\x00\x01\x00\x00', b'\x00\x01\x00\x00' + b'\xff' * 40,
    BlockCodec('voltage').encode(0, PERIOD_S, [1.0, 2.0])[:-8],
    BlockCodec('voltage').encode(0, 0.0, [1.0]), BlockCodec('voltage').encode(0, -1.0, [1.0]),
    BlockCodec('voltage').encode(0.5, PERIOD_S, [1.0]),
    BlockCodec('voltage').encode(-1, PERIOD_S, [1.0]),
    BlockCodec('voltage').encode(2**53, PERIOD_S, [1.0])])
def test_a10_malformed_bytes_are_refused_and_the_stream_goes_on(reader, transport, send, raw):
    transport.publish_bytes('voltage', raw)
    send(0, [1.0])
    assert reader.take_array() is None
    assert reader.refused == 1
    assert reader.raw == raw
    assert take_all(reader) == [1.0]


@pytest.mark.parametrize('take', ['take_array', 'fill'])
def test_a10_a_message_of_no_bytes_is_refused_and_the_stream_goes_on(
        reader, transport, send, owner, take):
    transport.publish_bytes('voltage', b'')
    send(0, [1.0])
    assert not getattr(reader, take)()
    assert reader.refused == 1
    assert 'refused a block' in owner.logger.warnings[0]
    assert take_all(reader) == [1.0]


@pytest.mark.parametrize('samples', [[9.0], [9.0, 9.0], []])
def test_what_comes_after_the_end_is_refused(reader, send, owner, samples):
    send(0, [1.0])
    send(1, [])
    assert take_all(reader) == [1.0]
    send(1, samples)
    assert reader.take_array() is None
    assert reader.refused == 1
    assert 'sample 1 comes after the end' in owner.logger.warnings[0]


def test_a_sample_that_comes_twice_is_refused(reader, send, owner):
    send(0, [1.0, 2.0, 3.0])
    take_all(reader)
    send(1, [2.0, 3.0, 4.0])
    assert reader.take_array() is None
    assert 'sample 1 comes after sample 2' in owner.logger.warnings[0]
    assert reader.next_index == 3


def test_refusals_warn_at_most_every_two_seconds_and_count_on(reader, send, owner, clock):
    send(0, [1.0])
    take_all(reader)
    for _ in range(50):
        send(0, [1.0])
        assert reader.take_array() is None
        clock.advance(0.1)
    assert reader.refused == 50
    assert len(owner.logger.warnings) == 3
    assert '(22 so far)' in owner.logger.warnings[1]


def test_the_queue_is_used_before_a_fault_is_raised(reader, send):
    send(0, [1.0, 2.0])
    send(2, [3.0])
    send(7, [8.0])
    assert reader.fill_many(16)
    assert reader.queue.waiting.tolist() == [1.0, 2.0, 3.0]
    assert not reader.fill_many(16)  # nothing new, and the fault waits for its turn
    reader.queue.pull(3)
    with pytest.raises(StreamFault, match=r'lacks the samples 3 … 6'):
        reader.fill_many(16)


def test_a_fault_with_nothing_in_the_queue_is_raised_at_once(reader, send):
    send(7, [8.0])
    with pytest.raises(StreamFault, match=r'lacks the samples 0 … 6'):
        reader.fill_many(16)


def test_a_new_run_forgets_the_fault_and_the_queue_of_the_last(reader, send):
    send(0, [1.0])
    send(7, [8.0])
    reader.fill_many(16)
    reader.start(0, PERIOD_S)
    send(0, [2.0])
    assert reader.fill_many(16)
    assert reader.queue.waiting.tolist() == [2.0]
    assert (reader.gaps, reader.refused) == (0, 0)


def test_samples_before_a_fault_are_answered(transport, reader, send):
    answers = transport.subscribe('displacement')
    writer = transport.writer('displacement')
    writer.start(0, PERIOD_S)
    send(0, [1.0, 2.0])
    send(2, [3.0])
    send(9, [4.0])
    with pytest.raises(StreamFault):
        answer_waiting(reader, writer, lambda index, samples: samples + np.float64(10.0))
    assert answers.blocks('displacement') == [(0, [11.0, 12.0, 13.0])]
