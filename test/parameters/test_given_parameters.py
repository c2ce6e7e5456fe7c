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

"""Misspelt parameters are refused, and what is given in vain is told."""

import pytest

from piezo_ros.model import ParameterError
from piezo_ros.parameters.given_parameters import TakingNode, check_given, given_parameters
from piezo_ros.parameters.node_parameters import LOOP_NODES, parameter_names

OF_RCLPY = ('use_sim_time', 'start_type_description_service')


def taking(role, name=None, namespace='/lab'):
    names = (*parameter_names(role), *OF_RCLPY)
    return TakingNode(role, namespace, name or role, names.__contains__)


CONTROLLER = taking('controller')
LOOP = [taking(role) for role in LOOP_NODES]


def section(pattern, text):
    return f'{pattern}:\n  ros__parameters:\n    {text}\n'


@pytest.fixture
def check(tmp_path):
    """Return what is said of words and files, each a text, for some nodes."""
    def run(*words, nodes=(CONTROLLER,)):
        arguments = ['node', '--ros-args']
        for number, word in enumerate(words):
            if 'ros__parameters' in word:
                file = tmp_path / f'{number}.yaml'
                file.write_text(word)
                arguments += ['--params-file', str(file)]
            else:
                arguments += ['-p', word]
        return check_given(given_parameters(arguments), nodes)

    return run


@pytest.mark.parametrize('given', [
    'proportional_gian:=0.5', section('/**/controller', 'proportional_gian: 0.5'),
    section('/lab/controller', 'proportional_gian: 0.5'),
    'lab:\n  controller:\n    ros__parameters: {proportional_gian: 0.5}\n'])
def test_b11_a_misspelt_parameter_is_refused_with_the_nearest_name(check, given):
    with pytest.raises(ParameterError) as refused:
        check(given)
    assert "unknown parameter 'proportional_gian' of controller" in str(refused.value)
    assert "did you mean 'proportional_gain'?" in str(refused.value)
    with pytest.raises(ParameterError):
        check(given, nodes=LOOP)


@pytest.mark.parametrize(('given', 'words'), [
    ('use_sim_tme:=true', ["'use_sim_tme'", "'use_sim_time'"]),
    ('zzz:=1', ["'zzz'", '--help']),
    (section('/**/controller', 'gains: {proportional: 1}'), ["'gains.proportional'"]),
    # What another node has is not for a section of this one.
    (section('/**/controller', 'frequency_hz: 1.0'), ["'frequency_hz'", '/**/controller of ']),
    ('contrller:scheme:=ff', ['contrller', '/lab/controller']),
    # In a namespace, -p finds no node by its name.
    ('controller:scheme:=ff', ['node /controller', '/lab/controller']),
])
def test_what_cannot_be_meant_is_refused(check, given, words):
    with pytest.raises(ParameterError) as refused:
        check(given)
    for word in words:
        assert word in str(refused.value)


def test_a_renamed_node_has_the_section_of_its_role_checked(check):
    with pytest.raises(ParameterError, match='sede'):
        check(section('/**/plant', 'sede: 7'), nodes=[taking('plant', name='stage')])


@pytest.mark.parametrize('given', [
    'scheme:=ff', 'use_sim_time:=true', 'start_type_description_service:=false',
    'qos_overrides./lab/voltage.publisher.depth:=5', section('/**', 'frequency_hz: 1.0'),
    section('/**/controller', 'qos_overrides: {/lab/command: {publisher: {depth: 5}}}'),
    section('/**/controller', 'use_sim_time: true'), 'trajectory:frequency_hz:=1.0',
    section('/**', 'seed: 1') + section('/**/plant', 'sede: 2'),
])
def test_what_nodes_share_is_nothing_to_tell_of(check, given):
    assert check(given) == []


def test_a_process_of_several_nodes_takes_what_one_of_them_has(check):
    assert check('frequency_hz:=1.0', 'seed:=7', section('/**/plant', 'seed: 7'), nodes=LOOP) == []


def test_a_parameter_of_another_node_and_foreign_ones_are_told(check):
    (line,) = check('frequency_hz:=1.0')
    assert line == 'controller has no parameter frequency_hz, which is one of trajectory: ignored'
    (line,) = check(section('/**', 'robot_description: x'))
    assert "'robot_description'" in line
    assert line.endswith('it is ignored')


def test_a_file_without_a_section_for_the_node_is_told(check):
    (line,) = check(section('controller', 'scheme: ff'))
    assert 'gives nothing to /lab/controller: it has sections for /controller' in line


FILE = section('/**/controller', 'scheme: ff')


@pytest.mark.parametrize('words', [
    ('integral_gain_per_s:=1.0', FILE, 'scheme:=fb'), ('scheme:=fb', FILE),
    # A section /** ahead does as a -p ahead.
    (section('/**', 'scheme: fbff') + FILE, 'scheme:=fb')])
def test_a_word_that_gives_way_to_a_file_is_told(check, words):
    (line,) = check(*words)
    assert line.startswith("scheme is 'ff' as ")
    assert "not 'fb' as -p says" in line
    assert 'give --params-file first' in line


@pytest.mark.parametrize('words', [
    (FILE, 'scheme:=fb'), ('integral_gain_per_s:=1.0', FILE), ('scheme:=ff', FILE),
    ('scheme:=fb', section('/**/plant', 'seed: 1') + section('/**', 'linger_s: 1.0'))])
def test_a_word_that_counts_is_not_told(check, words):
    assert check(*words) == []
