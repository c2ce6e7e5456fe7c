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

"""What the launch files start, without `launch`."""

import itertools
from pathlib import Path

import pytest
from launch_files import LAUNCH_FILES, default_values, started_by

from piezo_ros.launching.arguments import (
    check_given,
    given_arguments,
    is_launched_by,
    misspelt_configurations,
)
from piezo_ros.launching.node_arguments import reason_to_end
from piezo_ros.model import ParameterError
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.node_parameters import LOOP_NODES
from piezo_ros.parameters.parameter_file import read_parameter_file

CONFIG = Path(__file__).parents[2] / 'config'


SCAN = [argument.name for argument in LAUNCH_FILES['scan.launch.py']]


def processes(launch_file, **given):
    return {
        process.executable: process.ros_arguments
        for process in started_by(launch_file, **given)}


def parameters(words):
    return {
        name: value for flag, word in itertools.pairwise(words) if flag == '-p'
        for name, value in [word.split(':=')]}


@pytest.mark.parametrize(('launch_file', 'given', 'expected'), [
    ('rig.launch.py', {}, [*LOOP_NODES]),
    ('rig.launch.py', {'record': 'true'}, ['recorder', *LOOP_NODES]),
    ('rig.launch.py', {'without': 'plant'}, ['compensator', 'controller', 'trajectory']),
    ('rig.launch.py', {'without': 'plant, controller'}, ['compensator', 'trajectory']),
    ('loop.launch.py', {}, ['loop']),
    ('loop.launch.py', {'record': 'true'}, ['recorder', 'loop']),
    ('scan.launch.py', {'composed': 'true', 'record': 'true'}, ['recorder', 'loop']),
    ('scan.launch.py', {}, [*LOOP_NODES]),
])
def test_what_is_started_is_started_readers_first(launch_file, given, expected):
    assert [*processes(launch_file, **given)] == expected


@pytest.mark.parametrize('launch_file', LAUNCH_FILES)
def test_every_argument_is_described_and_its_default_is_a_choice(launch_file):
    for argument in LAUNCH_FILES[launch_file]:
        assert len(argument.description) > 10
        assert not argument.choices or argument.default in argument.choices


def test_the_defaults_of_a_scan_are_what_the_parameter_files_say():
    defaults = default_values('scan.launch.py')
    in_files = {
        **read_parameter_file(CONFIG / 'trajectory.yaml', ['trajectory'])['trajectory'],
        **read_parameter_file(CONFIG / 'controller.yaml', ['controller'])['controller']}
    shared = defaults.keys() & in_files.keys()
    assert {'scheme', 'amplitude_um', 'frequency_hz', 'harmonics', 'periods'} <= shared
    # -1 stands for the usual number, that of the paper.
    assert (defaults['harmonics'], in_files['harmonics']) == ('-1', 9)
    shared -= {'harmonics'}
    assert {name: defaults[name] for name in shared} == {
        name: str(in_files[name]) for name in shared}


def test_a_scan_sets_its_parameters_behind_the_files_and_each_node_gets_its_own():
    started = processes(
        'scan.launch.py', scheme='ff', amplitude_um='2.5', sample_period_s='2e-5')
    controller, trajectory = started['controller'], started['trajectory']
    assert parameters(controller)['scheme'] == 'ff'
    assert parameters(trajectory)['amplitude_um'] == '2.5'
    assert 'amplitude_um' not in parameters(controller)
    assert parameters(processes('scan.launch.py', periods='3')['trajectory'])['periods'] == '3.0'
    # A number without a point is text in a parameter override.
    assert {parameters(words)['sample_period_s'] for words in started.values()} == {'2.0e-05'}
    assert controller.index('--params-file') < controller.index('-p')
    assert controller[controller.index('--params-file') + 1] == str(CONFIG / 'controller.yaml')


def test_with_a_recorder_every_node_waits_for_it_and_stays_until_it_is_done():
    alone, recorded = processes('rig.launch.py'), processes(
        'rig.launch.py', record='true', bag_directory='there')
    for node in LOOP_NODES:
        assert 'required_readers' not in parameters(alone[node])
        assert parameters(recorded[node])['required_readers'] == '2'
        assert float(parameters(recorded[node])['linger_s']) < 0.0
    assert parameters(recorded['recorder'])['bag_directory'] == 'there'


@pytest.mark.parametrize(('namespace', 'expected'), [
    ('', ''), ('a', 'a'), ('a/', 'a'), ('/a', '/a'), ('/a/', '/a'), ('a/b', 'a/b'), ('/', '/')])
def test_a_namespace_is_of_every_node_and_stays_relative_where_it_is(namespace, expected):
    started = started_by('rig.launch.py', namespace=namespace, record='true')
    assert len(started) == 5
    for process in started:
        assert process.namespace == expected
        # launch_ros adds it, so that it goes into the namespace that was pushed.
        assert not any('__ns' in word for word in process.ros_arguments)


@pytest.mark.parametrize(('namespace', 'word'), [('a', '__ns:=/a'), ('/a/b', '__ns:=/a/b')])
def test_a_command_line_without_launch_has_namespace_and_remappings(namespace, word):
    (loop,) = started_by(
        'loop.launch.py', namespace=namespace, publish_clock='true', clock_topic='there')
    flag, *words = loop.command_line
    assert flag == '--ros-args'
    assert words == [*loop.ros_arguments, '-r', word, '-r', 'clock:=there']
    (loop,) = started_by('loop.launch.py')
    assert loop.command_line == ('--ros-args', *loop.ros_arguments)


def test_patience_is_what_the_files_say_until_it_is_given():
    for words in processes('rig.launch.py', record='true').values():
        assert 'handshake_timeout_s' not in parameters(words)
    given = processes(
        'rig.launch.py', record='true', handshake_timeout_s='60', parameters_timeout_s='7.5')
    for name, words in given.items():
        assert float(parameters(words)['handshake_timeout_s']) == 60.0
        assert ('parameters_timeout_s' in parameters(words)) is (name == 'recorder')
    assert parameters(given['recorder'])['parameters_timeout_s'] == '7.5'


@pytest.mark.parametrize(('executable', 'exit_code', 'reason'), [
    ('recorder', 0, 'recorder is done'),
    ('recorder', 1, 'recorder failed with exit code 1'),
    ('plant', 1, 'plant failed with exit code 1'),
    ('loop', -9, 'loop was killed by signal 9'),
    ('trajectory', 0, ''),
    ('loop', 0, ''),
])
def test_a_rig_ends_with_its_recorder_and_with_whoever_fails(executable, exit_code, reason):
    assert reason_to_end(executable, exit_code) == reason


def test_the_log_tells_what_was_given_and_only_that():
    defaults = default_values('scan.launch.py')
    assert given_arguments(defaults, defaults) == ''
    given = {'namespace': 'one', 'periods': '3', 'scheme': 'fbff'}
    assert given_arguments(defaults, {**defaults, **given}) == 'periods:=3, namespace:=one'


@pytest.mark.parametrize('launch_file', ['loop.launch.py', 'scan.launch.py'])
def test_one_process_takes_every_file_and_no_two_nodes_differ_in_a_name(launch_file):
    given = {} if launch_file == 'loop.launch.py' else {'composed': 'true'}
    composed = processes(launch_file, **given)['loop']
    assert composed.count('--params-file') == len(LOOP_NODES)
    own = parameters(composed)
    if launch_file == 'scan.launch.py':
        separate = processes(launch_file)
        for node in LOOP_NODES:
            assert parameters(separate[node]).items() <= own.items()


@pytest.mark.parametrize(('given', 'error'), [
    ({'amplitude_um': '-1'}, '^amplitude_um is -1.0 um, allowed is 0'),
    ({'amplitude_um': 'much'}, "^amplitude_um is 'much', it must be a number"),
    ({'amplitude_um': ''}, '^amplitude_um is None, it must be a number'),
    ({'harmonics': '2.5'}, 'harmonics is 2.5, it must be an integer'),
    ({'sample_period_s': '0'}, 'sample_period_s is 0.0 s, allowed is'),
    ({'handshake_timeout_s': '-1'}, 'handshake_timeout_s is -1.0 s, allowed is 0'),
    ({'parameters_timeout_s': 'long'}, "parameters_timeout_s is 'long', it must be a number"),
    ({'scheme': 'auto'}, 'feedback_acceptable_frequency_hz is 0 Hz'),
    ({'without': 'plan'}, "without has 'plan', allowed are compensator, controller, plant"),
    ({'without': 'plant', 'composed': 'true'}, 'must be empty with composed'),
])
def test_a_value_that_a_node_would_refuse_starts_nothing(given, error):
    with pytest.raises(ParameterError, match=error):
        processes('scan.launch.py', **given)


def test_a_file_that_is_not_there_is_named():
    with pytest.raises(PlanError, match='nowhere.yaml: No such file'):
        processes('rig.launch.py', rig_file='nowhere.yaml')


def test_what_is_given_is_checked_together_with_what_the_file_says(tmp_path):
    path = tmp_path / 'controller.yaml'
    path.write_text(
        '/**/controller: {ros__parameters: {feedback_acceptable_frequency_hz: [425.0]}}')
    started = processes(
        'scan.launch.py', controller_file=str(path), scheme='auto', frequency_hz='200')
    assert float(parameters(started['controller'])['scan_frequency_hz']) == 200.0
    assert float(parameters(started['controller'])['scan_amplitude_um']) == 1.0


def test_a_clock_is_remapped_for_one_rig_and_stays_relative_where_it_is_told_to():
    def remapped(launch_file, **given):
        return {
            process.executable: process.remappings
            for process in started_by(launch_file, **given) if process.remappings}

    assert remapped('rig.launch.py', publish_clock='true', record='true') == {
        'plant': (('clock', '/clock'),)}
    assert remapped('loop.launch.py', publish_clock='true', clock_topic='clock') == {
        'loop': (('clock', 'clock'),)}
    assert not remapped('rig.launch.py')


def test_a_file_with_what_rclpy_declares_itself_is_handed_over(tmp_path):
    file = tmp_path / 'rig.yaml'
    file.write_text('/**/plant: {ros__parameters: {seed: 7, use_sim_time: true}}')
    plant = processes('rig.launch.py', rig_file=str(file))['plant']
    assert plant[plant.index('--params-file') + 1] == str(file)


def test_arguments_that_a_launch_file_does_not_declare_are_refused():
    path = CONFIG.parent / 'launch' / 'scan.launch.py'
    check_given(path, SCAN, ['frequency_hz:=500', 'sigterm_timeout:=20', 'launch-prefix:=nice'])
    with pytest.raises(PlanError) as caught:
        check_given(path, SCAN, ['scheme:=fb', 'frequncy_hz:=500'])
    text = str(caught.value)
    assert text.startswith(f'{path}: unknown argument frequncy_hz:=500; allowed are scheme, ')
    assert text.endswith("; did you mean 'frequency_hz'?")
    assert all(name in text for name in SCAN)
    with pytest.raises(PlanError, match='unknown argument scheme:=fb'):
        check_given(
            path.with_name('rig.launch.py'), [*default_values('rig.launch.py')], ['scheme:=fb'])


@pytest.mark.parametrize(('words', 'itself'), [
    (['launch', 'piezo_ros', 'scan.launch.py', 'frequncy_hz:=500'], True),
    (['launch', '-n', 'piezo_ros', 'scan.launch.py'], True),
    (['launch', '{folder}/scan.launch.py', 'scheme:=fb'], True),
    (['launch', '{linked}/scan.launch.py'], True),
    (['launch', 'piezo_ros', 'rig.launch.py'], False),
    (['launch', 'my_rigs', 'scan.launch.py', 'rigs:=2'], False),
    (['launch', '{other}/scan.launch.py', 'rigs:=2'], False),
    (['launch', '{other}/two.launch.py', 'inner:={folder}/scan.launch.py'], False),
    (['my_launcher.py'], False),
])
def test_only_what_is_given_to_the_launch_file_itself_is_judged(tmp_path, words, itself):
    folder = CONFIG.parent / 'launch'
    (tmp_path / 'linked').symlink_to(folder)
    other = tmp_path / 'other'
    other.mkdir()
    (other / 'scan.launch.py').touch()
    line = [
        word.format(folder=folder, linked=tmp_path / 'linked', other=other) for word in words]
    assert is_launched_by(['ros2', *line], 'piezo_ros', folder / 'scan.launch.py') is itself


@pytest.mark.parametrize(('names', 'misspelt'), [
    (['frequncy_hz', 'scheme'], {'frequncy_hz': 'frequency_hz'}),
    (['Frequency_hz'], {'Frequency_hz': 'frequency_hz'}),
    (['sample_period', 'amplitude'], {
        'sample_period': 'sample_period_s', 'amplitude': 'amplitude_um'}),
    (['sample_period', 'sample_period_s'], {}),  # of the launch file around it, and handed on
    (['rig', 'rig_name', 'log', 'use_sim_time', 'world'], {}),
    (SCAN, {}),
])
def test_only_what_is_near_to_an_argument_that_is_not_set_is_taken_for_misspelt(names, misspelt):
    assert misspelt_configurations(SCAN, names) == misspelt
