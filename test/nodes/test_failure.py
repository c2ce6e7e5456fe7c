"""Whatever dies: the run ends, the voltage lands at zero, the bag is readable, nobody is left."""

import json
import os
import resource
import signal
import time

import numpy as np
import pytest
from rosbags.rosbag2 import Reader

from piezo_ros.bag import STREAMS, BagError, read

KILL, TERM, INT = signal.SIGKILL, signal.SIGTERM, signal.SIGINT
# Far more than any test waits for: 100 000 loops, or 10 million samples without feedback.
LONG = 300
FOREVER = 30_000

# who, how, in which graph
MATRIX = [
    ('recorder', KILL, '--separate'),
    ('compensator', KILL, '--separate'),
    ('controller', KILL, '--separate'),
    ('plant', KILL, '--separate'),
    ('trajectory', KILL, '--separate'),
    ('recorder', TERM, '--separate'),
    ('compensator', TERM, '--separate'),
    ('controller', TERM, '--separate'),
    ('plant', TERM, '--separate'),
    ('trajectory', TERM, '--separate'),
    ('recorder', KILL, '--composed'),
    ('loop', KILL, '--composed'),
    ('loop', TERM, '--composed'),
    ('loop', INT, '--composed'),
]


@pytest.fixture
def start(rig, write_plan, until):
    """Start a run that takes minutes; return its command once samples are on the disk."""
    def start(*options, periods=LONG):
        command = rig.piezo(
            'run', write_plan('fbff', periods=periods), '-o', rig.directory / 'out', *options)
        until(
            lambda: command.exit_code is not None or any(
                file.stat().st_size > 20_000 for file in _bag(rig).glob('*.mcap')),
            'the first samples on the disk')
        assert command.exit_code is None, command.output
        return command

    return start


def _bag(rig):
    return rig.directory / 'out' / 'bags' / '000_fbff_triangle_1um_300hz'


def _assert_whole(run):
    """Assert that every stream begins at 0; `read` refuses gaps."""
    assert run.streams == tuple(STREAMS)
    for stream in run.streams:
        start, samples = run.whole(stream)
        assert start == 0
        assert samples.size > 10


@pytest.mark.parametrize(
    ('victim', 'number', 'processes'), MATRIX,
    ids=[f'{victim}-{number.name}{processes}' for victim, number, processes in MATRIX])
def test_a_node_that_dies_ends_the_run_in_good_order(
        rig, start, until, victim, number, processes):
    command = start(processes, periods=LONG if processes == '--separate' else FOREVER)
    os.kill(rig.nodes(victim)[victim], number)
    assert command.wait() == 1
    how = 'was killed by SIGKILL' if number == KILL else f'was stopped: {number.name}'
    assert f'piezo: {victim} {how}' in command.output
    if victim not in ('plant', 'loop') or number != KILL:
        assert 'the voltage deviation is 0 V' in command.output
    assert 'Traceback' not in command.output
    assert not rig.nodes()
    for log in (rig.directory / 'out' / 'logs').rglob('*.log'):
        assert 'Traceback' not in log.read_text(), log
    run = read(_bag(rig))
    _assert_whole(run)
    if (victim, number) == ('recorder', KILL):
        assert run.lost
        assert 'the bag was not closed' in command.output
        with pytest.raises(BagError, match='not closed'):
            read(_bag(rig).with_name(f'{_bag(rig).name}.cut'))
    else:
        assert not run.lost
    assert run.metadata['scheme'] == 'fbff'
    assert len(run.parameters) == 4
    assert not (rig.directory / 'out' / 'report.json').exists()


@pytest.mark.parametrize('processes', ['--separate', '--composed'])
@pytest.mark.parametrize('number', [INT, TERM])
def test_a_run_that_is_stopped_leaves_a_readable_bag(rig, start, processes, number):
    command = start(processes, periods=LONG if processes == '--separate' else FOREVER)
    command.send(number)
    assert command.wait() == 1
    assert f'stopped by {number.name}; the voltage deviation is 0 V' in command.output
    assert not rig.nodes()
    run = read(_bag(rig))
    _assert_whole(run)
    assert not run.lost


# Seconds into start-up: interpreter, imports, first nodes, discovery, first samples. Which of them
# a moment meets depends on the machine; all of them must end alike.
@pytest.mark.parametrize('moment_s', [0.05, 0.3, 0.8, 1.2, 1.6, 2.0])
def test_ctrl_c_at_any_moment_of_the_start_leaves_nothing_behind(
        rig, write_plan, until, moment_s):
    command = rig.piezo(
        'run', write_plan('fbff', periods=LONG), '-o', rig.directory / 'out', '--separate')
    time.sleep(moment_s)
    command.send(INT)
    # Python itself ends by the signal where it comes before the first line of the command.
    assert command.wait() in (1, -INT)
    assert not rig.nodes()
    if _bag(rig).exists():
        _assert_readable_or_empty(_bag(rig))


def _assert_readable_or_empty(bag):
    with Reader(bag) as reader:
        if reader.message_count == 0:
            return
    assert not read(bag).lost


def test_ctrl_c_at_the_end_either_stops_the_run_or_lets_it_be_reported(
        rig, write_plan, until):
    command = rig.piezo(
        'run', write_plan('fbff', periods=1), '-o', rig.directory / 'out', '--separate')
    until(lambda: (_bag(rig) / 'metadata.yaml').exists(), 'the closed bag')
    command.send(INT)
    assert command.wait() in (0, 1)
    assert not rig.nodes()
    assert read(_bag(rig)).whole('displacement')[1].size == 334
    if command.exit_code == 0:
        assert json.loads((rig.directory / 'out' / 'report.json').read_text())['runs']


@pytest.mark.parametrize('processes', ['--separate', '--composed'])
def test_no_node_outlives_a_killed_supervisor(rig, start, until, processes):
    command = start(processes, periods=LONG if processes == '--separate' else FOREVER)
    assert rig.nodes()
    command.send(KILL)
    assert command.wait() == -KILL
    until(lambda: not rig.nodes(), 'every node to end')
    run = read(_bag(rig))
    _assert_whole(run)
    assert not run.lost
    assert np.isfinite(run.displacement_um).all()


def test_a_full_disk_ends_the_run_and_keeps_what_was_flushed(rig, start):
    command = start('--separate')
    _limit_file_size(rig.nodes('recorder')['recorder'], 100_000)
    assert command.wait() == 1
    assert 'piezo: recorder failed' in command.output
    assert 'the voltage deviation is 0 V' in command.output
    assert not rig.nodes()
    run = read(_bag(rig))
    _assert_whole(run)


def _limit_file_size(process, size):
    """Let a file of a running process grow no more: as a full disk, but for the error's number."""
    resource.prlimit(process, resource.RLIMIT_FSIZE, (size, size))
