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

"""A recorder beside nodes of the same full name: no foreign parameters, and the run goes on."""

import signal
from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
from rcl_interfaces.msg import ParameterType, ParameterValue

from piezo_ros.bag import STREAMS, read
from piezo_ros.nodes.recorder_parts.peer_parameters import PeerParameters
from piezo_ros.nodes.recorder_parts.run_description import RunDescription
from piezo_ros.runtime.node.name_twins import warn_of_twins

TWIN = ('plant', '/rig')


def answer(value):
    return SimpleNamespace(result=lambda: value)


class _Client:
    """The parameters of a node; answers when the test says so."""

    def __init__(self, seed):
        self.seed = seed
        self.asked = []

    def services_are_ready(self):
        return True

    def list_parameters(self, callback):
        self.asked.append(callback)

    def get_parameters(self, names, callback):
        value = ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=self.seed)
        callback(answer(SimpleNamespace(values=[value])))

    def answer(self):
        names = answer(SimpleNamespace(result=SimpleNamespace(names=['seed'])))
        self.asked.pop()(names)


@pytest.fixture
def client():
    return _Client(seed=7)


@pytest.fixture
def recorder(transport):
    recorder = transport.owner('recorder')
    recorder.readers = {'displacement': transport.reader('displacement', recorder)}
    return recorder


@pytest.fixture
def writer(transport):
    return transport.writer('displacement', transport.owner('plant'))


@pytest.fixture
def peers(recorder, writer, client):
    return PeerParameters(recorder, lambda name: client)


def test_parameters_of_a_node_with_a_name_of_its_own_are_taken(peers, client):
    assert not peers.complete()
    client.answer()
    assert peers.complete()
    assert peers.parameters == {'/rig/plant': {'seed': 7}}


def test_a_twin_is_named_and_not_asked(peers, client, transport, recorder):
    transport.foreign_nodes = [TWIN, TWIN]
    for _ in range(3):
        assert not peers.complete()
    assert not client.asked
    assert not peers.silent
    assert not peers.owing
    (line,) = recorder.logger.warnings
    assert line.startswith('3 nodes have the name /rig/plant')


def test_what_a_twin_has_told_is_thrown_away(peers, client, transport):
    peers.complete()
    transport.foreign_nodes = [TWIN]
    peers.complete()
    client.answer()  # which of the two says this is not certain
    assert not peers.complete()
    assert peers.parameters == {}


def test_a_second_server_is_a_twin_before_its_name_is_known(peers, client, transport, recorder):
    peers.complete()
    transport.servers = 2
    client.answer()
    assert not peers.complete()
    assert peers.twins == {'/rig/plant': 2}


def test_parameters_that_were_told_before_a_twin_came_to_light_do_not_count(
    peers, client, transport,
):
    description = RunDescription(Path('bag'), '/rig', '', peers)
    peers.complete()
    client.answer()
    assert peers.complete()
    assert 'lost' not in description.contents()[0]
    assert description.news() is None
    transport.foreign_nodes = [TWIN]
    peers.complete()
    metadata, parameters = description.news()
    assert metadata['lost'] == (
        'the parameters of /rig/plant are not certain: 2 nodes have this name')
    assert 'seed' not in parameters


def test_a_twin_that_goes_leaves_no_doubt(peers, client, transport):
    transport.foreign_nodes = [TWIN]
    description = RunDescription(Path('bag'), '/rig', '', peers)
    peers.complete()
    assert description.contents()[0]['lost'] == (
        'the parameters of /rig/plant are not recorded: 2 nodes have this name')
    transport.foreign_nodes = []
    peers.complete()
    client.answer()
    assert peers.complete()
    metadata, parameters = description.news()
    assert metadata['lost'] == ''
    assert 'seed: 7' in parameters


def test_a_twin_that_stays_alone_is_not_taken_for_the_writer(peers, client, transport, writer):
    transport.foreign_nodes = [TWIN]
    peers.complete()
    for publisher in writer.publishers:
        publisher.destroy()
    peers.complete()
    assert not client.asked
    assert '/rig/plant' in peers.twins


def test_a_parameter_file_is_certain(peers, transport, tmp_path):
    transport.foreign_nodes = [TWIN]
    file = tmp_path / 'parameters.yaml'
    file.write_text('/rig/plant: {ros__parameters: {seed: 9}}')
    peers.complete()
    metadata, parameters = RunDescription(Path('bag'), '/rig', str(file), peers).contents()
    assert 'lost' not in metadata
    assert 'seed: 9' in parameters


def test_a_node_tells_of_its_own_twin(transport):
    node = transport.owner('plant')
    node.get_fully_qualified_name = lambda: '/rig/plant'
    transport.foreign_nodes = [TWIN]
    warn_of_twins(node)
    assert not node.logger.warnings
    transport.foreign_nodes = [TWIN, TWIN]
    warn_of_twins(node)
    assert '2 nodes have the name /rig/plant' in node.logger.warnings[0]


def test_b1_a_run_beside_idle_twins_is_recorded_whole(rig, peer):
    twins = [
        rclpy.create_node(name, namespace=rig.namespace, context=peer.node.context)
        for name in ('plant', 'trajectory') for _ in range(2)]
    for twin in twins[::2]:  # the others never answer
        peer.node.executor.add_node(twin)
    bag = rig.directory / 'bag'
    recorder = rig.node('recorder', bag_directory=bag, parameters_timeout_s=1.0)
    # A node is seen by those that it sees, sooner or later.
    peer.wait(
        lambda: ('recorder', rig.namespace) in peer.node.get_node_names_and_namespaces(),
        'the recorder')
    loop = rig.node(
        'loop', required_readers=2, periods=1.0, linger_s=-1.0, watchdog_s=60.0, compiled='false')
    peer.wait(lambda: recorder.exit_code is not None, 'the end of the recorder')
    assert recorder.exit_code == 0, recorder.output
    loop.send(signal.SIGINT)
    assert loop.wait() == 0, loop.output
    assert 'Traceback' not in recorder.output + loop.output
    assert f'3 nodes have the name {rig.namespace}/plant' in recorder.output
    run = read(bag)
    assert run.streams == tuple(STREAMS)
    assert set(run.lost) == {
        f'the parameters of {rig.namespace}/{name} are not recorded: 3 nodes have this name'
        for name in ('plant', 'trajectory')}
    assert set(run.parameters) == {
        f'{rig.namespace}/{name}' for name in ('controller', 'compensator')}
    for twin in twins:
        twin.destroy_node()
