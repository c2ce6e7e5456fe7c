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

import datetime
import json
import math

import pytest

from piezo_ros.experiment.plan import read_plan
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.node_parameters import LOOP_NODES, NODE_PARAMETERS

NAN, INF = math.nan, math.inf


def refusal_of(path):
    with pytest.raises(PlanError) as refusal:
        read_plan(path)
    message = str(refusal.value)
    assert message.startswith(str(path.parent))
    assert '\n' not in message.split(' is no YAML')[0]
    return message


def test_the_demonstration_is_one_cell_of_table_4_under_three_schemes(config):
    plan = read_plan(config / 'experiments' / 'demo.yaml')
    assert [run.controller.scheme for run in plan.runs] == ['fb', 'ff', 'fbff']
    assert {(run.trajectory.amplitude_um, run.trajectory.frequency_hz) for run in plan.runs} == {
        (1.0, 300.0)}
    assert all(run.plant.slew_limit_v_per_s > 0 for run in plan.runs)


def test_every_parameter_of_every_node_is_filled_in(write_plan):
    (run,) = read_plan(write_plan()).runs
    for node in LOOP_NODES:
        names = {name for each in NODE_PARAMETERS[node] for name in each().to_mapping()}
        assert set(run.parameters[node]) == names


def test_b13_a_parameter_file_of_a_running_node_is_taken_but_for_what_is_of_rclpy(write_plan):
    path = write_plan('format_version: 1\nparameter_files: [rig.yaml]\nruns: [{scheme: fb}]\n')
    (path.parent / 'rig.yaml').write_text(
        '/**/plant:\n  ros__parameters:\n    seed: 7\n    use_sim_time: true\n'
        '    qos_overrides: {/lab/voltage: {subscription: {depth: 5}}}\n')
    plan = read_plan(path)
    assert plan.runs[0].parameters['plant']['seed'] == 7
    assert 'use_sim_time' not in plan.runs[0].parameters['plant']
    (note,) = plan.notes
    assert 'rig.yaml: use_sim_time, qos_overrides of plant is ignored' in note


def test_what_is_of_rclpy_is_refused_in_the_plan_itself(write_plan):
    assert 'use_sim_time' in refusal_of(write_plan(
        'format_version: 1\nruns: [{scheme: fb, plant: {use_sim_time: true}}]\n'))


def test_lists_stand_for_one_run_each_and_the_last_key_runs_fastest(write_plan):
    plan = read_plan(write_plan(
        'format_version: 1\n'
        'runs:\n'
        '  - frequency_hz: [300.0, 400.0]\n'
        '    scheme: [ff, fbff]\n'
        '    amplitude_um: 2.0\n'
        '  - scheme: fb\n'))
    assert [(run.trajectory.frequency_hz, run.controller.scheme, run.trajectory.amplitude_um)
            for run in plan.runs] == [
        (300.0, 'ff', 2.0), (300.0, 'fbff', 2.0), (400.0, 'ff', 2.0), (400.0, 'fbff', 2.0),
        (300.0, 'fb', 1.0)]
    assert [run.name for run in plan.runs][:2] == [
        '000_ff_triangle_2um_300hz', '001_fbff_triangle_2um_300hz']
    assert len({run.name for run in plan.runs}) == 5


def test_a_run_overrides_a_parameter_file_by_a_short_key_or_the_mapping_of_a_node(write_plan):
    plan = read_plan(write_plan(runs=[
        {'plant': {'seed': 5}, 'controller': {'scheme': 'fb', 'proportional_gain': 0.1}},
        {'controller': {'proportional_gain': 0.1}, 'scheme': 'ff'}]))
    first, second = plan.runs
    assert (first.plant.seed, first.plant.gain_mismatch) == (5, -0.0586)
    assert (first.controller.scheme, first.controller.proportional_gain) == ('fb', 0.1)
    assert (second.plant.seed, second.controller.scheme) == (1, 'ff')


@pytest.mark.parametrize(('run', 'words'), [
    ({'controller': {'scheme': 'fb'}, 'scheme': 'ff'},
     "controller: scheme is 'fb' and scheme beside it is 'ff'; a run takes one of them"),
    ({'amplitude_um': [1.0, 2.0], 'trajectory': {'amplitude_um': 1.0}},
     'trajectory: amplitude_um is 1.0 and amplitude_um beside it is [1.0, 2.0]'),
    ({'changes': [{'at_sample': 5, 'scheme': 'fb'}], 'controller': {'changes': ''}},
     "controller: changes is '' and changes beside it is [{"),
])
def test_two_values_for_one_parameter_of_a_run_are_refused(write_plan, run, words):
    assert f'run 1: {words}' in refusal_of(write_plan(runs=[run]))


@pytest.mark.parametrize(('run', 'words'), [
    ({'output': 'voltage', 'amplitude_um': 1.0}, 'amplitude_um has no effect: output is voltage'),
    ({'output': 'voltage', 'offset_um': 1.0}, 'offset_um has no effect: output is voltage'),
    ({'output': 'voltage', 'scheme': ['fb', 'ff']}, 'scheme has no effect: output is voltage'),
    ({'output': 'voltage', 'harmonics': 9}, 'harmonics has no effect: output is voltage'),
    ({'output': 'voltage', 'controller': {'scheme': 'fb'}}, 'controller has no effect: output is'),
    ({'trajectory': {'output': 'voltage', 'amplitude_um': 2.0}},
     'trajectory: amplitude_um has no effect: output is voltage'),
    ({'amplitude_v': 2.0}, 'amplitude_v has no effect: it is for output voltage, give amplitude_u'),
    ({'trajectory': {'offset_v': 2.0}}, 'trajectory: offset_v has no effect: it is for output vol'),
    ({'flyback_fraction': 0.2}, 'flyback_fraction has no effect: waveform is triangle'),
    ({'waveform': ['triangle', 'sine'], 'stairs': 3}, 'stairs has no effect: waveform is triangle'),
    ({'lissajous_phase': 0.1}, 'lissajous_phase has no effect: waveform is triangle, it is for l'),
    ({'dwell_s': 0.1}, 'dwell_s has no effect: waveform is triangle, it is for stepped_sine'),
    ({'trajectory': {'frequencies_hz': [1.0]}},
     'trajectory: frequencies_hz has no effect: waveform is triangle'),
    ({'waveform': 'multisine', 'ramp_periods': 1}, 'ramp_periods has no effect: waveform is mult'),
])
def test_a_key_that_has_no_effect_is_refused_with_the_reason(write_plan, run, words):
    assert f'run 1: {words}' in refusal_of(write_plan(runs=[run]))


def test_a_key_may_be_for_one_of_the_combinations_and_0_asks_for_nothing(write_plan):
    plan = read_plan(write_plan(runs=[
        {'waveform': ['triangle', 'sawtooth'], 'flyback_fraction': 0.2, 'scheme': 'ff'},
        {'output': 'voltage', 'amplitude_v': 1.0, 'harmonics': 0}]))
    assert len(plan.runs) == 3


def test_changes_of_a_run_are_a_parameter_of_its_controller(write_plan):
    entries = [{'at_sample': 5, 'scheme': 'fb'}, {'at_sample': 9, 'proportional_gain': 0.5}]
    (run,) = read_plan(write_plan(runs=[{'scheme': 'ff', 'changes': entries}])).runs
    assert [(change.at_sample, change.values) for change in run.changes] == [
        (5, {'scheme': 'fb'}), (9, {'proportional_gain': 0.5})]
    assert json.loads(run.parameters['controller']['changes']) == entries


def test_a_list_of_a_node_stays_a_list(write_plan):
    plan = read_plan(write_plan(runs=[
        {'plant': {'kappa_um_per_v': [5.0, 1.3], 'saturation_v': [0.1]}}]))
    assert len(plan.runs) == 1
    assert plan.runs[0].plant.kappa_um_per_v == (5.0, 1.3)


def test_one_sample_period_reaches_every_node(write_plan):
    (run,) = read_plan(write_plan(sample_period_s=2e-5)).runs
    assert {run.parameters[node]['sample_period_s'] for node in LOOP_NODES} == {2e-5}


def test_numbers_read_as_ros_reads_them(write_plan):
    text = 'format_version: 1\nsample_period_s: 2e-5\nruns: [{amplitude_um: 1E0, periods: 5}]\n'
    (run,) = read_plan(write_plan(text)).runs
    assert run.trajectory.sample_period_s == 2e-5
    assert run.trajectory.amplitude_um == 1.0


def test_title_and_scored_periods_have_defaults(write_plan):
    plan = read_plan(write_plan())
    assert (plan.title, plan.score_periods) == ('plan', 4.0)
    plan = read_plan(write_plan(title='Some', score_periods=2.5))
    assert (plan.title, plan.score_periods) == ('Some', 2.5)


@pytest.mark.parametrize(('keys', 'fragments'), [
    ({'format_version': 2}, ['format_version is 2, only 1 is known']),
    ({'format_version': ...}, ['format_version is None']),
    ({'titel': 'x'}, ["unknown key 'titel'; allowed are format_version, title,"]),
    ({'runs': ...}, ['runs is None, it must be a list']),
    ({'runs': []}, ['runs is empty']),
    ({'runs': 'ff'}, ["runs is 'ff', it must be a list"]),
    ({'runs': ['ff']}, ["run 1 is 'ff', it must be a mapping"]),
    ({'runs': [{}, {'amplitude': 1.0}]}, ["run 2: unknown key 'amplitude'; allowed are scheme,"]),
    ({'runs': [{1: 2}]}, ["run 1: unknown key '1'"]),
    ({'runs': [{'recorder': {}}]}, ["run 1: unknown key 'recorder'"]),
    ({'runs': [{'scheme': []}]}, ['run 1: scheme is an empty list']),
    ({'runs': [{'scheme': 'pid'}]}, ["run 1: controller: scheme is 'pid', allowed are fb, ff,"]),
    ({'runs': [{'scheme': [['ff']]}]}, ["scheme is ['ff'], allowed are|must be text"]),
    ({'runs': [{'plant': 3}]}, ['run 1: plant is 3, it must be a mapping of parameters']),
    ({'runs': [{'plant': {'sede': 1}}]}, ["run 1: plant: unknown parameter 'sede' of plant"]),
    ({'runs': [{'amplitude_um': '1 um'}]}, ["amplitude_um is '1 um', it must be a number"]),
    ({'runs': [{'amplitude_um': [1.0, 6.5]}]}, ['run 1: amplitude_um is 6.5 um', 'travels 6 um']),
    ({'runs': [{'amplitude_um': 0.0}]}, ['run 1: amplitude_um is 0.0 um, it must be above 0']),
    ({'runs': [{'amplitude_um': 2.0, 'plant': {'operating_point_um': 11.0}}]},
     ['amplitude_um is 2.0 um', 'travels 1 um']),
    ({'runs': [{'frequency_hz': 6e4}]},
     ['run 1: trajectory: frequency_hz is 60000.0 Hz', 'Nyquist frequency 50000 Hz']),
    ({'runs': [{'frequency_hz': 6e3, 'harmonics': 9}]}, ['harmonic 9 of 6000 Hz is at 54000 Hz']),
    ({'sample_period_s': 1e-2}, ['frequency_hz is 300.0 Hz', 'Nyquist frequency 50 Hz']),
    ({'runs': [{'plant': {'sample_period_s': 1e-4}}]},
     ['sample_period_s differs between the nodes', '0.0001']),
    ({'score_periods': 6}, [
        'score_periods is 6, it must be above 0, and at most 5 (periods of 000_ff_']),
    ({'score_periods': 0}, ['score_periods is 0, it must be above 0, and at most 5']),
    ({'score_periods': -1}, ['score_periods is -1']),
    ({'score_periods': '4'}, ["score_periods is '4', it must be a number"]),
    ({'score_periods': True}, ['score_periods is True, it must be a number']),
    ({'parameter_files': 'rig.yaml'}, ["parameter_files is 'rig.yaml', it must be a list"]),
    ({'parameter_files': ['none.yaml']}, ['none.yaml: No such file or directory']),
    ({'parameter_files': ['.']}, ['Is a directory']),
    ({'runs': [{'plant': {'gain_mismatch': 11}}]}, ['gain_mismatch is 11.0, allowed is -0.9 … 10']),
    ({'runs': [{'periods': 1e9, 'frequency_hz': 1e-3}]}, ['indices end at']),
    ({'runs': [{'controller': {'apply_at_sample': 7}}]}, ['apply_at_sample is 7', 'lists changes']),
    ({'runs': [{'plant': {'keep_state': True}}]}, ['keep_state is true, every run of a plan']),
    ({'runs': [{'changes': {'at_sample': 3}}]}, ['run 1: changes is', 'must be a list of map']),
    ({'runs': [{'changes': [{'scheme': 'ff'}]}]}, ['run 1: controller: changes: at_sample is No']),
    ({'runs': [{'changes': [{'at_sample': 1, 'seed': 2}]}]}, ['seed cannot change during a run']),
    ({'runs': [{'changes': [{'at_sample': 1, 'scheme': math.nan}]}]}, ['scheme is nan']),
    ({'runs': [{'changes': [{'at_sample': 1, 'scheme': datetime.date(2024, 1, 1)}]}]},
     ['run 1: changes is', 'not JSON serializable']),
    ({'runs': [{'periods': 5, 'changes': [{'at_sample': 1667, 'scheme': 'fb'}]}]},
     ['at_sample is 1667, the run has 1667 samples']),
    ({'runs': [{'output': 'voltage', 'changes': [{'at_sample': 1, 'scheme': 'fb'}]}]},
     ['changes: with output voltage there is no controller']),
    ({'runs': [{'controller': {'command_minimum_um': 0.0},
                'changes': [{'at_sample': 1, 'command_maximum_um': 0.0}]}]},
     ['run 1: changes: command_minimum_um is 0.0 um']),
])
def test_a_plan_that_cannot_be_run_is_refused_by_file_run_key_and_value(
        write_plan, keys, fragments):
    message = refusal_of(write_plan(**keys))
    for fragment in fragments:
        assert any(choice in message for choice in fragment.split('|')), message


@pytest.mark.parametrize('bad', ['.nan', '.inf', '-.inf'])
@pytest.mark.parametrize('place', [
    'format_version: {}\nruns: [{{}}]',
    'format_version: 1\nscore_periods: {}\nruns: [{{}}]',
    'format_version: 1\nsample_period_s: {}\nruns: [{{}}]',
    'format_version: 1\nruns: {}',
    'format_version: 1\nruns: [{}]',
    'format_version: 1\nparameter_files: {}\nruns: [{{}}]',
    'format_version: 1\nparameter_files: [{}]\nruns: [{{}}]',
    'format_version: 1\nruns: [{{scheme: {}}}]',
    'format_version: 1\nruns: [{{waveform: [triangle, {}]}}]',
    'format_version: 1\nruns: [{{plant: {}}}]',
    'format_version: 1\nruns: [{{plant: {{saturation_v: [{}]}}}}]',
    'format_version: 1\nruns: [{{{}: 1}}]',
    *(f'format_version: 1\nruns: [{{{{{key}: [{{}}]}}}}]' for key in (
        'amplitude_um', 'frequency_hz', 'periods', 'ramp_periods', 'harmonics')),
    *(f'format_version: 1\nruns: [{{{{{node}: {{{{{key}: {{}}}}}}}}}}]' for node, key in (
        ('plant', 'noise_rms_um'), ('plant', 'seed'), ('plant', 'slew_limit_v_per_s'),
        ('plant', 'order'), ('plant', 'watchdog_s'), ('plant', 'autostart'),
        ('controller', 'proportional_gain'), ('controller', 'bumpless_start'),
        ('controller', 'command_maximum_um'), ('trajectory', 'block_samples'),
        ('compensator', 'kappa_um_per_v'), ('compensator', 'sample_period_s'))),
])
def test_what_is_no_number_is_refused_wherever_it_stands(write_plan, place, bad):
    message = refusal_of(write_plan(place.format(bad)))
    assert bad in message or bad.replace('.', '') in message  # a key is told as it is typed


@pytest.mark.parametrize(('text', 'what'), [
    ('', 'is no plan'), ('runs', 'is no plan'), ('- 1', 'is no plan'), ('a: [', 'is no YAML'),
    pytest.param('title: 2001-99-99', 'is no YAML', id='a day that does not exist'),
    pytest.param('9' * 5000, 'is no YAML', id='too many digits'),
    pytest.param('[' * 5000, 'is no YAML', id='too deep'),
    pytest.param('\x00', 'is no YAML', id='null character'),
    pytest.param('!!python/object:os.system {}', 'is no YAML', id='code'),
])
def test_what_is_no_plan_is_refused_in_words(write_plan, text, what):
    assert what in refusal_of(write_plan(text))


def test_bytes_that_are_no_text_are_refused_in_words(tmp_path):
    path = tmp_path / 'plan.yaml'
    path.write_bytes(b'\xff\xfe\xfa')
    assert 'is no YAML' in refusal_of(path)


def test_a_missing_plan_is_named(tmp_path):
    assert refusal_of(tmp_path / 'none.yaml').endswith('none.yaml: No such file or directory')


def test_a_sample_period_of_its_own_in_a_parameter_file_is_found(write_plan, tmp_path):
    (tmp_path / 'own.yaml').write_text('plant: {ros__parameters: {sample_period_s: 1.0e-4}}')
    assert 'sample_period_s differs' in refusal_of(write_plan(parameter_files=['own.yaml']))


def test_a_bad_value_is_laid_at_the_door_of_its_parameter_file(write_plan, tmp_path):
    (tmp_path / 'own.yaml').write_text('/**/plant: {ros__parameters: {noise_rms_um: .nan}}')
    message = refusal_of(write_plan(parameter_files=['own.yaml']))
    assert 'own.yaml:1: plant: noise_rms_um is nan um, allowed is 0 … 1000 um' in message


A_HUNDRED = str([*range(1, 101)])


@pytest.mark.parametrize(('text', 'words'), [
    ('format_version: 1\nruns: [{scheme: ff}]\nruns: [{scheme: fb}]\n',
     "the key 'runs' is in line 2 and in line 3"),
    ('format_version: 1\nruns:\n  - scheme: ff\n    scheme: fb\n',
     "the key 'scheme' is in line 3 and in line 4"),
    ((f'format_version: 1\nruns: [{{amplitude_um: {A_HUNDRED}, frequency_hz: {A_HUNDRED}, '
     f'harmonics: {A_HUNDRED}, periods: {A_HUNDRED}}}]\n'),
     ('the plan has 100000000 runs with it (100 of amplitude_um x 100 of frequency_hz x 100 of '
     'harmonics x 100 of periods), allowed are 10000')),
    ('format_version: 1\ntitle: [a, b]\nruns: [{scheme: ff}]\n', 'title is a list'),
    (f'format_version: 1\ntitle: {"x" * 501}\nruns: [{{scheme: ff}}]\n',
     'title has 501 characters, allowed are 500'),
    ('format_version: 1\na: &a [x, x, x, x, x, x, x, x]\n' + ''.join(
        f'{name}: &{name} [{", ".join([f"*{before}"] * 8)}]\n'
        for before, name in zip('abcdefgh', 'bcdefghi', strict=True)) + 'title: *i\nruns: []\n',
     'aliases repeat more than 1000000 characters'),
], ids=['runs-twice', 'scheme-twice', 'combinations', 'list', 'long', 'aliases'])
def test_a13_a_plan_without_bounds_or_with_a_key_twice_is_refused_at_once(write_plan, text, words):
    assert words in refusal_of(write_plan(text))
