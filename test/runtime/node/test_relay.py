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

"""The relay answers a single next sample in compiled code and leaves every other message."""

import math

import numpy as np
import pytest
from fake_transport import PERIOD_S, FakeTransport, take_all

from piezo_ros.control.controller_step import ControllerParameters
from piezo_ros.control.pi_controller import PiController
from piezo_ros.model import HysteresisParameters, InverseHysteresis
from piezo_ros.runtime.node.relay import Relay
from piezo_ros.runtime.streams.fault import SendGivenUpError
from piezo_ros.runtime.streams.stream_copy import copy_topic
from piezo_ros.streams import BlockCodec

SAMPLES = np.random.default_rng(3).normal(size=50)
FIRST = 7  # index of the first sample of the run


class Relayed:
    """A relay between two streams; what it leaves is kept in ``left``."""

    def __init__(self, element, question, answer, copy_samples=0):
        self.transport = FakeTransport()
        self.owner = self.transport.owner()
        self.source = self.transport.writer(question)
        self.reader = self.transport.reader(question, self.owner)
        self.writer = self.transport.writer(answer, self.owner, copy_samples=copy_samples)
        self.answers = self.transport.reader(answer)
        for end in (self.source, self.reader, self.writer, self.answers):
            end.start(FIRST, PERIOD_S)
        self.left = []
        self.owner.quick = self.owner.look = lambda times: False
        self.relay = Relay(self.owner, self.reader, self.writer, element, self._leave)
        self.relay.begin(0, np.empty((0, 0)))

    def _leave(self):
        self.left.append(self.reader.raw)
        return True

    def look(self, times=1):
        return self.owner.quick(times)


def inverse(*, compiled=True):
    return InverseHysteresis(HysteresisParameters(), compiled=compiled)


@pytest.fixture
def relayed():
    return Relayed(inverse(), 'command', 'voltage')


def test_single_samples_get_the_bits_of_answer(relayed):
    for sample in SAMPLES:
        relayed.source.publish_one(sample)
        assert relayed.look()
    expected = inverse(compiled=False).answer(FIRST, SAMPLES)
    assert take_all(relayed.answers) == expected.tolist()
    assert not relayed.left
    assert relayed.reader.next_index == relayed.writer.next_index == FIRST + SAMPLES.size


def test_it_shares_the_state_of_the_element():
    element = inverse()
    relayed = Relayed(element, 'command', 'voltage')
    answers = []
    for number, sample in enumerate(SAMPLES):
        if number % 3:
            relayed.source.publish_one(sample)
            assert relayed.look()
            answers.extend(take_all(relayed.answers))
        else:
            answers.extend(element.answer(0, np.array([sample])).tolist())
    assert answers == inverse(compiled=False).answer(0, SAMPLES).tolist()


def test_without_a_message_it_looks_as_often_as_told(relayed, monkeypatch):
    yields = []
    monkeypatch.setattr('os.sched_yield', lambda: yields.append(0))
    other = Relayed(inverse(), 'command', 'voltage')
    assert not other.look(5)
    assert len(yields) == 4
    other.owner.stop_requested = True
    assert not other.look(5)
    assert len(yields) == 4


CODEC = BlockCodec('command')
NEXT = FIRST + 1


@pytest.mark.parametrize('raw', [
    pytest.param(CODEC.encode(NEXT, PERIOD_S, [1.0, 2.0]), id='several samples'),
    pytest.param(CODEC.encode(NEXT, PERIOD_S, []), id='end'),
    pytest.param(CODEC.encode(NEXT + 1, PERIOD_S, [1.0]), id='gap'),
    pytest.param(CODEC.encode(FIRST, PERIOD_S, [1.0]), id='twice'),
    pytest.param(CODEC.encode(NEXT, 2e-5, [1.0]), id='other period'),
    pytest.param(CODEC.encode(NEXT, PERIOD_S, [math.nan]), id='NaN'),
    pytest.param(CODEC.encode(NEXT, PERIOD_S, [-math.inf]), id='infinite'),
    pytest.param(CODEC.encode(math.nan, PERIOD_S, [1.0]), id='no index'),
    pytest.param(BlockCodec('voltage').encode(NEXT, PERIOD_S, [1.0]), id='other stream'),
    pytest.param(b'\x00\x00' + CODEC.encode(NEXT, PERIOD_S, [1.0])[2:], id='big-endian'),
    pytest.param(CODEC.encode(NEXT, PERIOD_S, [1.0])[:-1], id='cut off'),
    pytest.param(b'\x01', id='garbage'),
])
def test_any_other_message_is_left_as_it_is(raw):
    element = inverse()
    relayed = Relayed(element, 'command', 'voltage')
    relayed.source.publish_one(0.5)
    relayed.look()
    take_all(relayed.answers)
    memory, message = element.memory.copy(), bytes(relayed.writer.message)
    relayed.transport.publish_bytes('command', raw)
    assert relayed.look()
    assert relayed.left == [raw]
    assert element.memory.tobytes() == memory.tobytes()
    assert bytes(relayed.writer.message) == message
    assert relayed.reader.next_index == relayed.writer.next_index == NEXT
    assert relayed.answers.take_array() is None


def test_a_copy_is_sent_when_it_is_due():
    relayed = Relayed(inverse(), 'command', 'voltage', copy_samples=8)
    recorded = relayed.transport.reader('voltage', topic=copy_topic('voltage'))
    recorded.start(FIRST, PERIOD_S)
    for sample in SAMPLES:
        relayed.source.publish_one(sample)
        relayed.look()
    sizes = [recorded.take_array().size for _ in range(3)]
    assert sizes == [1, 8, 8]
    relayed.writer.flush()
    take_all(recorded)
    assert recorded.received == SAMPLES.size


def test_targets_beside_the_samples_are_used_in_their_place_and_no_further():
    law = ControllerParameters()
    element, reference = PiController(law, PERIOD_S), PiController(law, PERIOD_S, compiled=False)
    relayed = Relayed(element, 'displacement', 'command')
    targets_um = np.random.default_rng(4).normal(size=(2, 20))
    relayed.relay.begin(FIRST, targets_um, FIRST)
    for sample in SAMPLES[:21]:
        relayed.source.publish_one(sample)
        relayed.look()
    expected_um = reference.answer(0, *targets_um, SAMPLES[:20])
    assert take_all(relayed.answers) == expected_um.tolist()
    assert len(relayed.left) == 1  # the one without targets


def test_an_answer_that_is_given_up_does_not_count_as_sent(relayed):
    for sample in SAMPLES[:3]:
        relayed.source.publish_one(sample)
    relayed.look()
    relayed.writer.publisher.refusals = 1
    relayed.owner.stop_requested = True
    with pytest.raises(SendGivenUpError, match='from sample 8 on'):
        relayed.look()
    assert (relayed.writer.sent, relayed.reader.received) == (1, 2)
    relayed.writer.end()
    assert len(take_all(relayed.answers)) == 1
    assert relayed.answers.ended
