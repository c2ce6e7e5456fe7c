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

"""How a recorder ends: the bag is closed whatever goes wrong, and what is lost is a fault."""

from types import MappingProxyType

import pytest
from fake_node import activate, configure, fake_node, look_after, poll_all
from fake_transport import PERIOD_S, FakeTransport

from piezo_ros.bag import BlockCodec, read
from piezo_ros.nodes import recorder as recorder_module
from piezo_ros.nodes.recorder import Recorder

VOLTAGE = BlockCodec('voltage')


class _Peers:
    """No node tells its parameters; whether any is waited for is set from outside."""

    parameters = twins = MappingProxyType({})
    silent = owing = ()
    is_complete = True

    def __init__(self, *_arguments):
        pass

    def complete(self):
        return self.is_complete


@pytest.fixture
def peers(monkeypatch):
    monkeypatch.setattr(recorder_module, 'PeerParameters', _Peers)
    monkeypatch.setattr(_Peers, 'is_complete', True)
    return _Peers


@pytest.fixture
def recorder(peers):
    def make(bag, **parameters):
        transport = FakeTransport()
        node = fake_node(
            Recorder, transport, bag_directory=str(bag), streams='voltage', **parameters)
        writer = transport.writer('voltage')
        writer.start(0, PERIOD_S)
        configure(node)
        activate(node)
        return node, transport
    return make


def _poll(node):
    try:
        poll_all(node)
    except Exception as error:
        node.run.break_off(error)


def _whole_file(path):
    (file,) = path.glob('*.mcap')
    return (path / 'metadata.yaml').is_file() and file.read_bytes().endswith(b'\x89MCAP0\r\n')


def test_a_parameter_file_deleted_in_mid_run_is_a_fault_and_the_next_run_has_its_own_bag(
        recorder, tmp_path):
    file = tmp_path / 'parameters.yaml'
    text = '/plant:\n  ros__parameters:\n    seed: 7\n'
    file.write_text(text)
    node, transport = recorder(tmp_path / 'bag', parameters_file=str(file))
    transport.publish_block('voltage', 0, [0.5])
    _poll(node)
    file.unlink()
    node.stop('enough')
    assert node.run_state.has_failed
    assert 'parameters.yaml' in node.run_state.fault
    assert _whole_file(tmp_path / 'bag')
    node.on_deactivate(None)
    node.requests.reset()
    file.write_text(text)
    activate(node)
    transport.publish_block('voltage', 0, [0.25])
    transport.publish_block('voltage', 1, [])
    _poll(node)
    assert not node.run_state.has_failed
    for name, value in (('bag', 0.5), ('bag_2', 0.25)):
        assert read(tmp_path / name).whole('voltage')[1].tolist() == [value]


def test_housekeeping_tells_a_deleted_parameter_file_as_a_fault(
        recorder, peers, monkeypatch, tmp_path):
    file = tmp_path / 'parameters.yaml'
    file.write_text('/plant:\n  ros__parameters:\n    seed: 7\n')
    peers.is_complete = False
    node, _ = recorder(
        tmp_path / 'bag', parameters_file=str(file), parameters_timeout_s=0.0)
    _poll(node)
    peers.is_complete = True
    file.unlink()
    look_after(node, 0.0)
    assert not node.running
    assert 'parameters.yaml' in node.run_state.fault
    assert _whole_file(tmp_path / 'bag')


def _extended(raw):
    """Return a block in XCDR2, where numbers of 8 bytes are aligned to 4."""
    start = VOLTAGE._length_offset + 4
    return b'\x00\x07\x00\x00' + raw[4:start] + raw[VOLTAGE._data_offset:]


def test_a_block_that_the_bag_does_not_take_is_a_fault_and_the_others_are_kept_once(
        recorder, tmp_path):
    node, transport = recorder(tmp_path / 'bag')
    blocks = [VOLTAGE.encode(index, PERIOD_S, [float(index)]) for index in range(5)]
    transport.publish_bytes('voltage', blocks[0])
    _poll(node)
    for raw in (blocks[1], _extended(blocks[2]), blocks[3]):
        transport.publish_bytes('voltage', raw)
    _poll(node)
    assert node.run_state.result == 'faulted'
    assert 'ValueError' not in node.run_state.fault
    assert 'Traceback' not in ''.join(node.logger.texts['error'])
    assert _whole_file(tmp_path / 'bag')
    run = read(tmp_path / 'bag', allow_loss=True)
    assert run.whole('voltage')[1].tolist() == [0.0, 1.0]
    assert len(run.lost) == 1
    assert 'gap: index 2 is due, 3 comes' in run.lost[0]


def test_a_block_of_a_time_beyond_the_bag_leaves_the_others_once_and_the_bag_closed(
        recorder, monkeypatch, tmp_path):
    monkeypatch.setattr(
        'piezo_ros.bag.container.rosbag2_writer.MAXIMUM_TIME_NS', 95_000)
    node, transport = recorder(tmp_path / 'bag')
    for index in range(12):
        transport.publish_block('voltage', index, [float(index)])
    _poll(node)
    assert node.run_state.result == 'faulted'
    assert 'log time' in node.run_state.fault
    assert _whole_file(tmp_path / 'bag')
    assert read(tmp_path / 'bag').whole('voltage')[1].tolist() == [float(i) for i in range(10)]


def test_a_recorder_stopped_ahead_of_a_bag_that_cannot_be_made_is_faulted(
        recorder, peers, tmp_path):
    peers.is_complete = False
    (tmp_path / 'folder').mkdir()
    node, transport = recorder(tmp_path / 'folder' / 'bag')
    transport.publish_block('voltage', 0, [0.5])
    _poll(node)
    (tmp_path / 'folder').rmdir()
    (tmp_path / 'folder').write_text('')
    node.stop('asked to by ~/stop')
    assert node.run_state.has_failed
    assert 'cannot create the bag' in node.run_state.fault
