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

"""``~/stop`` of one node of a whole loop: every other one comes to its end in order."""

import pytest
from std_srvs.srv import Trigger

NODES = ('trajectory', 'controller', 'compensator', 'plant')


@pytest.mark.parametrize(('stopped', 'states'), [
    pytest.param(
        'trajectory', ('stopped', 'finished', 'finished', 'finished'), marks=pytest.mark.slow),
    # A node that only waits for the controller is told that nothing more is wanted.
    ('controller', ('stopped', 'stopped', 'finished', 'finished')),
    # So is the controller by a displacement that ends before the trajectory.
    ('plant', ('stopped', 'stopped', 'finished', 'stopped')),
])
def test_one_stopped_node_ends_the_whole_loop(rig, peer, stopped, states):
    # More samples than any machine sends in the time.
    process = rig.start_node(
        'loop', '-p', 'periods:=1e6', '-p', 'handshake_timeout_s:=60.0', '-p', 'linger_s:=1.0')
    peer.wait(lambda: peer.status('plant').get('index', 0) > 100, 'samples')
    answer = peer.call(Trigger, f'{stopped}/stop', Trigger.Request())
    assert (answer.success, answer.message) == (True, 'stopped: asked to by ~/stop')
    for node, state in zip(NODES, states, strict=True):
        status = peer.wait_for_status(node, state=state)
        if state == 'stopped':
            assert status['by_peer'] == (node != stopped)
        if node == 'trajectory' and node != stopped:
            assert 'demand is 0: no more samples are demanded by ' in status['reason']
    assert peer.wait_for_status('plant')['voltage_v'] == 0.0
    # It was asked for: no fault.
    assert process.wait() == 0
    assert 'ERROR' not in process.output
    assert 'Traceback' not in process.output
