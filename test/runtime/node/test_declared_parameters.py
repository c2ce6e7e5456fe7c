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

"""Parameters and lifecycle of the nodes, as any tool of ROS sees them."""

import numpy as np
import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    SetParameters,
    SetParametersAtomically,
)

from piezo_ros.model import MaxwellResistiveCapacitor

COMMAND_UM = 2.0 * np.sin(0.05 * np.arange(200.0))


# A number out of its range, a rule among parameters, a wrong type, a word of a list.
REFUSED = [
    ('trajectory', 'frequency_hz', '60000.0', ['frequency_hz', '60000.0 Hz', '50000 Hz']),
    ('controller', 'integral_gain_per_s', '.inf', ['integral_gain_per_s', 'inf', 'Max']),
    ('plant', 'seed', 'abc', ['seed', "'abc'", 'INTEGER']),
    ('plant', 'operating_point_v', '11.0', ['operating_point_v', '11.0', '-2.0 … 10.0']),
    ('compensator', 'saturation_v', '[1.0, 2.0]', ['saturation_v', '11 values', '2;']),
    ('recorder', 'streams', 'voltage,speed', ['streams', "'speed'", 'reference, feedforward']),
    ('controller', 'proportional_gian', '0.5', [
        "'proportional_gian' of controller, given by -p", "did you mean 'proportional_gain'?"]),
]
REFUSED_AS_WELL = [
    ('trajectory', 'amplitude_um', '.nan', ['amplitude_um', 'nan', 'Min: 0.0, Max: 10000.0']),
    ('trajectory', 'waveform', 'square', ['waveform', "'square'", 'triangle, sine']),
    ('controller', 'scheme', 'bang', ['scheme', "'bang'", 'fb, ff, fbff, open_loop']),
    ('plant', 'seed', '-1', ['seed', '-1', 'Min: 0']),
    ('compensator', 'sample_period_s', '0.0', ['sample_period_s', '0.0', 'Min: 1e-09']),
    ('recorder', 'compression', 'gzip', ['compression', "'gzip'", 'zstd, lz4, none']),
]


@pytest.mark.parametrize(('node', 'parameter', 'value', 'words'), [
    *REFUSED, *(pytest.param(*each, marks=pytest.mark.slow) for each in REFUSED_AS_WELL)])
def test_an_invalid_value_ends_the_start_in_one_clear_line(rig, node, parameter, value, words):
    process = rig.node(node, **{parameter: value})
    assert process.wait() == 1
    assert 'Traceback' not in process.output
    (line,) = process.output.splitlines()
    for word in words:
        assert word in line


def test_a_parameter_file_that_is_not_there_is_named(rig):
    process = rig.start_node('plant', '--params-file', 'nowhere.yaml')
    assert process.wait() == 1
    assert 'Traceback' not in process.output
    assert 'nowhere.yaml' in process.output


def _value(value):
    if isinstance(value, bool):
        return ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=value)
    if isinstance(value, str):
        return ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
    return ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)


def _parameters(**values):
    return [Parameter(name=name, value=_value(value)) for name, value in values.items()]


def test_empty_lists_are_lists_of_numbers_however_they_are_given(rig, peer, tmp_path):
    file = tmp_path / 'sections.yaml'
    file.write_text("""
/**/trajectory:
  ros__parameters:
    autostart: false
    dynamics: sections
    pole_rates_rad_per_s: [3000.0]
    zero_rates_rad_per_s: []
    pole_frequencies_rad_per_s: [1000, 2000]
    pole_damping_ratios: [0.1, 0.5]
""")
    rig.start_node('trajectory', '--params-file', str(file))
    names = ['zero_rates_rad_per_s', 'zero_damping_ratios', 'pole_damping_ratios', 'dynamics']
    values = peer.call(
        GetParameters, 'trajectory/get_parameters', GetParameters.Request(names=names)).values
    assert [value.type for value in values] == [
        *[ParameterType.PARAMETER_DOUBLE_ARRAY] * 3, ParameterType.PARAMETER_STRING]
    assert [list(value.double_array_value) for value in values[:3]] == [[], [], [0.1, 0.5]]


def test_parameters_are_described_and_invalid_changes_refused_with_the_reason(rig, peer):
    rig.node('controller', autostart='false')
    names = ['scheme', 'integral_gain_per_s', 'measurement_delay_samples']
    scheme, gain, delay, autostart = peer.call(
        DescribeParameters, 'controller/describe_parameters',
        DescribeParameters.Request(names=[*names, 'autostart'])).descriptors
    assert 'takes effect at once, also during a run' in gain.additional_constraints
    assert 'takes effect at the next activation' in delay.additional_constraints
    assert [each.read_only for each in (scheme, gain, delay, autostart)] == [
        False, False, False, True]
    assert scheme.additional_constraints.startswith('one of fb, ff, fbff, open_loop, auto')
    assert gain.description == 'kI [1/s]'
    assert (gain.floating_point_range[0].from_value, gain.floating_point_range[0].to_value) == (
        0.0, 1e9)
    assert (delay.integer_range[0].from_value, delay.integer_range[0].to_value) == (0, 1000)
    assert all(descriptor.description for descriptor in (scheme, gain, delay))

    def change(**values):
        return peer.call(
            SetParameters, 'controller/set_parameters',
            SetParameters.Request(parameters=_parameters(**values))).results

    (result,) = change(scheme='bang')
    assert not result.successful
    assert result.reason.startswith("scheme is 'bang', allowed are fb, ff, fbff, open_loop, auto")
    (result,) = change(integral_gain_per_s=-1.0)
    assert not result.successful
    assert 'integral_gain_per_s' in result.reason
    assert '-1.0' in result.reason
    result = peer.call(
        SetParametersAtomically, 'controller/set_parameters_atomically',
        SetParametersAtomically.Request(
            parameters=_parameters(scheme='ff', command_maximum_um=float('nan')))).result
    assert not result.successful
    assert 'command_maximum_um' in result.reason
    values = peer.call(
        GetParameters, 'controller/get_parameters', GetParameters.Request(names=names)).values
    assert [values[0].string_value, values[1].double_value, values[2].integer_value] == [
        'fbff', 2630.0, 1]
    (result,) = change(scheme='fb')
    assert result.successful
    (result,) = change(autostart=True)
    assert not result.successful
    assert 'read-only' in result.reason


@pytest.mark.slow  # test_lifecycle.py activates a whole loop twice, and takes every transition.
def test_every_activation_is_a_run_of_its_own_with_the_same_samples(rig, peer, block):
    writer = peer.writer('command')
    peer.read('voltage')
    process = rig.node(
        'compensator', autostart='false', linger_s=-1.0, handshake_timeout_s=60.0)
    expected_v = MaxwellResistiveCapacitor().inverse(COMMAND_UM)[0]
    assert peer.state('compensator') == 'unconfigured'
    for lengths in ([200], [1] * 50 + [150]):
        # The second time from the beginning, with new endpoints.
        assert peer.change_state('compensator', 'configure')
        assert peer.state('compensator') == 'inactive'
        for _ in range(2):
            assert peer.change_state('compensator', 'activate')
            assert peer.state('compensator') == 'active'
            start = 0
            for length in lengths:
                writer.publish(block('command', start, COMMAND_UM[start:start + length]))
                start += length
            np.testing.assert_array_equal(peer.wait_for_samples('voltage', 200), expected_v)
            assert peer.change_state('compensator', 'deactivate')
            assert peer.state('compensator') == 'inactive'
            peer.wait(
                lambda: len(peer.received['voltage'][-1].data) == 2, 'the end of the voltage')
            peer.received['voltage'].clear()
        assert peer.change_state('compensator', 'cleanup')
        assert peer.state('compensator') == 'unconfigured'
    assert process.exit_code is None
    assert 'Traceback' not in process.output


def test_an_inactive_node_takes_nothing(rig, peer, block):
    writer = peer.writer('command')
    peer.read('voltage')
    rig.node('compensator', autostart='false', linger_s=-1.0, handshake_timeout_s=60.0)
    assert peer.change_state('compensator', 'configure')
    assert peer.change_state('compensator', 'activate')
    assert peer.change_state('compensator', 'deactivate')
    peer.wait(lambda: peer.received['voltage'], 'the end of the voltage')
    writer.publish(block('command', 0, COMMAND_UM[:10]))
    # Time enough for an answer, if there were one.
    for _ in range(5):
        assert peer.state('compensator') == 'inactive'
    assert peer.change_state('compensator', 'cleanup')
    assert [list(message.data) for message in peer.received['voltage']] == [[0.0, 1e-5]]
