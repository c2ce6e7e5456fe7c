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

"""Whatever dies: the run ends, the voltage lands at 0, the bag is readable, no process is left."""

import os
import re
import resource
import signal

import pytest

from piezo_ros.bag import BagError, read

KILL, TERM = signal.SIGKILL, signal.SIGTERM
# Victim, signal, graph: of each kind of graph and of signal one, all of them with the slow ones.
QUICK = [
    ('recorder', KILL, '--composed'),
    ('controller', TERM, '--separate'),
    ('loop', KILL, '--composed'),
]
MATRIX = [
    *QUICK,
    ('recorder', KILL, '--separate'),
    ('plant', KILL, '--separate'),
    ('compensator', KILL, '--separate'),
    ('controller', KILL, '--separate'),
    ('trajectory', KILL, '--separate'),
    ('recorder', TERM, '--separate'),
    ('compensator', TERM, '--separate'),
    ('plant', TERM, '--separate'),
    ('trajectory', TERM, '--separate'),
    ('loop', TERM, '--composed'),
]


@pytest.mark.parametrize(('victim', 'number', 'processes'), [
    pytest.param(
        *trial, id='{}-{.name}{}'.format(*trial), marks=() if trial in QUICK else pytest.mark.slow)
    for trial in MATRIX])
def test_a4_a_node_that_dies_ends_the_run_in_good_order(
        rig, start_long, assert_whole, victim, number, processes):
    command = start_long(processes)
    os.kill(rig.nodes(victim)[victim], number)
    assert command.wait() == 1
    how = 'was killed by SIGKILL' if number == KILL else f'was stopped: {number.name}'
    assert f'piezo: {victim} {how}' in command.output
    if victim not in ('plant', 'loop') or number != KILL:
        assert 'the voltage deviation is 0 V' in command.output
    else:
        # A4: what it said last is not what it left behind.
        assert re.search(
            r'the voltage is unknown: the last that the plant said is \S+ V at sample \d+',
            command.output)
        assert 'the voltage deviation' not in command.output
    assert 'Traceback' not in command.output
    assert not rig.nodes()
    for log in (rig.directory / 'out' / 'logs').rglob('*.log'):
        assert 'Traceback' not in log.read_text(), log
    run = read(rig.bag)
    assert_whole(run)
    if (victim, number) == ('recorder', KILL):
        assert run.lost
        assert 'the bag was not closed' in command.output
        with pytest.raises(BagError, match='not closed'):
            read(rig.bag.with_name(f'{rig.bag.name}.cut'))
    else:
        assert not run.lost
    assert run.metadata['scheme'] == 'fbff'
    assert len(run.parameters) == 4
    assert not (rig.directory / 'out' / 'report.json').exists()


def test_a_full_disk_ends_the_run_and_keeps_what_was_flushed(rig, start_long, assert_whole):
    command = start_long('--composed')
    _limit_file_size(rig.nodes('recorder')['recorder'], 100_000)
    assert command.wait() == 1
    assert 'piezo: recorder failed' in command.output
    assert 'File too large' in command.output
    assert 'the voltage deviation is 0 V' in command.output
    assert not rig.nodes()
    run = read(rig.bag)
    assert_whole(run)


def _limit_file_size(process, size):
    """Let a file of a running process grow no more: as a full disk, but for the error's number."""
    resource.prlimit(process, resource.RLIMIT_FSIZE, (size, size))
