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

"""What people type, right and wrong: every answer is one that helps, and the node lives on."""

import signal
import time

import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters

EXPECTED = 'sample_period_s (default 1e-05 s)'


def _text(name, value):
    """Return a parameter as ``ros2 param set`` sends what YAML 1.1 takes for text."""
    return Parameter(name=name, value=ParameterValue(
        type=ParameterType.PARAMETER_STRING, string_value=value))


def _set(peer, node, *parameters):
    answer = peer.call(
        SetParameters, f'{node}/set_parameters', SetParameters.Request(parameters=parameters))
    return answer.results


def _get(peer, node, *names):
    return peer.call(
        GetParameters, f'{node}/get_parameters', GetParameters.Request(names=names)).values


@pytest.mark.parametrize(('executable', 'word'), [('plant', '-h'), ('loop', '--help')])
def test_help_is_shown_and_no_node_started(rig, executable, word):
    process = rig.start_process(executable, word)
    assert process.wait() == 0
    assert process.output.startswith(f'usage: {executable} [--ros-args')
    assert EXPECTED in process.output
    assert ('Parameters of compensator:' in process.output) == (executable == 'loop')


def test_an_unknown_word_is_refused(rig):
    process = rig.start_process('plant', '--rate', '5', '--ros-args', '-p', 'seed:=1')
    assert process.wait() == 2
    assert "unknown argument '--rate'" in process.output


@pytest.mark.parametrize(('name', 'text', 'value'), [
    ('noise_rms_um', '1e-5', 1e-5),
    pytest.param('safe_slew_v_per_s', '2E+3', 2000.0, marks=pytest.mark.slow)])
def test_a_number_that_yaml_takes_for_text_is_a_number(rig, peer, name, text, value):
    rig.start_node('plant', '-p', f'{name}:={text}', '-p', 'autostart:=false')
    (given,) = _get(peer, 'plant', name)
    assert (given.type, given.double_value) == (ParameterType.PARAMETER_DOUBLE, value)
    (result,) = _set(peer, 'plant', _text(name, '3e-0'))
    assert result.successful, result.reason
    (taken,) = _get(peer, 'plant', name)
    assert (taken.type, taken.double_value) == (ParameterType.PARAMETER_DOUBLE, 3.0)
    (result,) = _set(peer, 'plant', _text(name, 'three'))
    assert not result.successful
    assert f"{name} is 'three', it must be a number" in result.reason


def test_a_list_with_such_numbers_is_one_of_numbers(rig, peer):
    rig.start_node(
        'compensator', '-p', 'autostart:=false', '-p', 'kappa_um_per_v:=[1e+1, 2.0]',
        '-p', 'saturation_v:=[1e-1]')
    kappa, saturation = _get(peer, 'compensator', 'kappa_um_per_v', 'saturation_v')
    assert list(kappa.double_array_value) == [10.0, 2.0]
    assert list(saturation.double_array_value) == [0.1]


@pytest.mark.parametrize('node', [
    'plant', pytest.param('trajectory', marks=pytest.mark.slow)])
def test_what_a_node_dumps_it_takes_again(rig, peer, node):
    """``ros2 param load`` sends each value of the dump through YAML, floats as Python's repr."""
    rig.start_node(node, '-p', 'autostart:=false')
    names = peer.call(
        ListParameters, f'{node}/list_parameters', ListParameters.Request()).result.names
    dump = dict(zip(names, _get(peer, node, *names), strict=True))
    doubles = {
        name: value.double_value for name, value in dump.items()
        if value.type == ParameterType.PARAMETER_DOUBLE}
    assert doubles['sample_period_s'] == 1e-5
    results = _set(peer, node, *(_text(name, repr(value)) for name, value in doubles.items()))
    assert all(result.successful for result in results), results
    assert dict(zip(names, _get(peer, node, *names), strict=True)) == dump


@pytest.mark.parametrize(('override', 'told'), [
    ('subscription.history:=nonsense', 'nonsense'),
    pytest.param('subscription.depth:=-5', 'depth = -5', marks=pytest.mark.slow),
    pytest.param('subscription.reliability:=3', 'reliability = 3', marks=pytest.mark.slow)])
def test_nonsense_in_a_qos_override_is_told_with_what_is_allowed(rig, override, told):
    process = rig.start_node('plant', '-p', f'qos_overrides.{rig.namespace}/voltage.{override}')
    assert process.wait() == 1
    assert 'cannot configure: voltage cannot be created' in process.output
    assert told in process.output
    assert 'allowed are history keep_last or keep_all' in process.output
    assert 'Traceback' not in process.output


def test_a_parameter_that_breaks_its_parser_is_refused_and_the_node_lives_on(rig, peer):
    process = rig.start_node('controller', '-p', 'autostart:=false')
    (result,) = _set(peer, 'controller', _text('changes', '[' * 100_000))
    assert not result.successful
    assert result.reason
    assert peer.change_state('controller', 'configure')
    (result,) = _set(peer, 'controller', _text('scheme', 'ff'))
    assert result.successful
    process.send(signal.SIGINT)
    assert process.wait() == 0


@pytest.mark.parametrize('seconds', [
    2.0, pytest.param(5.0, marks=pytest.mark.slow)])
def test_ctrl_c_is_heard_while_code_is_compiled(rig, seconds, tmp_path):
    rig.environment['XDG_CACHE_HOME'] = str(tmp_path / 'empty')
    process = rig.start_node('loop', '-p', 'handshake_timeout_s:=60.0', '-p', 'linger_s:=60.0')
    time.sleep(seconds)
    process.send(signal.SIGINT)
    assert process.wait() == 0
    assert 'SIGINT' in process.output
    assert 'finished' not in process.output
    assert 'Traceback' not in process.output
