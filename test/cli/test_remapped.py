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

"""Every command on a run of renamed nodes with streams remapped to topics of other names."""

import json

import pytest
import yaml
from mcap.writer import Writer

from piezo_ros.bag import STREAMS, BagWriter, BlockCodec, read
from piezo_ros.cli.main import main
from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.plan import read_plan
from piezo_ros.parameters.parameter_file import parameters_yaml
from piezo_ros.parameters.provenance import run_metadata
from piezo_ros.streams.message_type import DEFINITION, TYPE_NAME

TOPICS = {
    **{stream: f'/rig/{stream}' for stream in STREAMS},
    'voltage': '/amplifier/input', 'displacement': '/stage/position'}
NODES = {'plant': 'stage1', 'controller': 'law', 'compensator': 'inverse', 'trajectory': 'scan'}
STEPPED = {'waveform': 'stepped_sine', 'harmonics': 0, 'amplitude_um': 0.5, 'dwell_s': 0.01}
FREQUENCIES_HZ = [250.0, 400.0, 700.0, 1000.0, 1400.0, 1900.0, 2500.0, 3300.0]


@pytest.fixture
def command(capsys):
    def run(*arguments, code=0):
        assert main(list(map(str, arguments))) == code
        out, err = capsys.readouterr()
        assert 'Traceback' not in err
        return out

    return run


def record(path, plain, planned):
    """Write a run as a recorder would that saw other names."""
    with BagWriter(
        path, topics=TOPICS, namespace='/rig', metadata=run_metadata(planned.parameters),
    ) as writer:
        writer.attach_parameters(parameters_yaml(
            '/rig', {NODES[role]: planned.parameters[role] for role in planned.nodes}))
        for stream in plain.streams:
            _, values = plain.whole(stream)
            writer.write_block(stream, 0, plain.sample_period_s, values)
            writer.write_block(stream, values.size, plain.sample_period_s, [])


def record_foreign(path, plain):
    """Write a run as `ros2 bag record` would, which knows nothing of streams."""
    path.mkdir()
    with (path / 'foreign_0.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start('ros2', 'another program')
        schema = writer.register_schema(TYPE_NAME, 'ros2msg', DEFINITION.encode())
        for stream in plain.streams:
            channel = writer.register_channel(TOPICS[stream], 'cdr', schema)
            raw = BlockCodec(stream).encode(0, plain.sample_period_s, plain.whole(stream)[1])
            writer.add_message(channel, 0, raw, 0)
        writer.finish()


@pytest.fixture
def bags(plan, tmp_path):
    planned = read_plan(plan).runs[1]
    simulate_run(planned, tmp_path / 'plain')
    plain = read(tmp_path / 'plain')
    record(tmp_path / 'own', plain, planned)
    record_foreign(tmp_path / 'foreign', plain)
    return tmp_path


@pytest.mark.parametrize('name', ['own', 'foreign'])
def test_info_names_the_topics(bags, command, name):
    lines = command('bag', 'info', bags / name).splitlines()
    assert 'namespace      /rig' in lines
    for stream, topic in TOPICS.items():
        line = next(line for line in lines if line.startswith(f'  {stream} '))
        remapped = topic != f'/rig/{stream}'
        assert line.endswith(f', on {topic}' if remapped else STREAMS[stream])


@pytest.mark.parametrize('name', ['own', 'foreign'])
def test_the_table_is_that_of_the_plain_run(bags, command, name):
    command('bag', 'salvage', bags / name, '-o', bags / 'saved')
    for bag in ('plain', name, 'saved'):
        command('bag', 'export', bags / bag, '-o', bags / f'{bag}.csv')
        assert (bags / f'{bag}.csv').read_bytes() == (bags / 'plain.csv').read_bytes()


@pytest.mark.parametrize('name', ['own', 'foreign'])
def test_the_scores_are_those_of_the_plain_run(bags, command, name):
    told = [
        word for key, value in read(bags / 'plain').metadata.items()
        if key in ('scheme', 'waveform', 'amplitude_um', 'frequency_hz', 'harmonics')
        for word in (f'--{key.replace("_", "-")}', value)]
    scores = []
    for bag in ('plain', name):
        command('report', bags / bag, '-o', bags / f'of_{bag}', *(
            told if bag == 'foreign' else ()))
        run, = json.loads((bags / f'of_{bag}' / 'report.json').read_text())['runs']
        scores.append((run['scheme'], run['nrmse_percent'], run['max_error_um'], run['samples']))
    assert scores[0] == scores[1]


def test_a_replay_gives_the_recorded_bits(bags, command):
    command('bag', 'salvage', bags / 'own', '-o', bags / 'saved')
    expected = command('replay', bags / 'plain')
    assert command('replay', bags / 'own') == expected
    assert command('replay', bags / 'saved') == expected
    # What `ros2 param dump` writes of the renamed nodes.
    given = bags / 'dump.yaml'
    given.write_text(yaml.safe_dump({
        name: {'ros__parameters': values}
        for name, values in read(bags / 'own').parameters.items()}))
    files = [word for role in ('plant', 'controller', 'compensator') for word in (
        f'--{role}', given)]
    found = command('replay', bags / 'foreign', *files)
    # But for where the models come from.
    assert [line for line in found.splitlines()[1:] if not line.startswith('rig: ')] == [
        line for line in expected.splitlines()[1:] if not line.startswith('rig: ')]


def test_the_same_dynamics_are_identified(command, tmp_path):
    frequencies = {'frequencies_hz': FREQUENCIES_HZ}
    (tmp_path / 'plan.yaml').write_text(yaml.safe_dump({
        'format_version': 1, 'title': 'A stepped sine', 'runs': [{
            'scheme': 'open_loop', **STEPPED, 'trajectory': frequencies}]}))
    planned = read_plan(tmp_path / 'plan.yaml').runs[0]
    simulate_run(planned, tmp_path / 'plain')
    plain = read(tmp_path / 'plain')
    record(tmp_path / 'own', plain, planned)
    record_foreign(tmp_path / 'foreign', plain)
    played = tmp_path / 'played.yaml'
    played.write_text(yaml.safe_dump({
        '/**/trajectory': {'ros__parameters': {**STEPPED, **frequencies}}}))
    models = []
    for name in ('plain', 'own', 'foreign'):
        told = ('--trajectory', played) if name == 'foreign' else ()
        if name == 'foreign':
            # A bag that says nothing of the amplifier: what the plain one says.
            told += ('--slew-limit-v-per-s', planned.plant.slew_limit_v_per_s)
            # Nor of the hysteresis, by which the place of the poles is decided.
            (tmp_path / 'compensator.yaml').write_text(yaml.safe_dump({'/**/compensator': {
                'ros__parameters': {
                    name: planned.parameters['compensator'][name]
                    for name in ('kappa_um_per_v', 'saturation_v')}}}))
            told += ('--compensator', tmp_path / 'compensator.yaml')
        command(
            'identify', 'dynamics', tmp_path / name, '-o', tmp_path / f'{name}.yaml', *told)
        content = yaml.safe_load((tmp_path / f'{name}.yaml').read_text())
        models.append(content['/**/trajectory']['ros__parameters'])
    assert models[0] == models[1]
    # Its command is what the hysteresis makes of the voltage, but for rounding.
    assert models[2].keys() == models[0].keys()
    for name, value in models[0].items():
        assert models[2][name] == (value if isinstance(value, str) else pytest.approx(value)), name
