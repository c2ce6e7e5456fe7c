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

"""The four nodes of the loop on topics in memory: the bits of the offline run, however cut."""

import pytest
from fake_node import activate, configure, fake_node, poll_all
from fake_transport import PERIOD_S, FakeTransport, take_all
from hypothesis import example, given, settings
from hypothesis import strategies as st

from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.model import HysteresisParameters, RigParameters
from piezo_ros.nodes.compensator import Compensator
from piezo_ros.nodes.controller import Controller
from piezo_ros.nodes.plant import Plant
from piezo_ros.nodes.trajectory import Trajectory

PERIODS = 0.3
TRAJECTORY = TrajectoryParameters(periods=PERIODS)
STREAMS = ('reference', 'feedforward', 'command', 'voltage', 'displacement')


class Ring:
    """Four nodes that have begun a run, and a reader of every stream."""

    def __init__(self, *, order=(0, 1, 2, 3), block_samples=500, lookahead_samples=1000,
                 compiled=False, copy_samples=0, scheme='fbff'):
        transport = FakeTransport()
        copies = {'recorded_block_samples': copy_samples, 'compiled': compiled}
        self.nodes = [
            fake_node(Compensator, transport, **copies),
            fake_node(Controller, transport, lookahead_samples=lookahead_samples, scheme=scheme,
                      **copies),
            fake_node(Plant, transport, **copies),
            fake_node(Trajectory, transport, periods=PERIODS, block_samples=block_samples,
                      **copies)]
        self.readers = {
            stream: transport.reader(
                stream, topic=f'recorded/{stream}' if copy_samples else stream)
            for stream in STREAMS}
        self.order = order
        configure(*self.nodes)
        self.begin()

    def begin(self):
        for reader in self.readers.values():
            reader.start(0, PERIOD_S)
        activate(*self.nodes)

    def run(self):
        poll_all(*[self.nodes[number] for number in self.order])
        return {stream: take_all(reader) for stream, reader in self.readers.items()}

    def results(self):
        return [node.run_state.result for node in self.nodes]


def expected(scheme='fbff'):
    run = simulate(RigParameters(), HysteresisParameters(), ControllerParameters(scheme=scheme),
                   TRAJECTORY)
    return {
        'reference': run.reference_um.tolist(), 'feedforward': run.feedforward_um.tolist(),
        'command': run.command_um.tolist(), 'voltage': run.voltage_v.tolist(),
        'displacement': run.displacement_um.tolist()}


@settings(max_examples=10)
@given(block=st.integers(1, 200), lookahead=st.integers(1, 200), compiled=st.booleans(),
       copies=st.integers(0, 30), order=st.permutations(range(4)),
       scheme=st.sampled_from(['fb', 'ff', 'fbff', 'open_loop']))
@example(block=1, lookahead=1, compiled=False, copies=0, order=[3, 2, 1, 0], scheme='fbff')
def test_every_stream_has_the_bits_of_the_offline_run(
        block, lookahead, compiled, copies, order, scheme):
    ring = Ring(order=order, block_samples=block, lookahead_samples=lookahead, compiled=compiled,
                copy_samples=copies, scheme=scheme)
    assert ring.run() == expected(scheme)
    assert ring.results() == ['finished'] * 4
    assert all(reader.ended for reader in ring.readers.values())


@pytest.mark.parametrize('compiled', [False, True])
def test_a_second_run_is_the_first_again(compiled):
    ring = Ring(compiled=compiled)
    first = ring.run()
    for node in ring.nodes:
        node.on_deactivate(None)
    ring.begin()
    assert ring.run() == first
    assert [node.run_state.number for node in ring.nodes] == [2] * 4


@pytest.mark.parametrize('stopped', range(4))
def test_one_node_that_is_stopped_ends_the_run_of_all_and_the_next_is_whole(stopped):
    ring = Ring(lookahead_samples=20, block_samples=7)
    for _ in range(3):
        for node in ring.nodes:
            node.quick(1)
    ring.nodes[stopped].stop('deactivated')
    ring.run()
    assert ring.results()[stopped] == 'stopped'
    assert not any(node.running for node in ring.nodes)
    assert not any(node.run_state.has_failed for node in ring.nodes)
    for node in ring.nodes:
        node.run.housekeeping(0.0)
        node.on_deactivate(None)
    ring.begin()
    assert ring.run() == expected()
    assert ring.results() == ['finished'] * 4
