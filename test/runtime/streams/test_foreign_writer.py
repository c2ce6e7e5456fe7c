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

"""A second writer on a topic of the loop: the message names topic, writers and what is needed."""

from types import SimpleNamespace

import pytest
from fake_node import activate, configure, fake_node
from std_msgs.msg import UInt64

from piezo_ros.nodes.demand import DemandReader, DemandWriter
from piezo_ros.nodes.trajectory import Trajectory
from piezo_ros.runtime.streams.fault import StreamFault
from piezo_ros.runtime.streams.qos import LATCHED
from piezo_ros.streams import STREAMS

WRITERS = 'has 2 writers (/rig/writer, /rig/stranger), exactly one is needed'


@pytest.fixture(params=sorted(STREAMS))
def ends(request, transport):
    """Return the reader of a stream that has taken a sample, and a second writer."""
    stream = request.param
    writer = transport.writer(stream)
    reader = transport.reader(stream)
    for each in (writer, reader):
        each.start(0, 1e-5)
    writer.publish_one(1.0)
    reader.take_array()
    stranger = transport.writer(stream, transport.owner('stranger'))
    return SimpleNamespace(
        reader=reader, stranger=stranger, topic=f'/rig/{stream}', transport=transport,
        stream=stream)


def test_it_ends_the_run(ends):
    with pytest.raises(StreamFault) as fault:
        ends.reader.check_writer(1.0)
    assert str(fault.value) == f'{ends.topic} {WRITERS}'


@pytest.mark.parametrize(('index', 'period_s', 'text'), [
    (5, 1e-5, 'lacks the samples 1 … 4'), (1, 2e-5, 'has the sample period 2e-05 s')])
def test_what_it_breaks_names_it(ends, index, period_s, text):
    ends.transport.publish_block(ends.stream, index, [1.0], period_s)
    with pytest.raises(StreamFault) as fault:
        ends.reader.take_array()
    assert str(fault.value).startswith(f'{ends.topic} {text}')
    assert str(fault.value).endswith(f'; {ends.topic} {WRITERS}')


def test_what_is_refused_names_it(ends):
    ends.transport.publish_block(ends.stream, 0, [1.0])
    assert ends.reader.take_array() is None
    (line,) = ends.reader._node.logger.warnings
    assert line.endswith(f'sample 0 comes after sample 0; {ends.topic} {WRITERS}')


def publish_demand(transport, value):
    """Publish a demand as `ros2 topic pub` does; the publisher stays."""
    publisher = transport.owner('stranger').create_own_publisher(UInt64, 'demand', LATCHED)
    publisher.publish(UInt64(data=value))
    return publisher


@pytest.fixture
def trajectory(transport):
    """Return a trajectory in a run, a controller demanding a few samples at a time."""
    trajectory = fake_node(Trajectory, transport, periods=3.0, required_readers=0)
    demand = DemandWriter(transport.owner('controller'))
    configure(trajectory)
    activate(trajectory)
    demand.start(0, 10)
    trajectory.poll()
    return trajectory


BESIDE = '/rig/demand has 2 writers (/rig/controller, /rig/stranger), exactly one is needed'


def test_a_foreign_end_of_the_demand_is_a_fault_that_names_the_writers(transport, trajectory):
    publish_demand(transport, 0)
    with pytest.raises(StreamFault) as fault:
        trajectory.poll()
    assert str(fault.value) == f'/rig/demand is 0: no more samples are demanded; {BESIDE}'


@pytest.mark.parametrize('value', [1, 2**63])
def test_a12_a_foreign_demand_is_a_fault_that_names_the_writers(transport, trajectory, value):
    publish_demand(transport, value)
    with pytest.raises(StreamFault) as fault:
        trajectory.watch(0.0)
    assert str(fault.value) == BESIDE


def test_the_end_of_the_demand_names_what_has_ended_it(transport):
    writer = DemandWriter(transport.owner('controller'))
    reader = DemandReader(transport.owner('trajectory'))
    writer.start(0, 10)
    writer.end()
    reader.take()
    assert reader.why_ended() == (
        '/rig/demand is 0: no more samples are demanded by /rig/controller')


def test_a_source_that_sends_too_much_is_told_with_what_writes(transport):
    demand = DemandWriter(transport.owner('controller'))
    publish_demand(transport, 2**63)
    reader = transport.reader('reference')
    reader.start(0, 1e-5)
    transport.writer('reference', transport.owner('trajectory'))
    transport.publish_block('reference', 0, [1.0] * 20)
    reader.fill()
    with pytest.raises(StreamFault) as fault:
        demand.check_kept([reader], 10)
    text = str(fault.value)
    assert text.startswith('20 samples of /rig/reference wait, allowed are 10 (max_buffer_samples)')
    assert '/rig/demand is written by /rig/controller, /rig/stranger' in text
    assert '/rig/reference is written by /rig/trajectory' in text
