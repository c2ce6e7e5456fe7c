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

"""Every node through every transition, as a lifecycle manager leads it."""

import json

import numpy as np
import pytest
import yaml
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Float64

from piezo_ros.bag import STREAMS
from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.model import HysteresisParameters, MaxwellResistiveCapacitor, RigParameters
from piezo_ros.parameters.node_parameters import LOOP_NODES

COMMAND_UM = 2.0 * np.sin(0.05 * np.arange(200.0))
# State -> transition -> the state that it leads to; every other transition is refused.
TRANSITIONS = {
    'unconfigured': {'configure': 'inactive'},
    'inactive': {'activate': 'active', 'cleanup': 'unconfigured'},
    'active': {'deactivate': 'inactive'},
}
ALL = ('configure', 'activate', 'deactivate', 'cleanup')
# A way that takes every transition twice and ends where it began.
WAY = ('configure', 'cleanup', 'configure', 'activate', 'deactivate', 'activate', 'deactivate',
       'cleanup')


def test_each_state_takes_its_transitions_and_refuses_the_others(rig, peer):
    peer.writer('command')
    peer.read('voltage')
    process = rig.node('compensator', autostart='false', handshake_timeout_s=60.0)
    state = 'unconfigured'
    for transition in WAY:
        for refused in ALL:
            if refused not in TRANSITIONS[state]:
                assert not peer.change_state('compensator', refused)
                assert peer.state('compensator') == state
        state = TRANSITIONS[state][transition]
        assert peer.change_state('compensator', transition)
        assert peer.state('compensator') == state
        peer.wait_for_status('compensator', state=state)
    assert state == 'unconfigured'
    assert peer.change_state('compensator', 'unconfigured_shutdown')
    assert process.wait() == 0
    assert 'Traceback' not in process.output


def test_a_loop_activated_again_gives_the_same_run_and_shows_it(rig, peer):
    trajectory = TrajectoryParameters(periods=2.0)
    monitored = {stream: [] for stream in STREAMS}
    for stream, values in monitored.items():
        peer.node.create_subscription(
            Float64, f'monitor/{stream}', lambda message, to=values: to.append(message.data),
            qos_profile_sensor_data)
    peer.read('displacement')
    # The controller and this reader; everything else has one.
    process = rig.node(
        'loop', autostart='false', handshake_timeout_s=60.0, periods=2.0, monitor_rate_hz=100.0)
    loop_nodes = ('compensator', 'controller', 'plant', 'trajectory')
    for node in loop_nodes:
        assert peer.change_state(node, 'configure')
    peer.wait(
        lambda: peer.node.count_publishers(f'{rig.namespace}/displacement') == 1, 'the plant')
    expected = simulate(
        RigParameters(), HysteresisParameters(), ControllerParameters(), trajectory)
    for run in (1, 2):
        for node in loop_nodes:
            assert peer.change_state(node, 'activate')
        for node in loop_nodes:
            status = peer.wait_for_status(node, state='finished', run=run, result='finished')
            if node == 'trajectory':
                assert (status['total'], status['progress']) == (trajectory.samples, 1.0)
        displacement_um = peer.wait_for_samples('displacement', trajectory.samples + 1)
        np.testing.assert_array_equal(displacement_um, expected.displacement_um)
        # The newest sample is shown also where the run is over before anyone looks twice, and
        # again where best effort has lost it.
        for stream, samples in zip(STREAMS, expected, strict=True):
            peer.wait(
                lambda values=monitored[stream], last=samples[-1]: values and values[-1] == last,
                f'the last sample of monitor/{stream}')
        for node in loop_nodes:
            assert peer.change_state(node, 'deactivate')
        for values in monitored.values():
            values.clear()
        peer.wait(
            lambda: len(peer.received['displacement'][-1].data) == 2, 'the end of the stream')
        peer.received['displacement'].clear()
    for node in loop_nodes:
        assert peer.change_state(node, 'inactive_shutdown')
    assert process.wait() == 0
    for word in ('WARN', 'ERROR', 'Traceback'):
        assert word not in process.output
    assert f'run 2 finished: {trajectory.samples + 1} samples' in process.output


MISSING = {
    'recorder': 'reference has 0 writers',
    'compensator': 'command has 0 writers',
    'controller': 'reference has 0 writers|displacement has 0 writers',
    'plant': 'voltage has 0 writers',
    'trajectory': 'demand has 0 writers',
}


@pytest.mark.parametrize('nodes', [
    ('compensator', 'recorder'),
    pytest.param((*LOOP_NODES, 'recorder'), marks=pytest.mark.slow)])
def test_an_activation_without_peers_fails_and_names_the_topic(rig, peer, tmp_path, nodes):
    processes = {
        node: rig.node(
            node, autostart='false', handshake_timeout_s=0.1, required_readers=0,
            **({'bag_directory': tmp_path / 'bag', 'streams': 'reference'}
               if node == 'recorder' else {}))
        for node in nodes}
    for node in nodes:
        for _ in range(2):
            assert peer.change_state(node, 'configure')
            for _ in range(2):
                assert not peer.change_state(node, 'activate')
                assert peer.state(node) == 'inactive'
                status = peer.wait_for_status(node, state='inactive', run=0, result='')
                assert any(
                    f'{rig.namespace}/{words}' in status['reason']
                    for words in MISSING[node].split('|')), status
            assert peer.change_state(node, 'cleanup')
    for node, process in processes.items():
        assert peer.change_state(node, 'unconfigured_shutdown')
        assert process.wait() == 0
        assert 'Traceback' not in process.output


def _dump(peer, node):
    """Return all parameters of a node, as a tool of ROS dumps them."""
    names = peer.call(
        ListParameters, f'{node}/list_parameters', ListParameters.Request()).result.names
    values = peer.call(
        GetParameters, f'{node}/get_parameters', GetParameters.Request(names=names)).values
    plain = {}
    for name, value in zip(names, values, strict=True):
        value = parameter_value_to_python(value)
        plain[name] = value.tolist() if hasattr(value, 'tolist') else value
    return plain


def test_dumped_parameters_load_again_and_give_the_same_run(rig, peer, block, tmp_path):
    hysteresis = HysteresisParameters(kappa_um_per_v=(3.0, 5.5, 1.3), saturation_v=(0.1, 0.07))
    expected_v = MaxwellResistiveCapacitor(
        hysteresis.kappa_um_per_v, hysteresis.saturation_v).inverse(COMMAND_UM)[0]
    topic = f'{rig.namespace}/voltage'
    arguments = [
        '-p', 'kappa_um_per_v:=[3.0, 5.5, 1.3]', '-p', 'saturation_v:=[0.1, 0.07]',
        '-p', 'handshake_timeout_s:=60.0', '-p', 'linger_s:=0.0',
        '-p', f'qos_overrides.{topic}.publisher.depth:=5000',
        '-p', f'qos_overrides.{topic}.publisher.history:=keep_last']
    peer.read('voltage')
    dumps = []
    for number in range(2):
        writer = peer.writer('command')
        process = rig.start_node('compensator', *arguments)
        peer.wait_for_status('compensator', state='active')
        dumps.append(_dump(peer, 'compensator'))
        # The overrides of the quality of service are in use.
        (_endpoint,) = peer.node.get_publishers_info_by_topic(topic)
        assert dumps[number][f'qos_overrides.{topic}.publisher.depth'] == 5000
        writer.publish(block('command', 0, COMMAND_UM))
        np.testing.assert_array_equal(peer.wait_for_samples('voltage', 200), expected_v)
        writer.publish(block('command', 200, []))
        assert process.wait() == 0
        assert 'WARN' not in process.output
        peer.wait(lambda: len(peer.received['voltage'][-1].data) == 2, 'the end of the voltage')
        peer.node.destroy_publisher(writer)
        peer.received['voltage'].clear()
        peer.forget('compensator')
        file = tmp_path / f'{number}.yaml'
        file.write_text(yaml.safe_dump(
            {f'{rig.namespace}/compensator': {'ros__parameters': dumps[number]}}))
        arguments = ['--params-file', str(file)]
    assert dumps[0] == dumps[1]


@pytest.mark.parametrize('changes', ['[{"at_sample": 5, "scheme": "fb"}]'])
def test_what_cannot_be_loaded_is_told_in_one_line(rig, changes):
    process = rig.node('controller', changes=json.dumps(json.dumps(json.loads(changes)) + ','))
    assert process.wait() == 1
    (line,) = process.output.splitlines()
    assert 'changes' in line
    assert 'no JSON' in line


def test_a_parameter_that_changes_the_topics_needs_a_clean_up_first(rig, peer):
    """It was taken without a word, and the topics stayed as they were."""
    peer.writer('voltage')
    peer.read('displacement')
    process = rig.node('plant', autostart='false', handshake_timeout_s=60.0)
    assert peer.change_state('plant', 'configure')
    peer.set_parameter('plant', 'publish_clock', True)
    assert not peer.change_state('plant', 'activate')
    assert 'publish_clock is True and was False: clean up and configure' in process.output
    assert peer.change_state('plant', 'cleanup')
    assert peer.change_state('plant', 'configure')
    assert peer.change_state('plant', 'activate')
    clock = f'{rig.namespace}/clock'
    peer.wait(lambda: peer.node.count_publishers(clock) == 1, 'the clock')
