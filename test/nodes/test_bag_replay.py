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

"""A recorded run played into live nodes, by a player that knows nothing of the project."""

import time

import numpy as np
import pytest
import rclpy
from mcap.reader import make_reader
from rclpy.context import Context
from rclpy.qos import HistoryPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rosbags.rosbag2 import Reader
from std_msgs.msg import Float64MultiArray

from piezo_ros.bag import read
from piezo_ros.runtime.process.middleware import without_shared_memory

# Node -> the streams that are played into it, and the one that it must answer with.
NODES = {
    'controller': (('reference', 'feedforward', 'displacement'), 'command'),
    'compensator': (('command',), 'voltage'),
    'plant': (('voltage',), 'displacement'),
}
RATES = ('all at once', 'bursts', 'one by one')
BEFORE = 'all at once'  # at this rate, before the node is active


class Player:
    """
    Publishes the messages of a bag on topics of the same names, at its own pace.

    With the recorded quality of service or, as the player of rosbag2, with the recorded one but a
    history of ten messages.
    """

    def __init__(self, rig, bag, streams, *, short_history):
        self._context = Context()
        with without_shared_memory():
            rclpy.init(
                args=[], context=self._context, domain_id=rig.domain,
                signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node('player', context=self._context)
        self._messages = []
        self.publishers = {}
        with Reader(bag) as reader:
            for connection in reader.connections:
                stream = connection.topic.rpartition('/')[2]
                if stream in streams:
                    (recorded,) = connection.ext.offered_qos_profiles
                    qos = QoSProfile(
                        history=(
                            HistoryPolicy.KEEP_LAST if short_history else recorded.history.value),
                        depth=10 if short_history else recorded.depth,
                        reliability=recorded.reliability.value,
                        durability=recorded.durability.value)
                    self.publishers[connection.topic] = self._node.create_publisher(
                        Float64MultiArray, connection.topic, qos)
            for connection, _, raw in reader.messages():
                if connection.topic in self.publishers:
                    self._messages.append((self.publishers[connection.topic], bytes(raw)))

    def matched(self):
        return all(
            publisher.get_subscription_count() for publisher in self.publishers.values())

    def play(self, rate):
        size = {'all at once': len(self._messages), 'bursts': 40, 'one by one': 1}[rate]
        for number, (publisher, raw) in enumerate(self._messages, start=1):
            publisher.publish(raw)
            if number % size == 0:
                time.sleep({'bursts': 0.02, 'one by one': 0.0005}.get(rate, 0.0))

    def destroy(self):
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)


@pytest.fixture(scope='module')
def recorded(make_rig, write_plan):
    """A rig, and by scheme the bags of two runs that were recorded in its namespace."""
    rig = make_rig()
    schemes = ('fbff', 'ff')
    process = rig.piezo(
        'run', write_plan(*schemes, periods=2), '-o', rig.directory / 'out', '--keep')
    assert process.wait() == 0, process.output
    bags = sorted((rig.directory / 'out' / 'bags').iterdir())
    return rig, dict(zip(schemes, bags, strict=True))


@pytest.fixture
def recorded_peer(recorded, make_peer):
    return make_peer(recorded[0])


def _parameter_file(bag, path):
    """Write what a bag tells of its nodes, as it is."""
    with next(bag.glob('*.mcap')).open('rb') as file:
        (attachment,) = make_reader(file).iter_attachments()
    path.write_bytes(attachment.data)
    return path


@pytest.mark.parametrize(('node', 'scheme'), [
    ('controller', 'fbff'), pytest.param('controller', 'ff', marks=pytest.mark.slow),
    # The others have no scheme.
    pytest.param('compensator', 'fbff', marks=pytest.mark.slow), ('plant', 'fbff')])
def test_a_played_bag_gives_the_recorded_stream_again_whatever_the_rate(
        recorded, recorded_peer, tmp_path, node, scheme):
    rig, bags = recorded
    peer = recorded_peer
    played, answered = NODES[node]
    bag = bags[scheme]
    peer.read(answered)
    expected = read(bag).whole(answered)[1]
    # The parameters of the recorded node, and one reader where there were two.
    process = rig.start_node(
        node, '--params-file', str(_parameter_file(bag, tmp_path / 'nodes.yaml')),
        '-p', 'autostart:=false', '-p', 'handshake_timeout_s:=60.0',
        '-p', 'required_readers:=1', '-p', 'compiled:=false',
        *(['-p', 'watchdog_s:=1e4'] if node == 'plant' else []))
    assert peer.change_state(node, 'configure')
    for rate in RATES:
        player = Player(rig, bag, played, short_history=rate == 'one by one')
        peer.wait(player.matched, 'the node to be discovered')
        if rate == BEFORE:
            player.play(rate)
        assert peer.change_state(node, 'activate')
        # The node is active once it has found the player.
        if rate != BEFORE:
            player.play(rate)
        peer.wait_for_status(node, state='finished', index=expected.size, refused=0)
        samples = peer.wait_for_samples(answered, expected.size)
        np.testing.assert_array_equal(
            np.array(samples).view(np.uint64), expected.view(np.uint64))
        assert peer.change_state(node, 'deactivate')
        player.destroy()
        peer.wait(
            lambda: len(peer.received[answered][-1].data) == 2, 'the end of the stream')
        peer.received[answered].clear()
    assert peer.change_state(node, 'inactive_shutdown')
    assert process.wait() == 0, process.output
    for word in ('WARN', 'ERROR', 'Traceback'):
        assert word not in process.output
