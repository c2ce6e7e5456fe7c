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

"""The scheme auto of a live controller."""

import numpy as np
import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters

from piezo_ros.control import ControllerParameters
from piezo_ros.control.controller_step import controller_constants, controller_step, initial_state

PERIOD_S = 1e-5


def scheme_parameter(peer):
    (value,) = peer.call(
        GetParameters, 'controller/get_parameters',
        GetParameters.Request(names=['scheme'])).values
    return value.string_value


def set_parameter(peer, name, **value):
    (result,) = peer.call(
        SetParameters, 'controller/set_parameters', SetParameters.Request(
            parameters=[Parameter(name=name, value=ParameterValue(**value))])).results
    assert result.successful, result.reason


def test_auto_becomes_a_concrete_scheme_when_the_controller_is_configured(rig, peer, block):
    process = rig.node(
        'controller', autostart='false', linger_s=-1.0, handshake_timeout_s=60.0, scheme='auto',
        scan_frequency_hz=300.0, scan_amplitude_um=2.0,
        feedback_acceptable_amplitude_um='[1.0, 3.0]',
        feedback_acceptable_frequency_hz='[600.0, 300.0]')
    assert scheme_parameter(peer) == 'auto'
    assert peer.change_state('controller', 'configure')
    assert peer.wait_for_status('controller', state='inactive')['scheme'] == 'fbff'
    # A reader of the parameters, such as the recorder, reads what is in use.
    assert scheme_parameter(peer) == 'fbff'
    process.wait_for(
        'scheme auto is fbff: the scan has 300 Hz, feedback is acceptable below 450 Hz')

    writers = {stream: peer.writer(stream) for stream in ('reference', 'feedforward')}
    displacement = peer.writer('displacement')
    peer.read('command')
    assert peer.change_state('controller', 'activate')
    streams = np.random.default_rng(0).normal(size=(3, 50))
    for stream, samples in zip(writers, streams, strict=False):
        writers[stream].publish(block(stream, 0, samples))
    displacement.publish(block('displacement', 0, streams[2]))
    law = ControllerParameters(scheme='fbff')
    state, constants = initial_state(law), controller_constants(law, PERIOD_S)
    expected = [
        controller_step(state, constants, k, *sample)
        for k, sample in enumerate(streams.T.tolist())]
    assert peer.wait_for_samples('command', 50) == expected
    assert peer.change_state('controller', 'deactivate')

    # Another scan: decided again.
    assert peer.change_state('controller', 'cleanup')
    assert scheme_parameter(peer) == 'auto'
    set_parameter(
        peer, 'scan_frequency_hz', type=ParameterType.PARAMETER_DOUBLE, double_value=800.0)
    assert peer.change_state('controller', 'configure')
    peer.wait_for_status('controller', state='inactive', scheme='ff')
    # A scheme that is set from outside stays.
    set_parameter(peer, 'scheme', type=ParameterType.PARAMETER_STRING, string_value='fb')
    assert peer.change_state('controller', 'cleanup')
    assert scheme_parameter(peer) == 'fb'


@pytest.mark.parametrize('known', [
    {'scan_frequency_hz': 300.0}, {'feedback_acceptable_frequency_hz': '[300.0]'}])
def test_auto_without_both_frequencies_ends_the_start_with_the_reason(rig, known):
    process = rig.node('controller', scheme='auto', **known)
    assert process.wait() == 1
    assert 'Traceback' not in process.output
    assert 'scheme is auto, and ' in process.output
