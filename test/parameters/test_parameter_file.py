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

import pytest

from piezo_ros.model import ParameterError
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.node_parameters import NODE_PARAMETERS, check_node_parameters
from piezo_ros.parameters.parameter_file import (
    parameters_of_rclpy,
    parameters_yaml,
    read_parameter_file,
    read_yaml,
)
from piezo_ros.parameters.provenance import run_metadata

NODES = ('plant', 'controller')


@pytest.fixture
def read(tmp_path):
    def of(text):
        path = tmp_path / 'parameters.yaml'
        path.write_text(text)
        return read_parameter_file(path, NODES)
    return of


@pytest.mark.parametrize('key', [
    'plant', '/plant', '/rig/plant', '/**/plant', '/*/plant', '/rig/deep/plant'])
def test_a_node_is_found_in_any_namespace(read, key):
    assert read(f'{key}: {{ros__parameters: {{seed: 3}}}}') == {'plant': {'seed': 3}}


@pytest.mark.parametrize('key', ['/**', '"*"', '/*', '/rig/*'])
def test_a_wildcard_is_every_node_each_of_which_takes_what_it_has(read, key):
    assert read(f'{key}: {{ros__parameters: {{seed: 3, compiled: true}}}}') == {
        'plant': {'seed': 3, 'compiled': True}, 'controller': {'compiled': True}}


def test_later_sections_add_to_earlier_ones_and_win(read):
    assert read(
        '/**: {ros__parameters: {linger_s: 1, start_index: 1}}\n'
        'plant: {ros__parameters: {start_index: 2, c: 3}}'
    ) == {
        'plant': {'linger_s': 1, 'start_index': 2, 'c': 3},
        'controller': {'linger_s': 1, 'start_index': 1}}


def test_sections_may_be_written_into_their_namespaces(read):
    assert read('rig: {lab: {plant: {ros__parameters: {seed: 3}}}}') == {'plant': {'seed': 3}}


def test_a_section_that_lies_in_itself_is_refused(read):
    with pytest.raises(PlanError, match='the alias .all is for nothing or for what it lies in'):
        read('rig: &all {lab: *all}')


def test_other_nodes_are_left_out(read):
    assert read('camera: {ros__parameters: {a: 1}}\nplants: {ros__parameters: {a: 1}}') == {}


@pytest.mark.parametrize('text', ['', '3', '- plant', 'just text'])
def test_a_file_of_another_form_is_refused(read, text):
    with pytest.raises(PlanError, match='parameters.yaml is no ROS parameter file'):
        read(text)


@pytest.mark.parametrize('section', ['3', '{}', '{seed: 3}', '{ros__parameters: 3}', '[1]'])
def test_a_section_without_parameters_is_refused_by_name(read, section):
    with pytest.raises(PlanError, match="'/plant' has no mapping ros__parameters"):
        read(f'/plant: {section}')


SECTION = '{}: {{ros__parameters: {}}}\n'


@pytest.mark.parametrize(('name', 'values', 'words'), [
    ('/**/plnat', '{slew_limit_v_per_s: 1.0}', "'/**/plnat'.*slew_limit_v_per_s.*mean 'plant'"),
    ('plnat', '{compiled: true}', "'/plnat'.*did you mean 'plant'"),
    ('Plant', '{seed: 1}', "did you mean 'plant'"),
    ('/lab/contoller', '{scheme: fb}', "did you mean 'controller'"),
    ('compensater', '{creep_per_decade: 0.1}', "did you mean 'compensator'"),
    ('trajctory', '{periods: 1}', "did you mean 'trajectory'"),
    ('/**/hardware_plant', '{device: ni}', "did you mean 'plant'"),
    ('/lab/stage', '{noise_rms_um: 1.0}', 'section of the plant must have its name, or every para'),
    ('/**/identified_dynamcis', '{verdict: good}', "did you mean 'identified_dynamics'"),
    ('/**', '{slew_limit_v_per_ms: 1.0}', "'slew_limit_v_per_ms'; did you mean 'slew_limit_v_per"),
])
def test_a_misspelt_section_is_refused_with_what_would_be_lost(read, name, values, words):
    with pytest.raises(PlanError, match=f'parameters.yaml:2: .*{words}'.replace('**', r'\*\*')):
        read('plant: {ros__parameters: {seed: 3}}\n' + SECTION.format(name, values))


@pytest.mark.parametrize(('name', 'values'), [
    ('/**/controller_manager', '{update_rate: 100, autostart: true}'),
    ('controller_server', '{controller_frequency: 20.0, use_sim_time: true}'),
    ('pid', '{proportional_gain: 1.0, integral_gain: 2.0}'),
    ('camera', '{device: /dev/video0, frame_id: camera, baud_rate: 9600, 0: first}'),
    ('recorders', '{use_sim_time: true}'), ('/**', '{robot_base_frame: base}'),
    ('/**/identified_hysteresis', '{noise_rms_um: 0.1, sample_period_s: 0.1}'),
])
def test_a_section_of_another_package_is_left_out(read, name, values):
    assert read('controller: {ros__parameters: {scheme: fb}}\n' + SECTION.format(name, values))[
        'controller'] == {'scheme': 'fb'}


@pytest.mark.parametrize(('text', 'words'), [
    ('/**/plant:\n  ros__parameters: {seed: 1}\n  noise_rms_um: 2.0',
     ":3: 'noise_rms_um' stands beside ros__parameters, it must be in it"),
    ('/lab:\n  plant: {ros__parameters: {seed: 1}}\n  seed: 1', ":3: 'seed' has no mapping ros__"),
    ('/lab:\n  plant: {ros__parameters: {seed: 1}}\n  controller: {scheme: fb}',
     ":3: 'controller' has no mapping ros__parameters"),
    ('ros__parameters: {seed: 1}', ':1: ros__parameters is in no node, it must be below a name'),
    ('/**/plant:\n  ros__parameters:', ":1: '/\\*\\*/plant' has no mapping ros__parameters"),
])
def test_what_stands_on_the_wrong_level_is_refused(read, text, words):
    with pytest.raises(PlanError, match=f'parameters.yaml{words}'):
        read(text)


def test_a_key_that_is_no_text_is_taken_as_it_is_typed(read):
    assert read(SECTION.format('plant', '{1: 2, on: 3, ~: 4}')) == {
        'plant': {'1': 2, 'on': 3, '~': 4}}


@pytest.mark.parametrize(('text', 'value'), [
    ('1e-5', 1e-5), ('1.0e-5', 1e-5), ('-2E+3', -2000.0), ('1e5', 1e5), ('5', 5),
    ('1.5', 1.5), ('"1e-5"', '1e-5'), ('e5', 'e5'), ('1e5x', '1e5x'), ('true', True)])
def test_numbers_are_read_as_by_ros(tmp_path, text, value):
    path = tmp_path / 'one.yaml'
    path.write_text(f'value: {text}')
    read = read_yaml(path)['value']
    assert read == value
    assert type(read) is type(value)


@pytest.mark.parametrize('node', NODE_PARAMETERS)
def test_the_parameters_of_every_node_survive_a_file(node, tmp_path):
    complete = check_node_parameters(node, {})
    path = tmp_path / 'parameters.yaml'
    path.write_text(parameters_yaml('/rig', {node: complete}))
    values = read_parameter_file(path, [node])[node]
    assert check_node_parameters(node, values) == complete


OF_RCLPY = """
    use_sim_time: true
    start_type_description_service: true
    qos_overrides./lab/voltage.subscription.depth: 5
    qos_overrides: {/lab/displacement: {publisher: {depth: 5}}}
"""


@pytest.mark.parametrize('pattern', ['/**/plant', '/**', '/lab/plant'])
def test_what_rclpy_declares_itself_is_left_out_and_named(tmp_path, pattern):
    path = tmp_path / 'dumped.yaml'
    path.write_text(f'{pattern}:\n  ros__parameters:\n    seed: 7{OF_RCLPY}')
    assert read_parameter_file(path, ['plant']) == {'plant': {'seed': 7}}
    assert parameters_of_rclpy(path, ['plant']) == {'plant': [
        'use_sim_time', 'start_type_description_service',
        'qos_overrides./lab/voltage.subscription.depth', 'qos_overrides']}


def test_nothing_is_named_where_nothing_is_left_out(tmp_path):
    path = tmp_path / 'plain.yaml'
    path.write_text('/**/plant: {ros__parameters: {seed: 7}}')
    assert parameters_of_rclpy(path, ['plant']) == {}


@pytest.mark.parametrize(('value', 'words'), [
    ('0,5', 'it must be a number; did you mean 0.5?'), ('010', 'did you mean 10?'),
    ('300 nm', 'it must be a number; write the number alone, its unit is um'),
    ('fast', "noise_rms_um is 'fast', it must be a number"), ([1.0], 'it must be a number'),
    (None, 'noise_rms_um is None, it must be a number'), (True, 'it must be a number'),
])
def test_a_number_that_is_none_is_refused_with_what_was_meant(value, words):
    with pytest.raises(ParameterError) as refusal:
        check_node_parameters('plant', {'noise_rms_um': value})
    assert str(refusal.value).endswith(words)


def test_an_unknown_parameter_is_refused_with_the_node_that_does_not_have_it():
    with pytest.raises(ParameterError, match="unknown parameter 'gain' of plant; it has .*seed"):
        check_node_parameters('plant', {'gain': 1.0})


def test_the_record_of_a_run_holds_what_is_known_and_the_versions():
    record = run_metadata({
        'controller': {'scheme': 'ff'}, 'plant': {'seed': 4}, 'trajectory': {'amplitude_um': 1.5}})
    assert (record['scheme'], record['seed'], record['amplitude_um']) == ('ff', '4', '1.5')
    assert 'frequency_hz' not in record
    assert record['version.numpy'].count('.') == 2
    assert all(isinstance(value, str) for value in record.values())
