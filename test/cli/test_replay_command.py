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

import os

import numpy as np
import pytest
import yaml

from piezo_ros.bag import BagWriter, read
from piezo_ros.cli.main import main
from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.plan import read_plan
from piezo_ros.parameters.parameter_file import parameters_yaml


def parameter_file(path, node, **values):
    path.write_text(yaml.safe_dump({f'/**/{node}': {'ros__parameters': values}}))
    return path


def table(text):
    """Return NRMSE, largest error and largest voltage of the recorded and of the replayed run."""
    lines = [line.split() for line in text.splitlines()]
    return {words[0]: [float(word) for word in words[1:]] for words in lines
            if words[0] in ('recorded', 'replayed')}


@pytest.fixture
def replay(capsys):
    def run(*arguments):
        code = main(['replay', *map(str, arguments)])
        out, err = capsys.readouterr()
        assert 'Traceback' not in err
        return code, out, err

    return run


@pytest.fixture
def bag(plan, tmp_path):
    """Record the second run of the plan, under fbff."""
    simulate_run(read_plan(plan).runs[1], tmp_path / 'bag')
    return tmp_path / 'bag'


def write_again(bag, path, *, parameters=True, starts=None):
    """Write the streams of a bag again: without parameters, or some of them from later on."""
    run = read(bag)
    topics = {stream: f'/{stream}' for stream in run.streams}
    with BagWriter(path, topics=topics) as writer:
        if parameters:
            writer.attach_parameters(parameters_yaml(
                '/', {name.strip('/'): values for name, values in run.parameters.items()}))
        for stream in run.streams:
            first = (starts or {}).get(stream, 0)
            writer.write_block(stream, first, run.sample_period_s, run.whole(stream)[1][first:])
    return path


def write_in_chunks(bag, path):
    """Write the streams of a bag again in chunks of 100 samples, as a live recording has them."""
    run = read(bag)
    with BagWriter(path, topics={stream: f'/{stream}' for stream in run.streams}) as writer:
        writer.attach_parameters(parameters_yaml(
            '/', {name.strip('/'): values for name, values in run.parameters.items()}))
        for start in range(0, run.samples, 100):
            for stream in run.streams:
                samples = run.whole(stream)[1][start:start + 100]
                writer.write_block(stream, start, run.sample_period_s, samples)
            writer.flush()
    return path


def test_with_nothing_replaced_both_runs_are_the_same(bag, replay):
    code, out, err = replay(bag)
    assert (code, err) == (0, '')
    assert 'replaced: nothing' in out
    rows = table(out)
    assert rows['recorded'] == rows['replayed']
    assert rows['recorded'][0] > 0.0


def test_another_scheme_gives_what_a_run_under_it_gives(bag, plan, tmp_path, replay):
    simulate_run(read_plan(plan).runs[0], tmp_path / 'ff')
    code, out, _ = replay(bag, '--scheme', 'ff')
    assert code == 0
    assert 'replaced: scheme' in out
    assert table(out)['replayed'] == table(replay(tmp_path / 'ff')[1])['recorded']
    assert table(out)['replayed'] != table(out)['recorded']


def test_tuned_gains_replace_what_they_name_and_nothing_else(bag, tmp_path, replay):
    own = read(bag).parameters['/controller']
    same = parameter_file(
        tmp_path / 'same.yaml', 'controller', proportional_gain=own['proportional_gain'])
    other = parameter_file(tmp_path / 'other.yaml', 'controller', proportional_gain=0.6)
    rows = table(replay(bag, '--controller', same)[1])
    assert rows['recorded'] == rows['replayed']
    code, out, err = replay(bag, '--controller', other)
    assert (code, err) == (0, '')
    assert table(out)['replayed'] != rows['recorded']


def test_a_compensator_that_knows_no_hysteresis_tracks_worse(bag, tmp_path, replay):
    linear = parameter_file(
        tmp_path / 'linear.yaml', 'compensator', kappa_um_per_v=[1.2, 1.2], saturation_v=[0.0])
    code, out, _ = replay(bag, '--compensator', linear)
    assert code == 0
    assert 'replaced: compensator' in out
    assert table(out)['replayed'][0] > 2.0 * table(out)['recorded'][0]


def test_a_bag_that_does_not_tell_its_nodes_needs_them_as_files(bag, tmp_path, replay):
    run = read(bag)
    foreign = write_again(bag, tmp_path / 'foreign', parameters=False)
    code, _, err = replay(foreign)
    assert code == 1
    assert 'tells nothing of the controller' in err
    files = [
        word for node in ('controller', 'compensator', 'plant')
        for word in (f'--{node}', parameter_file(
            tmp_path / f'{node}.yaml', node, **run.parameters[f'/{node}']))]
    code, out, _ = replay(foreign, *files)
    assert code == 0
    assert table(out)['recorded'] == table(out)['replayed']


def test_d10_what_the_data_sheet_does_not_tell_comes_from_the_models_and_is_named(
        bag, tmp_path, replay):
    own = read(bag).parameters
    foreign = write_again(bag, tmp_path / 'foreign', parameters=False)
    files = {
        node: parameter_file(tmp_path / f'{node}.yaml', node, **own[f'/{node}'])
        for node in ('controller', 'compensator', 'trajectory')}
    sheet = parameter_file(tmp_path / 'sheet.yaml', 'plant', slew_limit_v_per_s=18200.0)
    some = ['--plant', sheet, '--controller', files['controller'], '--compensator',
            files['compensator']]
    code, _, err = replay(foreign, *some)
    assert code == 1
    assert 'the dynamics of the rig is not known' in err
    code, out, _ = replay(foreign, *some, '--trajectory', files['trajectory'])
    assert code == 0
    assert f'rig: hysteresis of {files["compensator"]} (--compensator), dynamics of ' in out
    assert f'{files["trajectory"]} (--trajectory)' in out


def test_streams_that_begin_late_are_compared_sample_by_sample(bag, tmp_path, replay):
    late = write_again(bag, tmp_path / 'late', starts={'displacement': 200, 'voltage': 100})
    code, out, _ = replay(late)
    assert code == 0
    assert table(out)['recorded'] == table(out)['replayed']
    samples = read(bag).samples
    assert f'samples {200 + (samples - 200) // 2} … {samples - 1}' in out


def test_a_recording_that_its_nodes_do_not_explain_is_warned_of(bag, tmp_path, replay):
    run = read(bag)
    with BagWriter(tmp_path / 'other', topics={name: f'/{name}' for name in run.streams}) as writer:
        writer.attach_parameters(parameters_yaml(
            '/', {name.strip('/'): values for name, values in run.parameters.items()}))
        for stream in run.streams:
            samples = np.array(run.whole(stream)[1])
            if stream == 'displacement':
                samples[100:] += 1e-3
            writer.write_block(stream, 0, run.sample_period_s, samples)
    code, _, err = replay(tmp_path / 'other')
    assert code == 0
    assert 'warning: the nodes of the bag do not give the recorded run again' in err
    assert "'displacement': 100" in err


@pytest.mark.parametrize(('content', 'complaint'), [
    ({'/**/plant': {'ros__parameters': {}}}, 'has no section for controller'),
    ({'/**/controller': {'ros__parameters': {'proportional_gain': -1.0}}},
     'proportional_gain is -1.0')])
def test_a_file_of_another_kind_is_refused(bag, tmp_path, replay, content, complaint):
    path = tmp_path / 'file.yaml'
    path.write_text(yaml.safe_dump(content))
    code, _, err = replay(bag, '--controller', path)
    assert code == 2
    assert err.startswith('piezo: ')
    assert complaint in err


def test_of_a_cut_bag_what_is_whole_is_replayed_and_the_loss_told(bag, tmp_path, replay):
    bag = write_in_chunks(bag, tmp_path / 'cut')
    (file,) = bag.glob('*.mcap')
    os.truncate(file, round(0.7 * file.stat().st_size))
    code, out, err = replay(bag)
    assert code == 3
    assert file.name in err
    rows = table(out)
    assert rows['recorded'] == rows['replayed']
    code, _, err = replay(bag, '--no-allow-loss')
    assert code == 1
    assert 'is damaged' in err


def test_a_bag_that_is_none_fails_in_words(tmp_path, replay):
    code, _, err = replay(tmp_path / 'nothing')
    assert code == 1
    assert err == f'piezo: there is no bag {tmp_path / "nothing"}\n'


def test_gains_may_be_given_as_options(bag, tmp_path, replay):
    other = parameter_file(
        tmp_path / 'other.yaml', 'controller', proportional_gain=0.6, integral_gain_per_s=100.0)
    by_file, by_option = (
        table(replay(bag, *words)[1])['replayed']
        for words in (['--controller', other], ['--kp', 0.6, '--ki', 100.0]))
    assert by_file == by_option


def test_scheme_auto_takes_the_one_that_errs_least(bag, replay):
    errors = {
        scheme: table(replay(bag, '--scheme', scheme)[1])['replayed'][0]
        for scheme in ('fb', 'ff', 'fbff')}
    code, out, _ = replay(bag, '--scheme', 'auto')
    assert code == 0
    best = min(errors, key=lambda scheme: errors[scheme])
    assert f'scheme auto: {best} errs least' in out
    assert table(out)['replayed'][0] == errors[best]


def test_an_output_directory_that_is_something_else_is_left_alone(bag, tmp_path, replay):
    (tmp_path / 'mine').mkdir()
    (tmp_path / 'mine' / 'file').touch()
    code, _, err = replay(bag, '-o', tmp_path / 'mine')
    assert code == 2
    assert '--force replaces it' in err
