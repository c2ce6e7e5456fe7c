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

"""The learner in a loop in memory: what it hands over, what the trajectory refuses."""

import json
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pytest
from fake_node import activate, configure, fake_node, poll_all
from fake_transport import PERIOD_S, FakeTransport, take_all
from running_scan import RIG, known_scan, trajectory_of

from piezo_ros.cli.executables.learner_executable import _make_learning
from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.control.tables.motion_table import MotionTable, write_motion_table
from piezo_ros.nodes import learner
from piezo_ros.nodes.compensator import Compensator
from piezo_ros.nodes.controller import Controller
from piezo_ros.nodes.learner_parts import hand_over
from piezo_ros.nodes.plant import Plant
from piezo_ros.nodes.trajectory import Trajectory
from piezo_ros.parameters.parameter_file import read_parameter_set
from piezo_ros.runtime.streams.fault import StreamFault

STREAMS = ('reference', 'feedforward', 'command', 'voltage', 'displacement')
COMMON = {'compiled': False}


class Learner(learner.Learner):
    """As its process makes it."""

    def __init__(self):
        super().__init__(_make_learning)


class InlinePool:
    """Computes at once: in memory a run does not wait for a thread."""

    def __init__(self, threads):
        pass

    def submit(self, function):
        future = Future()
        try:
            future.set_result(function())
        except Exception as error:
            future.set_exception(error)
        return future

    def shutdown(self):
        pass


class Peers:
    """Answers in place of the services of the nodes in memory."""

    def __init__(self, nodes, answer=None):
        self.parameters = {
            node.name: dict(node.values) for node in nodes if node.name in (
                'trajectory', 'controller')}
        self.refusal = None
        self.missing = []
        self._trajectory = next(node for node in nodes if node.name == 'trajectory')
        self._answer = answer or self._trajectory.change_parameters
        self.asked = 0

    def complete(self):
        return not self.missing

    def change_file(self, change):
        self.asked += 1
        self.refusal = self._answer({'file': change.file, 'apply_at_sample': change.at_sample})

    def forget_change(self):
        self.refusal = None


@pytest.fixture
def ring(tmp_path, monkeypatch):
    """Return what makes and runs a loop with a learner."""
    def run(*, periods=70.0, answer=None, scan=None, **controller):
        path, trajectory = trajectory_of(tmp_path, periods=periods)
        transport = FakeTransport()
        given = {
            name: value for name, value in trajectory.to_mapping().items() if value != []}
        nodes = [
            fake_node(Compensator, transport, **COMMON),
            fake_node(Controller, transport, lookahead_samples=200, **{
                'scheme': 'ff', **COMMON, **controller}),
            fake_node(Plant, transport, **COMMON, **{
                name: value for name, value in RIG.to_mapping().items() if value != []}),
            fake_node(Trajectory, transport, block_samples=100, **COMMON, **given),
            fake_node(Learner, transport, scan=str(scan or path), runs=2, settling_s=0.004,
                      directory=str(tmp_path / 'out'))]
        peers = Peers(nodes, answer)
        monkeypatch.setattr(learner, 'ScanPeers', lambda node, make_client: peers)
        monkeypatch.setattr(learner, 'ThreadPoolExecutor', InlinePool)
        monkeypatch.setattr(hand_over, 'FIRST_MARGIN', 300)
        readers = {stream: transport.reader(stream) for stream in STREAMS}
        configure(*nodes)
        for reader in readers.values():
            reader.start(0, PERIOD_S)
        # The learner knows its writers only once they are there.
        activate(*nodes)
        poll_all(*nodes)
        return nodes, {stream: take_all(reader) for stream, reader in readers.items()}, peers

    return run


def test_a_run_with_its_learner_has_the_bits_of_the_listed_changes(ring, tmp_path):
    nodes, streams, _ = ring()
    assert [node.run_state.result for node in nodes] == ['finished'] * 5, nodes[-1].logger.texts
    record = json.loads((tmp_path / 'out' / 'learning.json').read_text())
    assert record['changes']
    assert record['tables'][-1]['nrmse_percent'] < record['tables'][0]['nrmse_percent']
    run = simulate(
        RIG, known_scan(1.0, 500.0)[0].hysteresis, ControllerParameters(scheme='ff'),
        read_parameter_set(
            tmp_path / 'out' / 'changes.yaml', 'trajectory', TrajectoryParameters))
    for stream in STREAMS:
        np.testing.assert_array_equal(streams[stream], getattr(run, f'{stream}_um' if (
            stream != 'voltage') else 'voltage_v'))
    trajectory = nodes[3].status_fields()
    assert trajectory['changed_at'] == record['changes'][-1]['at_sample']
    assert trajectory['file'] == record['changes'][-1]['file']
    assert nodes[4].status_fields()['changed_at'] == trajectory['changed_at']


def test_a_sample_that_is_over_is_tried_again_later(ring, tmp_path):
    late = iter(['apply_at_sample is 5; the next sample is 9 already'] * 2)
    asked = []

    def answer(change):
        asked.append(change['apply_at_sample'])
        return next(late, 'the table is bad')

    nodes, _, _ = ring(periods=50.0, answer=answer)
    assert len(asked) == 3
    assert asked == sorted(asked)
    assert nodes[4].run_state.result == 'finished'
    record = json.loads((tmp_path / 'out' / 'learning.json').read_text())
    assert record['why_done'] == 'the table was refused: the table is bad'


@pytest.mark.parametrize(('controller', 'culprit'), [
    ({'scheme': 'fb'}, "scheme is 'fb', beside a planned scan allowed is ff or fbff"),
    ({'scheme': 'fbff'}, 'reference_delay_samples is 0'),
])
def test_a_scheme_that_cannot_be_learned_is_a_fault(ring, controller, culprit):
    with pytest.raises(StreamFault, match=culprit):  # what ends its run in the stream loop
        ring(periods=20.0, **controller)


def test_a_scan_that_is_no_file_is_refused_at_once(tmp_path):
    node = fake_node(Learner, FakeTransport(), scan=str(tmp_path / 'none.yaml'))
    with pytest.raises(AssertionError, match=r'none.yaml.* it must be a file that piezo plan'):
        configure(node)


def test_the_trajectory_refuses_a_bad_file_by_name_and_plays_on(ring, tmp_path):
    first = known_scan(1.0, 500.0)[1].reference_um
    bad = tmp_path / 'bad.npz'
    write_motion_table(bad, MotionTable(
        np.tile(first, 2), 3.0 * np.tile(first, 2), PERIOD_S, repeat_from=200))
    path, trajectory = trajectory_of(tmp_path, periods=130.0)
    node = fake_node(Trajectory, FakeTransport(), **COMMON, **{
        name: value for name, value in trajectory.to_mapping().items() if value != []})
    assert 'apply_at_sample is 7; it goes with file' in node.change_parameters(
        {'apply_at_sample': 7})
    configure(node)
    node.running, node._index = True, 100
    before = node._blocks(0, 3000)
    for change, culprit in (
            ({'file': str(bad), 'apply_at_sample': 1000}, 'bad.npz: command_um jumps by'),
            ({'file': str(tmp_path / 'no.npz')}, 'no.npz: No such file'),
            ({'file': str(path.with_suffix('.npz')), 'apply_at_sample': 50},
             'apply_at_sample is 50; the next sample is 100 already')):
        assert culprit in node.change_parameters(change)
    np.testing.assert_array_equal(before, node._blocks(0, 3000))
    good = Path(tmp_path / 'good.npz')
    good.write_bytes(path.with_suffix('.npz').read_bytes())
    assert node.change_parameters({'file': str(good)}) == ''
    # Without a sample, where both are nearest within the next repetition.
    assert 100 <= node.status_fields()['changed_at'] < 300
