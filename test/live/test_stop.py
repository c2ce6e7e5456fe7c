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

"""Ctrl-C at any moment, and a killed supervisor: no process stays, every bag is readable."""

import json
import signal
import time

import pytest
from rosbags.rosbag2 import Reader

from piezo_ros.bag import STREAMS, read

KILL, TERM, INT, HUP = signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP


@pytest.mark.parametrize(('number', 'processes'), [
    (HUP, '--composed'),
    pytest.param(TERM, '--composed', marks=pytest.mark.slow),
    pytest.param(HUP, '--separate', marks=pytest.mark.slow),
    pytest.param(INT, '--separate', marks=pytest.mark.slow),
    pytest.param(TERM, '--separate', marks=pytest.mark.slow),
    pytest.param(INT, '--composed', marks=pytest.mark.slow)])
def test_a_run_that_is_stopped_leaves_a_readable_bag(
        rig, start_long, assert_whole, processes, number):
    command = start_long(processes)
    command.send(number)
    assert command.wait() == 1
    assert f'stopped by {number.name}; the voltage deviation is 0 V' in command.output
    assert not rig.nodes()
    run = read(rig.bag)
    assert_whole(run)
    assert not run.lost


# Seconds into start-up: interpreter, imports, first nodes, discovery, first samples. Which of them
# a moment meets depends on the machine; all of them must end alike.
@pytest.mark.parametrize('moment_s', [
    0.3, 1.2, 2.0, *(pytest.param(moment_s, marks=pytest.mark.slow) for moment_s in (
        0.05, 0.8, 1.6))])
def test_ctrl_c_at_any_moment_of_the_start_leaves_nothing_behind(
        rig, write_plan, moment_s):
    command = rig.piezo(
        'run', write_plan('fbff', periods=300), '-o', rig.directory / 'out', '--separate')
    time.sleep(moment_s)
    command.send(INT)
    # Python itself ends by the signal where it comes before the first line of the command.
    assert command.wait() in (1, -INT)
    assert not rig.nodes()
    if rig.bag.exists():
        _assert_readable_or_empty(rig.bag)


def _assert_readable_or_empty(bag):
    with Reader(bag) as reader:
        # Streams that were ended before they began have an end and no sample.
        if reader.message_count <= len(STREAMS):
            return
    assert not read(bag).lost


def test_ctrl_c_at_the_end_either_stops_the_run_or_lets_it_be_reported(
        rig, write_plan, until):
    command = rig.piezo(
        'run', write_plan('fbff', periods=1), '-o', rig.directory / 'out', '--composed')
    until(lambda: (rig.bag / 'metadata.yaml').exists(), 'the closed bag')
    command.send(INT)
    assert command.wait() in (0, 1)
    assert not rig.nodes()
    assert read(rig.bag).whole('displacement')[1].size == 334
    if command.exit_code == 0:
        assert json.loads((rig.directory / 'out' / 'report.json').read_text())['runs']


@pytest.mark.parametrize('processes', [
    pytest.param('--separate', marks=pytest.mark.slow), '--composed'])
def test_no_node_outlives_a_killed_supervisor(
        rig, start_long, assert_whole, until, processes):
    command = start_long(processes)
    assert rig.nodes()
    command.send(KILL)
    assert command.wait() == -KILL
    until(lambda: not rig.nodes(), 'every node to end')
    run = read(rig.bag)
    assert_whole(run)
    assert not run.lost
