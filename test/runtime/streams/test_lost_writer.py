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

"""A stream that loses its writer during a run, or has two; the time is that of a fake clock."""

import pytest
from fake_transport import PERIOD_S, FakeTransport

from piezo_ros.runtime.streams.fault import StreamFault

TIMEOUT_S = 0.5


@pytest.fixture
def ends():
    """Return a reader and a writer of which a run has begun."""
    transport = FakeTransport()
    reader, writer = transport.reader('voltage'), transport.writer('voltage')
    reader.start(0, PERIOD_S)
    writer.start(0, PERIOD_S)
    return reader, writer


def test_a_writer_is_there(ends, clock):
    reader, _ = ends
    assert clock.run(10.0, lambda: reader.check_writer(TIMEOUT_S))


def test_a_lost_writer_is_lost_after_the_timeout(ends, clock):
    reader, writer = ends
    assert reader.check_writer(TIMEOUT_S)
    writer.publisher.destroy()
    assert reader.check_writer(TIMEOUT_S)
    assert clock.run(0.4, lambda: reader.check_writer(TIMEOUT_S))
    assert not clock.run(0.2, lambda: reader.check_writer(TIMEOUT_S))


def test_samples_that_still_arrive_begin_the_time_anew(ends, clock):
    reader, writer = ends
    writer.publish_one(1.0)
    writer.publish_one(2.0)
    writer.publisher.destroy()
    assert clock.run(0.4, lambda: reader.check_writer(TIMEOUT_S))
    reader.take_array()
    assert clock.run(0.4, lambda: reader.check_writer(TIMEOUT_S))
    assert not clock.run(0.4, lambda: reader.check_writer(TIMEOUT_S))


def test_a_writer_that_comes_back_is_no_loss(ends, clock):
    reader, writer = ends
    writer.publisher.destroy()
    assert clock.run(0.4, lambda: reader.check_writer(TIMEOUT_S))
    reader.subscription._writers.append(writer.publisher)
    assert clock.run(0.4, lambda: reader.check_writer(TIMEOUT_S))
    writer.publisher.destroy()
    assert clock.run(0.4, lambda: reader.check_writer(TIMEOUT_S))


def test_a_process_that_stood_still_has_lost_no_writer(ends, clock):
    reader, writer = ends
    writer.publisher.destroy()
    assert reader.check_writer(TIMEOUT_S)
    clock.advance(3600.0)
    assert reader.check_writer(TIMEOUT_S)


def test_after_the_end_no_writer_is_needed(ends, clock):
    reader, writer = ends
    writer.end()
    reader.take_array()
    writer.publisher.destroy()
    assert clock.run(10.0, lambda: reader.check_writer(TIMEOUT_S))


def test_a_second_writer_is_a_fault(ends):
    reader, writer = ends
    reader.subscription._writers.append(writer.publisher)
    with pytest.raises(StreamFault, match='/rig/voltage has 2 writers'):
        reader.check_writer(TIMEOUT_S)


def test_a_writer_of_refused_messages_only_may_go(ends, clock):
    reader, writer = ends
    writer.publish_one(float('nan'))
    reader.take_array()
    writer.publisher.destroy()
    assert clock.run(10.0, lambda: reader.check_writer(TIMEOUT_S))
