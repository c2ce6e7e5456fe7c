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

"""The demand: it leads what is consumed, grows only, and ends with zero."""

import pytest
from fake_node import activate, configure, fake_node, look_after, poll_all
from fake_transport import PERIOD_S, take_all
from std_msgs.msg import UInt64

from piezo_ros.model import ParameterError
from piezo_ros.nodes.demand import DemandReader, DemandWriter
from piezo_ros.nodes.joint_demand import JointDemand
from piezo_ros.nodes.trajectory import Trajectory
from piezo_ros.parameters.node_parameters import BlockParameters
from piezo_ros.runtime.streams.fault import StreamFault
from piezo_ros.runtime.streams.qos import EVERY_STATUS, LATCHED


@pytest.fixture
def writer(transport):
    return DemandWriter(transport.owner('controller'))


@pytest.fixture
def reader(transport):
    return DemandReader(transport.owner('trajectory'))


@pytest.fixture
def demanded(transport, writer):
    """Return the demands that were published since the last call."""
    subscription = transport.subscribe('demand', EVERY_STATUS)  # keeps them all

    def take():
        limits = [message.data for message in subscription.messages]
        subscription.messages.clear()
        return limits

    return take


def test_it_leads_the_consumed_samples_and_is_renewed_each_half(writer, demanded):
    writer.start(0, 10)
    assert demanded() == [10]
    for consumed in range(5):
        writer.update(consumed)
    assert demanded() == []
    writer.update(5)
    assert demanded() == [15]
    writer.update(13)  # a block
    assert demanded() == [23]
    writer.update(17)
    assert demanded() == []
    writer.update(18)
    assert demanded() == [28]


def test_a_lead_of_one_sample_is_renewed_with_each(writer, demanded):
    writer.start(0, 1)
    for consumed in range(1, 4):
        writer.update(consumed)
    assert demanded() == [1, 2, 3, 4]


def test_it_begins_where_the_run_does(writer, demanded):
    writer.start(500, 10)
    writer.update(505)
    assert demanded() == [510, 515]


@pytest.mark.parametrize('lookahead', [1, 2, 3, 10, 1000])
def test_the_lead_is_never_less_than_half(writer, demanded, lookahead):
    writer.start(0, lookahead)
    (limit,) = demanded()
    for consumed in range(1, 3 * lookahead):
        writer.update(consumed)
        limit = max([limit, *demanded()])
        assert consumed + lookahead // 2 <= limit <= consumed + lookahead


def test_the_reader_takes_the_newest_demand(writer, reader):
    assert not reader.take()
    writer.start(0, 10)
    assert reader.take()
    assert (reader.limit, reader.ended) == (10, False)
    assert not reader.take()


def test_the_demand_never_shrinks_during_a_run(writer, reader):
    writer.start(100, 10)
    reader.take()
    writer.start(0, 10)
    assert reader.take()
    assert reader.limit == 110


def test_zero_ends_it_and_the_limit_stays(writer, reader):
    writer.start(0, 10)
    reader.take()
    writer.end()
    assert reader.take()
    assert reader.ended
    assert reader.limit == 10


def test_zero_before_anything_was_demanded_is_of_an_earlier_run(writer, reader):
    writer.end()
    assert reader.take()
    assert not reader.ended
    writer.start(0, 10)
    reader.take()
    assert (reader.limit, reader.ended) == (10, False)


def test_a_new_run_begins_without_demand(writer, reader):
    writer.start(0, 10)
    reader.take()
    writer.end()
    reader.take()
    reader.start()
    assert (reader.limit, reader.ended) == (0, False)


def test_a_demand_beyond_32_bits_is_taken(transport, reader):
    publisher = transport.owner().create_own_publisher(UInt64, 'demand', LATCHED)
    publisher.publish(UInt64(data=2**40))
    reader.take()
    assert reader.limit == 2**40


def test_a_writer_that_stays_away_is_a_fault_after_the_timeout(transport, reader, clock):
    publisher = transport.owner().create_own_publisher(UInt64, 'demand', LATCHED)
    assert (reader.writers, reader.topic_name) == (1, '/rig/demand')
    clock.run(10.0, lambda: reader.check_writer(0.5))
    publisher.destroy()
    clock.run(0.5, lambda: reader.check_writer(0.5))
    with pytest.raises(StreamFault, match='/rig/demand lost its writer'):
        clock.run(0.3, lambda: reader.check_writer(0.5))


@pytest.fixture
def joint(transport):
    """Return the joint demand of two rigs, and what each of them writes."""
    other = DemandWriter(transport.owner('controller_of_y'))
    other._publisher.destroy()
    other._publisher = transport.owner('controller_of_y').create_own_publisher(
        UInt64, '/rig/y/demand', LATCHED)
    own = DemandWriter(transport.owner('controller'))
    return JointDemand(transport.owner('trajectory'), ['/rig/y']), own, other


def test_a_rig_in_step_sends_what_both_demand(joint):
    reader, own, other = joint
    own.start(0, 100)
    assert reader.take()
    assert reader.limit == 0
    other.start(0, 10)
    assert reader.take()
    assert reader.limit == 10
    other.update(300)
    assert reader.take()
    assert reader.limit == 100
    assert not reader.take()


def test_a_rig_that_has_ended_holds_up_no_other(joint):
    reader, own, other = joint
    own.start(0, 100)
    other.start(0, 10)
    reader.take()
    other.end()
    assert reader.take()
    assert (reader.limit, reader.ended) == (100, False)
    # Also where its run was so short that nothing but its end is seen.
    reader.start()
    own.start(0, 50)
    other.end()
    reader.take()
    assert reader.limit == 50
    own.end()
    reader.take()
    assert reader.ended


def test_a_rig_in_step_must_be_there(joint, transport):
    reader, _, other = joint
    assert reader.wrong_writers() == ''
    other._publisher.destroy()
    assert '/rig/y/demand' in reader.wrong_writers()


@pytest.mark.parametrize(('given', 'namespaces'), [
    ('/y, /lab/z', ('/y', '/lab/z')), ('../slow', ('/piezo/slow',)),
    ('../slow,/y', ('/piezo/slow', '/y')), ('../more/slow', ('/piezo/more/slow',)), ('', ())])
def test_rigs_in_step_are_named_in_full_or_beside_the_own_one(given, namespaces):
    assert BlockParameters(lockstep_with=given).namespaces_in_step('/piezo/fast') == namespaces


def test_beside_a_rig_of_one_name_is_the_root():
    assert BlockParameters(lockstep_with='../y').namespaces_in_step('/x') == ('/y',)


@pytest.mark.parametrize('given', ['y', '..', '../', './y', '../../y', '/', '/x/..'])
def test_what_is_no_namespace_is_refused(given):
    with pytest.raises(ParameterError, match='lockstep_with has .* such as /x, or one beside'):
        BlockParameters(lockstep_with=given)


class Waiting:
    """A trajectory that has begun a run, and the writer of its demand."""

    def __init__(self, transport):
        self.demand = DemandWriter(transport.owner('controller'))
        self.reference = transport.reader('reference')
        self.reference.start(0, PERIOD_S)
        self.node = fake_node(
            Trajectory, transport, waveform='sine', samples=100, required_readers=0)

    def begin(self):
        configure(self.node)
        activate(self.node)

    def wait(self, clock, duration_s):
        clock.run(duration_s, lambda: (poll_all(self.node), look_after(self.node, clock.now_s)))
        return self.node.logger.warnings


@pytest.fixture
def waiting(transport):
    return Waiting(transport)


@pytest.mark.parametrize(('is_zero', 'said'), [
    (True, 'has said 0 alone, which demands no sample'), (False, 'has said nothing')])
def test_a_trajectory_tells_that_no_sample_is_demanded_and_stops_at_once(
        waiting, clock, is_zero, said):
    if is_zero:
        waiting.demand.end()
    waiting.begin()
    assert waiting.wait(clock, 2.0) == []
    assert waiting.wait(clock, 60.0) == [
        f'waiting: /rig/demand {said}; it is written by /rig/controller']
    assert waiting.node.requests.stop() == 'stopped: asked to by ~/stop'
    assert waiting.reference.take_array().size == 0


def test_a_demand_that_comes_late_is_met_without_a_word(waiting, clock):
    waiting.demand.end()
    waiting.begin()
    waiting.wait(clock, 2.0)
    waiting.demand.start(0, 10)
    assert waiting.wait(clock, 60.0) == []
    assert len(take_all(waiting.reference)) == 10


def test_the_rig_in_step_that_demands_nothing_is_named(joint, clock):
    reader, own, other = joint
    reader.start()
    own.start(0, 100)
    reader.take()
    clock.run(10.0, reader.warn_of_none)
    assert reader._node.logger.warnings == [
        'waiting: /rig/y/demand has said nothing; it is written by /rig/controller_of_y']
    reader.start()
    own.start(0, 100)
    other.end()
    reader.take()
    clock.run(10.0, reader.warn_of_none)
    assert len(reader._node.logger.warnings) == 1
