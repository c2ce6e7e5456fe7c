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

"""Pace, clock, monitor, diagnostics and services of a managed plant between foreign nodes."""

import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from piezo_ros.model import Rig, RigParameters

VOLTAGE_V = np.concatenate([np.linspace(0.0, 3.0, 200), np.full(100, 3.0)])


class Onlookers:
    """Everything that a plant shows beside its stream, collected."""

    def __init__(self, peer):
        self.monitor, self.clock, self.diagnostics = [], [], []
        self._name = f'{peer.node.get_namespace()}/plant'
        node = peer.node
        node.create_subscription(
            Float64, 'monitor/displacement', self.monitor.append, qos_profile_sensor_data)
        node.create_subscription(Clock, 'clock', self.clock.append, qos_profile_sensor_data)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._take, 10)

    def _take(self, message):
        # Every node of the machine reports there, those of other tests too.
        self.diagnostics += [status for status in message.status if status.name == self._name]

    @property
    def newest(self):
        """The newest diagnostics, with their values as a dict."""
        status = self.diagnostics[-1]
        return status, {pair.key: pair.value for pair in status.values}


@pytest.fixture
def trigger(peer):
    def call(name):
        return peer.call(Trigger, f'plant/{name}', Trigger.Request())
    return call


@pytest.fixture
def managed(rig, peer):
    """Start a plant that waits for transitions, between a foreign writer and a foreign reader."""
    def start(**parameters):
        peer.read('displacement')
        writer = peer.writer('voltage')
        process = rig.node('plant', handshake_timeout_s=60.0, autostart='false', **parameters)
        assert peer.change_state('plant', 'configure')
        return process, writer

    return start


def test_a_paced_run_shows_itself_and_counts_what_comes_too_late(managed, peer, block):
    onlookers = Onlookers(peer)
    process, writer = managed(
        realtime_factor=1e-3, publish_clock='true', monitor_rate_hz=100.0, noise_rms_um=0.0,
        watchdog_s=1e4)
    assert peer.change_state('plant', 'activate')
    displacement_um = Rig(RigParameters(noise_rms_um=0.0)).run(VOLTAGE_V)

    # One sample lasts 10 ms of the wall clock: sooner than that no answer may come. The pace is
    # kept from the first sample on, however late this test is.
    began_s = time.monotonic()
    writer.publish(block('voltage', 0, VOLTAGE_V[:1]))
    peer.wait_for_samples('displacement', 2)
    writer.publish(block('voltage', 1, VOLTAGE_V[1:51]))
    np.testing.assert_array_equal(
        peer.wait_for_samples('displacement', 52)[1:], displacement_um[:51])
    assert time.monotonic() - began_s > 0.4

    # The next question was due long ago.
    time.sleep(0.1)
    writer.publish(block('voltage', 51, VOLTAGE_V[51:52]))
    assert peer.wait_for_status('plant', index=53)['overruns'] >= 1
    peer.wait(
        lambda: onlookers.monitor and onlookers.monitor[-1].data == displacement_um[51],
        'the newest sample on the monitor')
    peer.wait(
        lambda: onlookers.clock and onlookers.clock[-1].clock.nanosec == 520_000, 'the clock')
    times = [message.clock.sec + 1e-9 * message.clock.nanosec for message in onlookers.clock]
    assert times == sorted(times)

    writer.publish(block('voltage', 52, [np.nan]))
    peer.wait_for_status('plant', refused=1)
    # One message warns of it; newer ones may be there already.
    peer.wait(
        lambda: any('refused messages: 1' in status.message for status in onlookers.diagnostics),
        'the refusal in the diagnostics')
    status = next(
        status for status in onlookers.diagnostics if 'refused messages: 1' in status.message)
    values = {value.key: value.value for value in status.values}
    assert status.name == f'{peer.node.get_namespace()}/plant'
    assert status.hardware_id == peer.node.get_namespace()
    assert status.level == DiagnosticStatus.WARN
    assert {'state': 'active', 'run': '1', 'samples': '53', 'gaps': '0', 'lag_samples': '0'}.items(
        ) <= values.items()
    assert int(values['overruns']) >= 1
    assert float(values['rate_hz']) >= 0.0
    # What was told once is no trouble for ever.
    peer.wait(
        lambda: onlookers.diagnostics[-1].level == DiagnosticStatus.OK, 'health')
    assert process.exit_code is None


def test_who_looks_late_sees_the_newest_sample_too(managed, peer, block):
    _process, writer = managed(noise_rms_um=0.0, monitor_rate_hz=100.0)
    assert peer.change_state('plant', 'activate')
    displacement_um = Rig(RigParameters(noise_rms_um=0.0)).run(VOLTAGE_V)
    for count in (10, 20):
        seen = []
        subscription = peer.node.create_subscription(
            Float64, 'monitor/displacement', seen.append, qos_profile_sensor_data)
        writer.publish(block('voltage', count - 10, VOLTAGE_V[count - 10:count]))
        peer.wait_for_samples('displacement', count + 1)
        peer.wait(
            lambda seen=seen, newest=displacement_um[count - 1]: (
                seen and seen[-1].data == newest),
            'the newest sample on the monitor')
        # Between one onlooker and the next there is none.
        peer.node.destroy_subscription(subscription)


def test_stop_reset_and_initialise(managed, peer, block, trigger):
    process, writer = managed(keep_state='true', noise_rms_um=0.0)
    clean_um = Rig(RigParameters(noise_rms_um=0.0)).run(VOLTAGE_V)

    def run():
        """Drive the stage to 3 V, stop it there, and return what it read from the start on."""
        peer.received['displacement'].clear()
        assert peer.change_state('plant', 'activate')
        writer.publish(block('voltage', 0, VOLTAGE_V))
        displacement_um = peer.wait_for_samples('displacement', 301)
        for refused in ('reset', 'initialise'):
            answer = trigger(refused)
            assert not answer.success
            assert 'a run is going on' in answer.message
        answer = trigger('stop')
        assert (answer.success, answer.message) == (True, 'stopped: asked to by ~/stop')
        status = peer.wait_for_status('plant', state='stopped')
        assert (status['voltage_v'], status['result']) == (0.0, 'stopped')
        peer.wait(
            lambda: len(peer.received['displacement'][-1].data) == 2, 'the end of the stream')
        assert peer.change_state('plant', 'deactivate')
        assert peer.wait_for_status('plant', state='inactive')['result'] == 'stopped'
        assert not trigger('stop').success
        return np.array(displacement_um)

    first_um = run()
    np.testing.assert_array_equal(first_um[1:], clean_um)
    # As with a real stage, zero volts is not where it was before.
    assert run()[0] - first_um[0] > 0.2
    answer = trigger('initialise')
    assert answer.success
    assert answer.message == '100 periods of a triangle, from 5 V to 0 V'
    again_um = run()
    assert abs(again_um[0] - first_um[0]) < 0.02
    np.testing.assert_allclose(again_um, first_um, atol=0.03)

    # A fault stays until it is cleared.
    assert peer.change_state('plant', 'activate')
    writer.publish(block('voltage', 5, [0.0]))
    reason = peer.wait_for_status('plant', state='faulted')['reason']
    assert 'lacks the samples 0 … 4' in reason
    assert peer.change_state('plant', 'deactivate')
    # However often it is refused, the fault stays the reason.
    for _ in range(2):
        assert not peer.change_state('plant', 'activate')
        peer.wait_for_status('plant', state='inactive', reason=reason, result='faulted')
    assert f'a fault is latched until ~/reset is called: {reason}\n' in process.output
    answer = trigger('reset')
    assert answer.success
    assert peer.change_state('plant', 'activate')
    peer.wait_for_status('plant', state='active', reason='', run=5)
    assert process.exit_code is None
    assert 'Traceback' not in process.output
    # A process has nothing left to do once its only node is shut down.
    assert peer.change_state('plant', 'active_shutdown')
    assert process.wait() == 0


def test_a_plant_may_join_in_the_middle(managed, peer, block):
    _, writer = managed(start_index=-1)
    assert peer.change_state('plant', 'activate')
    writer.publish(block('voltage', 5000, VOLTAGE_V[:7]))
    writer.publish(block('voltage', 5007, VOLTAGE_V[7:]))
    peer.wait(
        lambda: sum(len(message.data) - 2 for message in peer.received['displacement']) == 301,
        'every sample')
    first, *others = peer.received['displacement']
    rig = Rig(RigParameters())
    rig.index = 5000
    # The reading before the first voltage opens the stream, as at any other start.
    assert list(first.data) == [5000.0, 1e-5, rig.measure()]
    # One answer, or one for each block: boundaries carry no meaning.
    assert [message.data[0] for message in others] in ([5001.0], [5001.0, 5008.0])
    np.testing.assert_array_equal(
        np.concatenate([message.data[2:] for message in others]), rig.run(VOLTAGE_V))
