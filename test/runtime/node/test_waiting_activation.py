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

"""While a node waits for its peers it answers everything else."""

import signal
import time

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import GetParameters
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger


def _activate(rig, peer, **parameters):
    """Begin an activation for which there are no peers."""
    process = rig.node(
        'compensator', autostart='false', handshake_timeout_s=1e5, required_readers=0,
        **parameters)
    assert peer.change_state('compensator', 'configure')
    client = peer.node.create_client(ChangeState, 'compensator/change_state')
    peer.wait(client.service_is_ready, 'the service')
    future = client.call_async(
        ChangeState.Request(transition=Transition(id=Transition.TRANSITION_ACTIVATE)))
    peer.wait(lambda: peer.state('compensator') == 'activating', 'the activation to begin')
    return process, future


def test_parameters_state_and_stop_are_answered_while_an_activation_waits(rig, peer):
    process, future = _activate(rig, peer)
    answer = peer.call(
        GetParameters, 'compensator/get_parameters', GetParameters.Request(names=['compiled']))
    assert answer.values[0].bool_value is False
    assert not future.done()
    answer = peer.call(Trigger, 'compensator/stop', Trigger.Request())
    assert (answer.success, answer.message) == (True, 'the activation is given up')
    peer.wait(future.done, 'the answer of the activation')
    assert not future.result().success
    status = peer.wait_for_status('compensator', reason='stopped while waiting for the peers')
    assert status['state'] == 'inactive'
    # It is none the worse for it.
    peer.writer('command')
    assert peer.change_state('compensator', 'activate')
    assert 'ERROR' not in process.output


def test_ctrl_c_ends_an_activation_that_waits_without_an_error(rig, peer):
    process, _ = _activate(rig, peer)
    process.send(signal.SIGINT)
    assert process.wait() == 0
    assert 'ERROR' not in process.output
    assert 'Traceback' not in process.output


@pytest.mark.slow  # Its services are those of one that is led, above.
def test_one_that_starts_itself_waits_in_the_same_way(rig, peer):
    process = rig.node('compensator', handshake_timeout_s=1e5, required_readers=0)
    peer.wait(lambda: peer.state('compensator') == 'activating', 'the activation to begin')
    assert peer.call(Trigger, 'compensator/stop', Trigger.Request()).success
    assert process.wait() == 0
    assert 'stopped while waiting for the peers' in process.output


def test_a_time_limit_does_not_count_a_standstill(rig, peer):
    process = rig.node('compensator', handshake_timeout_s=5.0, required_readers=0)
    peer.wait(lambda: peer.state('compensator') == 'activating', 'the activation to begin')
    process.send(signal.SIGSTOP)
    time.sleep(6.0)
    peer.writer('command')
    process.send(signal.SIGCONT)
    peer.wait_for_status('compensator', state='active')


def test_an_onlooker_with_best_effort_is_no_reader_to_begin_for(rig, peer):
    onlooker = peer.node.create_subscription(
        Float64MultiArray, 'voltage', lambda _message: None, qos_profile_sensor_data)
    peer.writer('command')
    process = rig.node('compensator', handshake_timeout_s=1e5)
    process.wait_for('voltage has 0 reliable readers, 1 are needed')
    endpoints = peer.node.get_publishers_info_by_topic(onlooker.topic_name)
    assert [endpoint.node_name for endpoint in endpoints] == ['compensator']
    peer.read('voltage')
    peer.wait_for_status('compensator', state='active')


def test_readers_count_whatever_they_are_where_the_topic_is_best_effort(rig, peer):
    peer.node.create_subscription(
        Float64MultiArray, 'voltage', lambda _message: None, qos_profile_sensor_data)
    peer.writer('command')
    rig.node('compensator', handshake_timeout_s=1e5, **{
        f'qos_overrides.{rig.namespace}/voltage.publisher.reliability': 'best_effort'})
    peer.wait_for_status('compensator', state='active')
