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

"""The handshake: which peers a node waits for, how long, and what it says."""

import pytest
from fake_node import fake_hooks
from std_msgs.msg import Float64MultiArray

from piezo_ros.runtime.node.handshake import await_peers
from piezo_ros.runtime.node.hooks import NodeHooks
from piezo_ros.runtime.streams.qos import STREAM

TIMEOUT_S = 10.0


class Answering(NodeHooks):
    inputs = ('command',)
    outputs = ('voltage',)


class Late(Answering):
    subscribes_late = True
    outputs = ()

    def create_readers(self):
        """Subscribe, not before the handshake."""
        if self.is_activating:
            super().create_readers()


class Choosy(Answering):
    inputs = ('command', 'feedforward')
    missing = ''

    def required_inputs(self):
        return ('command',)

    def missing_peers(self):
        return self.missing


@pytest.fixture
def make(transport):
    """Return a node that has been configured."""
    def create(node_class=Answering, **settings):
        return fake_hooks(transport, node_class, **{
            'handshake_timeout_s': TIMEOUT_S, 'required_readers': 1, **settings})

    return create


def test_with_all_peers_there_it_takes_no_time(transport, make, clock):
    node = make()
    transport.writer('command')
    transport.reader('voltage')
    assert await_peers(node) == ''
    assert clock.now_s == 100.0


@pytest.mark.parametrize('first', ['writer', 'reader'])
def test_peers_that_come_late_are_waited_for(transport, make, clock, first):
    node = make()
    come = [lambda: transport.writer('command'), lambda: transport.reader('voltage')]
    for delay_s, action in zip((2.0, 5.0), come if first == 'writer' else come[::-1], strict=True):
        clock.plan(delay_s, action)
    assert await_peers(node) == ''
    assert 105.0 <= clock.now_s < 105.1


def test_a_writer_that_never_comes_is_named_after_the_timeout(transport, make, clock):
    node = make()
    transport.reader('voltage')
    assert await_peers(node) == (
        '/rig/command has 0 writers, exactly one is needed after 10 s (handshake_timeout_s)')
    assert 110.0 <= clock.now_s < 110.1


def test_a_stream_that_only_its_writer_has_remapped_is_told_with_the_remedy(
    transport, make, clock,
):
    node = make()
    transport.owner('pi').create_own_publisher(Float64MultiArray, 'lab/wish', STREAM)
    transport.writer('reference')  # a stream under its own name is none that is missed
    transport.reader('voltage')
    assert await_peers(node) == (
        '/rig/command has 0 writers, exactly one is needed after 10 s (handshake_timeout_s); a '
        'stream may be on /rig/lab/wish (/rig/pi): what is remapped in one node must be remapped '
        'in all, as by -r command:=/rig/lab/wish')


def test_a_reader_that_never_comes_is_named_after_the_timeout(transport, make, clock):
    node = make(required_readers=2)
    transport.writer('command')
    transport.reader('voltage')
    assert await_peers(node) == (
        '/rig/voltage has 1 reliable readers, 2 are needed after 10 s (handshake_timeout_s)')


def test_no_readers_are_needed_where_none_are_asked_for(transport, make, clock):
    transport.writer('command')
    assert await_peers(make(required_readers=0)) == ''


def test_a_second_writer_is_one_too_many_until_it_goes(transport, make, clock):
    node = make()
    transport.reader('voltage')
    transport.writer('command')
    second = transport.writer('command')
    assert '/rig/command has 2 writers' in await_peers(node)
    clock.plan(1.0, second.publisher.destroy)
    assert await_peers(node) == ''


def test_the_timeout_begins_anew_with_each_handshake(transport, make, clock):
    node = make()
    assert await_peers(node)
    clock.plan(9.0, lambda: transport.writer('command'))
    clock.plan(9.5, lambda: transport.reader('voltage'))
    assert await_peers(node) == ''


def test_time_in_which_the_process_stood_still_does_not_count(transport, make, clock):
    node = make()
    clock.plan(1.0, lambda: clock.advance(3600.0))
    clock.plan(3605.0, lambda: transport.writer('command'))
    clock.plan(3605.0, lambda: transport.reader('voltage'))
    assert await_peers(node) == ''


def test_it_tells_every_three_seconds_what_is_missing(make, clock):
    node = make()
    await_peers(node)
    assert node.logger.texts['info'] == [
        'waiting: /rig/command has 0 writers, exactly one is needed'] * 3


def test_it_ends_at_once_when_the_activation_is_given_up(make, clock):
    node = make()

    def give_up():
        node.given_up = True

    clock.plan(4.0, give_up)
    assert await_peers(node) == 'stopped while waiting for the peers'
    assert 104.0 <= clock.now_s < 104.1


def test_only_required_inputs_need_a_writer_and_the_node_may_need_more(transport, make, clock):
    node = make(Choosy)
    transport.writer('command')
    transport.reader('voltage')
    assert await_peers(node) == ''
    node.missing = 'no model'
    assert await_peers(node) == 'no model after 10 s (handshake_timeout_s)'


def test_a_node_that_subscribes_late_does_so_once_it_knows_the_writer(transport, make, clock):
    node = make(Late)
    node.is_activating = True
    subscriptions = transport.subscriptions['/rig/command']
    assert '/rig/command has 0 writers' in await_peers(node)
    assert not subscriptions
    clock.plan(1.0, lambda: transport.writer('command'))
    assert await_peers(node) == ''
    assert len(subscriptions) == 1
    assert await_peers(node) == ''
    assert len(subscriptions) == 1  # for all runs
