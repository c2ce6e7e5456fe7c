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
import shutil

import numpy as np
import pytest
import yaml

from piezo_ros.bag import STREAMS, BagWriter, read
from piezo_ros.cli.main import main
from piezo_ros.control.tables.motion_table import read_motion_table
from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.plan import read_plan


@pytest.fixture
def command(capsys):
    def run(*arguments):
        code = main(['bag', *map(str, arguments)])
        out, err = capsys.readouterr()
        assert 'Traceback' not in err
        return code, out, err

    return run


@pytest.fixture
def bag(plan, tmp_path):
    simulate_run(read_plan(plan).runs[1], tmp_path / 'bag')
    return tmp_path / 'bag'


@pytest.fixture
def damaged(bag, tmp_path):
    """Write the bag in chunks and cut it off, as a full disk does."""
    run = read(bag)
    path = tmp_path / 'cut'
    with BagWriter(path, topics={stream: f'/{stream}' for stream in STREAMS}) as writer:
        for start in range(0, run.samples, 100):
            for stream in STREAMS:
                samples = run.whole(stream)[1][start:start + 100]
                writer.write_block(stream, start, run.sample_period_s, samples)
            writer.flush()
    os.truncate(path / 'cut_0.mcap', round(0.6 * (path / 'cut_0.mcap').stat().st_size))
    return path


def test_info_tells_streams_units_and_parameters(bag, command):
    code, out, err = command('info', bag)
    assert (code, err) == (0, '')
    run = read(bag)
    for stream in STREAMS:
        start, samples = run.whole(stream)
        line = next(line for line in out.splitlines() if line.startswith(f'  {stream} '))
        assert f'{samples.size} samples from index {start}' in line
        unit = {'um': 'um', 'v': 'V'}[STREAMS[stream]]
        assert line.endswith(f'{samples.min():.4g} … {samples.max():.4g} {unit}')
    assert f'duration       {run.samples * 1e-5:g} s' in out
    assert 'sample period  1e-05 s' in out
    assert 'parameters of  /compensator, /controller, /plant, /trajectory' in out
    assert [line.split()[1] for line in out.splitlines() if line.startswith('scheme')] == ['fbff']


def test_info_tells_when_the_bag_was_recorded(bag, command, tmp_path):
    def told(path):
        code, out, _ = command('info', path)
        assert code == 0
        (line,) = (line for line in out.splitlines() if line.startswith('recorded '))
        return line

    assert told(bag).startswith('recorded       no date: a simulation without a clock')
    dated = tmp_path / 'dated'
    shutil.copytree(bag, dated)
    metadata = yaml.safe_load((dated / 'metadata.yaml').read_text())
    metadata['rosbag2_bagfile_information']['starting_time'] = {
        'nanoseconds_since_epoch': 1_700_000_000_999_999_999}
    (dated / 'metadata.yaml').write_text(yaml.safe_dump(metadata))
    assert told(dated) == 'recorded       2023-11-14 22:13:20 UTC'


@pytest.mark.parametrize('text', [
    b'[' * 20_000,
    b'a0: &a0 [x, x]\n' + b''.join(
        b'a%d: &a%d [*a%d, *a%d]\n' % (n, n, n - 1, n - 1) for n in range(1, 40)),
], ids=['nested', 'aliases'])
def test_info_reads_a_bag_with_hostile_metadata(bag, command, tmp_path, text):
    hostile = tmp_path / 'hostile'
    shutil.copytree(bag, hostile)
    (hostile / 'metadata.yaml').write_bytes(text)
    code, out, err = command('info', hostile)
    assert code in (0, 3)
    assert 'recorded       no date' in out
    assert 'Traceback' not in err


def test_an_exported_table_holds_the_same_bits(bag, command, tmp_path):
    code, out, _ = command('export', bag, '-o', tmp_path / 'scan.csv')
    run = read(bag)
    assert code == 0
    assert f'{run.samples} samples' in out
    names = (tmp_path / 'scan.csv').read_text().splitlines()[0].split(',')
    assert names == ['time_s', *(f'{stream}_{unit}' for stream, unit in STREAMS.items())]
    table = np.loadtxt(tmp_path / 'scan.csv', delimiter=',', skiprows=1)
    for name, column in zip(names, table.T, strict=True):
        np.testing.assert_array_equal(column, getattr(run, name))


def test_a_table_is_not_overwritten_unasked(bag, command, tmp_path):
    table = tmp_path / 'scan.csv'
    table.write_text('years of work')
    code, _, err = command('export', bag, '-o', table)
    assert code == 2
    assert f'{table} exists; --force replaces it' in err
    assert table.read_text() == 'years of work'
    assert command('export', bag, '-o', table, '--force')[0] == 0
    assert table.read_text().startswith('time_s,')


def test_b5_an_export_that_fails_leaves_no_half_table(bag, command, tmp_path, monkeypatch):
    def fails(*_, **__):
        raise OSError('No space left on device')

    (tmp_path / 'out').mkdir()
    table = tmp_path / 'out' / 'scan.csv'
    table.write_text('years of work')
    monkeypatch.setattr(np, 'savetxt', fails)
    code, _, err = command('export', bag, '-o', table, '--force')
    assert code == 1
    assert 'No space left' in err
    assert table.read_text() == 'years of work'
    assert list(table.parent.iterdir()) == [table]


@pytest.mark.parametrize('action', ['info', 'export'])
def test_of_a_damaged_bag_what_is_whole_is_taken_unless_that_is_refused(
        damaged, command, tmp_path, action):
    output = ('-o', tmp_path / 'scan.csv') if action == 'export' else ()
    code, _, err = command(action, damaged, *output, '--no-allow-loss')
    assert code == 1
    assert 'is damaged' in err
    assert 'piezo bag salvage' in err
    code, out, err = command(action, damaged, *output)
    assert code == 3
    assert 'cut_0.mcap' in err
    assert 'samples' in out


def test_what_is_salvaged_is_a_bag_that_says_what_it_lost(damaged, command, tmp_path):
    code, out, err = command('salvage', damaged, '-o', tmp_path / 'whole')
    assert code == 3
    assert f'saved: {tmp_path / "whole"}' in out
    assert 'cut_0.mcap' in err
    for stream in STREAMS:
        (line,) = [line for line in out.splitlines() if line.startswith(f'/{stream} ')]
        assert int(line.split()[1]) > 0
    assert read(tmp_path / 'whole').samples > 0
    code, _, err = command('info', tmp_path / 'whole')
    assert code == 3
    assert 'cut_0.mcap' in err


def test_a_whole_bag_is_salvaged_without_loss(bag, command, tmp_path):
    code, _, err = command('salvage', bag, '-o', tmp_path / 'copy')
    assert (code, err) == (0, '')
    assert read(tmp_path / 'copy').samples == read(bag).samples
    code, _, err = command('salvage', bag, '-o', tmp_path / 'copy')
    assert code == 1
    assert 'never overwritten' in err


def test_the_namespace_chooses_the_rig(bag, command):
    assert command('info', bag, '--namespace', '/')[0] == 0
    code, _, err = command('info', bag, '--namespace', '/other')
    assert code == 1
    assert 'no stream in the namespace /other, choices are /' in err


@pytest.mark.parametrize('arguments', [
    ('info',), ('export', '-o', 'x.csv'), ('salvage', '-o', 'x')])
def test_a_bag_that_is_none_fails_in_words(command, tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    action, *output = arguments
    code, _, err = command(action, 'nothing', *output)
    assert code == 1
    assert 'nothing' in err


def test_a_motion_out_of_a_bag_is_played_again_bit_by_bit(bag, command, tmp_path):
    path = tmp_path / 'again.npz'
    code, out, _ = command('motion', bag, '--command', 'command', '-o', path)
    run = read(bag)
    assert code == 0
    assert f'{run.samples} samples' in out
    table = read_motion_table(path, run.sample_period_s)
    assert table.reference_um.tobytes() == run.reference_um.tobytes()
    assert table.command_um.tobytes() == run.command_um.tobytes()
    assert table.repeat_from is None
    assert command('motion', bag, '-o', path)[0] == 2
    code, _, _ = command(
        'motion', bag, '-o', path, '--force', '--reference', 'displacement', '--from-s', '0.001',
        '--to-s', '0.011', '--repeat-from-s', '0.002')
    part = read_motion_table(path, run.sample_period_s)
    assert code == 0
    assert part.reference_um.tobytes() == run.displacement_um[100:1100].tobytes()
    assert part.repeat_from == 100


@pytest.mark.parametrize(('options', 'problem'), [
    (('--from-s', '9'), 'has no sample from --from-s 9'),
    (('--repeat-from-s', '9'), 'repeat_from is 900000, allowed is 0 …'),
])
def test_a_motion_that_a_bag_has_not_is_refused(bag, command, tmp_path, options, problem):
    code, _, err = command('motion', bag, '-o', tmp_path / 'motion.npz', *options)
    assert code == 1
    assert problem in err
    assert not (tmp_path / 'motion.npz').exists()
    code, _, err = command('motion', bag, '-o', tmp_path / 'motion.csv')
    assert (code, 'a motion is written as .npz' in err) == (2, True)
