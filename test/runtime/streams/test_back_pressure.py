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

"""A reader that does not take: its writer waits, says so, and loses nothing."""

import pytest
from fake_transport import PERIOD_S, take_all
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from piezo_ros.runtime.streams.fault import SendGivenUpError, StreamFault
from piezo_ros.runtime.streams.outlet import Outlet

ATTEMPT_S = 0.1  # after which publishing fails while a reader does not take
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.fixture
def reader(transport):
    reader = transport.reader('voltage')
    reader.start(0, PERIOD_S)
    return reader


@pytest.fixture
def writer(transport, owner, reader, clock, monkeypatch):
    writer = transport.writer('voltage', owner)
    writer.start(0, PERIOD_S)
    attempt = writer.outlet.publish_raw

    def publish_raw(raw):
        waits = bool(writer.publisher.refusals)
        if waits:
            clock.advance(ATTEMPT_S)
        attempt(raw)

    monkeypatch.setattr(writer.outlet, 'publish_raw', publish_raw)
    return writer


def test_nothing_is_lost_however_often_publishing_fails(writer, reader, owner):
    for sample in range(20):
        writer.publisher.refusals = sample % 4
        if sample % 3:
            writer.publish_one(float(sample))
        else:
            writer.publish([float(sample), sample + 0.5])
    writer.publisher.refusals = 3
    writer.end()
    expected = []
    for sample in range(20):
        expected.extend([sample] if sample % 3 else [sample, sample + 0.5])
    assert take_all(reader) == expected
    assert reader.ended
    assert not owner.logger.warnings  # a reader that is merely slow


def test_one_warning_names_topic_sample_and_reader(writer, owner):
    writer.publish_one(0.5)
    writer.publisher.refusals = 20  # 2 s
    writer.publish_one(1.5)
    (warning,) = owner.logger.warnings
    assert warning == (
        '/rig/voltage waits at sample 1 for a reader that does not take its messages: '
        '/rig/reader')


def test_the_warning_is_repeated_every_two_seconds(writer, owner):
    writer.publisher.refusals = 100  # 10 s
    writer.publish_one(1.5)
    assert len(owner.logger.warnings) == 5


def test_the_writer_is_waiting_from_the_warning_until_the_message_went(
        writer, owner, monkeypatch):
    states = []
    monkeypatch.setattr(
        owner.logger, 'warning', lambda _text: states.append(writer.is_waiting))
    assert not writer.is_waiting
    writer.publisher.refusals = 20
    writer.publish_one(1.5)
    assert states == [True]
    assert not writer.is_waiting


def test_a_node_that_shall_stop_gives_up_waiting(writer, reader, owner):
    writer.publisher.refusals = 10**9
    owner.stop_requested = True
    for send in (lambda: writer.publish_one(1.5), lambda: writer.publish([1.5, 2.5]), writer.end):
        with pytest.raises(SendGivenUpError, match='^/rig/voltage was not sent from sample 0 on: '):
            send()
    assert take_all(reader) == []
    assert not writer.is_waiting


def test_a_writer_with_a_limit_makes_a_fault_of_a_longer_wait(writer, reader, owner, clock):
    writer.wait_at_most(5.0)
    writer.publisher.refusals = 40  # 4 s
    writer.publish_one(0.5)
    writer.publisher.refusals = 70
    with pytest.raises(StreamFault, match=(
            '^/rig/voltage has waited at sample 1 for more than 5 s .* messages: /rig/reader$')):
        writer.publish_one(1.5)
    assert not writer.is_waiting
    writer.wait_at_most()
    writer.publisher.refusals = 200
    writer.end()
    assert take_all(reader) == [0.5]
    assert (reader.ended, reader.gaps) == (True, 0)


def test_what_was_given_up_does_not_count_as_sent_and_the_end_comes_in_its_place(
        writer, reader, owner):
    writer.publish([0.5, 1.5])
    writer.publisher.refusals = 2
    owner.stop_requested = True
    with pytest.raises(SendGivenUpError, match='from sample 2 on'):
        writer.publish([2.5, 3.5])
    with pytest.raises(SendGivenUpError, match='from sample 2 on'):
        writer.publish_one(2.5)
    assert (writer.sent, writer.next_index) == (2, 2)
    writer.end()
    assert take_all(reader) == [0.5, 1.5]
    assert (reader.ended, reader.gaps, reader.refused) == (True, 0, 0)


def test_onlookers_are_no_readers(transport, owner):
    writer = transport.writer('voltage', owner)
    assert writer.count_readers() == 0
    transport.subscribe('voltage', BEST_EFFORT)
    assert writer.count_readers() == 0
    transport.subscribe('voltage')
    transport.subscribe('voltage')
    assert writer.count_readers() == 2


def test_a_late_joiner_of_a_volatile_stream_does_not_match(transport, owner):
    outlet = Outlet(owner, 'voltage')
    transport.subscribe('voltage')
    transport.subscribe('voltage', QoSProfile(
        depth=1, reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL))
    outlet.publisher.get_subscription_count = lambda: 1  # which the middleware counts
    assert outlet.count_readers() == 1


def test_onlookers_count_where_the_stream_itself_is_best_effort(transport, owner):
    owner.create_stream_publisher = (
        lambda message_type, topic, qos: type(owner).create_stream_publisher(
            owner, message_type, topic, BEST_EFFORT))
    outlet = Outlet(owner, 'voltage')
    transport.subscribe('voltage', BEST_EFFORT)
    assert outlet.count_readers() == 1
