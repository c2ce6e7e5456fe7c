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

"""Foreign texts on the topic status, and a node that does not end: the true cause is told."""

import json
import os
import signal

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from piezo_ros.bag import STREAMS, read

NONSENSE = ('not json', '[1]', '{"a": 1}', json.dumps({'node': 'plant', 'index': 'seven'}))


@pytest.mark.parametrize('options', [
    ('--composed',), pytest.param(('--keep',), marks=pytest.mark.slow)])
def test_a2_foreign_statuses_end_no_run(rig, peer, write_plan, options):
    """A2: one of them killed every node, without a ramp, and left the bag open."""
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    writers = [
        peer.node.create_publisher(String, f'{rig.namespace}/status', latched) for _ in NONSENSE]
    for writer, text in zip(writers, NONSENSE, strict=True):
        writer.publish(String(data=text))
    command = rig.piezo('run', write_plan('fbff'), '-o', rig.directory / 'out', *options)
    assert command.wait() == 0, command.output
    assert 'refused a status' in command.output
    assert 'Traceback' not in command.output
    run = read(rig.bag)
    assert not run.lost
    assert run.streams == tuple(STREAMS)


@pytest.mark.slow
def test_a6_a_node_that_stands_still_for_good_is_not_told_as_the_cause(rig, start_long):
    """A6: the supervisor has to kill it; what ended the run is the watchdog of the plant."""
    command = start_long('--separate', watchdog_s=2.0)
    os.kill(rig.nodes('trajectory')['trajectory'], signal.SIGSTOP)
    assert command.wait() == 1
    first, *_ = command.output.partition('piezo: ')[2].split('; ')
    assert first.startswith('plant failed: no voltage for')
    assert 'trajectory did not end when it was asked to, and was killed' in command.output
    assert 'the voltage deviation is 0 V' in command.output
    assert not rig.nodes()
