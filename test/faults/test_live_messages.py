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

"""Serialized bytes that are no block, from a foreign writer to each node as a process."""

import random

import pytest
from fault_results import number_of_trials
from message_mutations import MALFORMED, damaged_message
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import UInt64

from piezo_ros.bag import read

PERIOD_S = 1e-5
SAMPLES = 20
# A large message takes a busy machine long. Behind a message of no bytes Fast DDS delivers nothing
# more of its writer to another process.
NAMES = tuple(name for name in MALFORMED if name not in ('large random message', 'no bytes'))
MESSAGES = number_of_trials(4) * len(NAMES)  # to each input
LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Node, what it reads, what it answers with.
NODES = (
    ('plant', ('voltage',), 'displacement'),
    ('compensator', ('command',), 'voltage'),
    ('controller', ('reference', 'feedforward', 'displacement'), 'command'),
    ('recorder', ('voltage',), None),
)


@pytest.fixture
def start(rig, peer):
    """Start a node between foreign writers and a reader."""
    def begin(node, inputs, output, **parameters):
        if output:
            peer.read(output)
        writers = {stream: peer.writer(stream) for stream in inputs}
        process = rig.node(
            node, handshake_timeout_s=60.0, linger_s=0.0, lost_writer_timeout_s=60.0, **parameters)
        peer.wait_for_status(node, state='active')
        return process, writers

    return begin


def _malformed(stream, count):
    generator = random.Random(stream)
    return [
        damaged_message(generator, stream, PERIOD_S, name)
        for name in NAMES * (count // len(NAMES))]


@pytest.mark.parametrize(('node', 'inputs', 'output'), [
    pytest.param(*entry, marks=pytest.mark.slow) for entry in NODES])
def test_malformed_bytes_are_counted_and_the_run_goes_on(
        rig, peer, block, start, node, inputs, output):
    own = {
        'plant': {'watchdog_s': 60.0}, 'controller': {'max_buffer_samples': 100_000},
        'recorder': {'streams': 'voltage', 'bag_directory': str(rig.directory / 'bag')},
    }.get(node, {})
    process, writers = start(node, inputs, output, **own)
    for index in range(SAMPLES):
        for stream, writer in writers.items():
            writer.publish(block(stream, index, [0.01 * index]))
    peer.wait_for_status(node, state='active', refused=0)
    if output:
        peer.wait_for_samples(output, SAMPLES)
    else:
        peer.wait_for_status(node, index=SAMPLES)
    for stream, writer in writers.items():
        for raw in _malformed(stream, MESSAGES):
            writer.publish(raw)
        writer.publish(block(stream, SAMPLES, [0.5, 0.25]))
    peer.wait_for_status(node, refused=len(inputs) * MESSAGES, index=SAMPLES + 2 + (
        node == 'plant'))
    for stream, writer in writers.items():
        writer.publish(block(stream, SAMPLES + 2, []))
    status = peer.wait_for_status(node, state='finished')
    assert not status['voltage_v']  # none but the plant has one
    assert process.wait() == 0, process.output
    assert 'Traceback' not in process.output
    if output:
        assert len(peer.samples(output)) == SAMPLES + 2 + (node == 'plant')
    else:
        assert read(rig.directory / 'bag').samples == SAMPLES + 2


@pytest.mark.slow
def test_malformed_demands_neither_end_nor_delay_the_trajectory(rig, peer):
    for stream in ('reference', 'feedforward'):
        peer.read(stream)
    demand = peer.node.create_publisher(UInt64, 'demand', LATCHED)
    process = rig.node(
        'trajectory', handshake_timeout_s=60.0, linger_s=0.0, lost_writer_timeout_s=60.0,
        block_samples=5, periods=0.3)
    peer.wait_for_status('trajectory', state='active')
    demand.publish(UInt64(data=20))
    peer.wait_for_samples('reference', 20)
    generator = random.Random(1)
    for number in range(600):
        demand.publish(generator.randbytes((0, 1, 3, 4, 7, 8, 11)[number % 7]))
        if number % 50 == 0:
            peer.wait(lambda: True, 'a turn')
    demand.publish(UInt64(data=2**40))
    peer.wait_for_samples('reference', 100)
    assert process.wait() == 0, process.output
    assert 'Traceback' not in process.output
