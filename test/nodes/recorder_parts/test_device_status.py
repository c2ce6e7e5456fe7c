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

"""What a bag is told of a device, out of the status of its plant."""

import json

from fake_transport import FakeTransport
from std_msgs.msg import String

from piezo_ros.nodes.recorder_parts.device_status import DeviceStatus
from piezo_ros.runtime.streams.qos import LATCHED

STATUS = {
    'role': 'plant', 'state': 'active', 'device': 'card, serial number 7', 'device_rate_hz': 1e5,
    'voltage_before_v': 0.25, 'voltage_after_v': None, 'played': '', 'overruns': 0}


def told(*texts):
    transport = FakeTransport()
    device = DeviceStatus(transport.owner('recorder'))
    publisher = transport.owner('plant').create_publisher(String, 'status', LATCHED)
    for text in texts:
        publisher.publish(String(data=text))
    return device, publisher


def test_device_rate_and_held_voltages_are_entries_of_the_metadata():
    device, publisher = told(json.dumps(STATUS))
    assert device.metadata() == {
        'device': 'card, serial number 7', 'device_rate_hz': '100000.0',
        'device_voltage_before_v': '0.25', 'device_overruns': '0'}
    publisher.publish(String(data=json.dumps(
        {**STATUS, 'state': 'finished', 'voltage_after_v': 0.0, 'played': 'streamed'})))
    assert device.metadata()['device_voltage_after_v'] == '0.0'
    assert device.metadata()['device_played'] == 'streamed'


def test_a_simulated_plant_other_nodes_and_nonsense_tell_nothing():
    device, _ = told(
        json.dumps({'role': 'plant', 'state': 'active'}), json.dumps({**STATUS, 'role': 'stamped'}),
        'no JSON', '[1]')
    assert device.metadata() == {}
    device.await_rest()


def test_it_waits_for_the_ramp_of_a_run_that_is_cut_short_and_not_for_ever(clock):
    device, publisher = told(json.dumps(STATUS))
    clock.plan(1.0, lambda: publisher.publish(String(data=json.dumps(
        {**STATUS, 'state': 'faulted', 'voltage_after_v': 0.0}))))
    began_s = clock.now_s
    device.await_rest()
    assert 0.9 < clock.now_s - began_s < 1.5
    silent, _ = told(json.dumps(STATUS))
    began_s = clock.now_s
    silent.await_rest()
    assert 4.0 < clock.now_s - began_s < 7.0
