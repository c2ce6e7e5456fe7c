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

"""
A process that is held up for seconds, at any moment of a run.

No run is lost but by the watchdog, and no bag lacks anything.
"""

import os
import random
import signal
import time

import pytest

from piezo_ros.bag import STREAMS, read
from piezo_ros.parameters.node_parameters import NODE_PARAMETERS

HELD_S = 5.0
NODES = ('recorder', 'compensator', 'controller', 'plant', 'trajectory')
SAMPLES = 5000  # of 15 periods of 300 Hz


def _hold(rig, names, moment_s):
    """Hold one of the nodes up, at some moment after the first is there; return its name."""
    deadline = time.monotonic() + 60.0
    while not rig.nodes() and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(moment_s)
    for name in names:
        number = rig.nodes().get(name)
        if number is not None:
            try:
                os.kill(number, signal.SIGSTOP)
                time.sleep(HELD_S)
            finally:
                os.kill(number, signal.SIGCONT)
            return name
    return None  # all were over


def _assert_nothing_is_missing(bag, *, whole):
    run = read(bag)
    assert not run.lost
    # All that write a stream.
    assert {name.rpartition('/')[2] for name in run.parameters} == set(NODES) - {'recorder'}
    for name, values in run.parameters.items():
        sets = NODE_PARAMETERS[name.rpartition('/')[2]]
        assert set().union(*(one.names() for one in sets)) <= set(values), name
    assert run.metadata['scheme'] == 'fbff'
    assert run.streams == tuple(STREAMS)
    if whole:
        assert run.samples == SAMPLES


def _try(rig, write_plan, seed):
    draw = random.Random(seed)
    # Half of the trials with the watchdog's own patience, half with more than anybody is held up.
    watchdog_s = draw.choice([2.0, 60.0])
    plan = write_plan('fbff', periods=15, watchdog_s=watchdog_s)
    command = rig.piezo('run', plan, '-o', rig.directory / 'out', '--separate')
    names = draw.sample(NODES, len(NODES))
    moment_s = draw.uniform(0.0, 8.0)
    held = _hold(rig, names, moment_s)
    code = command.wait()
    how = f'{held} was held up {moment_s:.2f} s after the start: {command.output}'
    by_watchdog = (
        watchdog_s < HELD_S and code == 1 and 'no voltage for 2 s after sample' in command.output)
    assert code == 0 or by_watchdog, how
    assert not rig.nodes(), how
    assert 'Traceback' not in command.output
    if by_watchdog:
        # Another node was the one that did not answer.
        assert held not in (None, 'plant'), how
    if code == 0 or read(rig.bag).samples:
        _assert_nothing_is_missing(rig.bag, whole=code == 0)


@pytest.mark.slow  # In memory: test_running_time.py; in a process: test_waiting_activation.py.
@pytest.mark.parametrize('seed', [1])
def test_a_node_that_is_held_up_costs_nothing(rig, write_plan, seed):
    _try(rig, write_plan, seed)


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(100, 140))
def test_any_node_at_forty_moments(rig, write_plan, seed):
    _try(rig, write_plan, seed)


@pytest.mark.slow
def test_a_recorder_that_is_held_up_as_the_run_begins_has_all_parameters(launched, rig, until):
    """As three of three lost them: the time limit for the parameters ran while it stood still."""
    bag = rig.directory / 'bag'
    processes = launched(
        namespace=rig.namespace, record='true', bag_directory=str(bag), scheme='fbff')
    processes['recorder'].wait_for('run 1 begins')
    processes['recorder'].send(signal.SIGSTOP)
    time.sleep(HELD_S)
    processes['recorder'].send(signal.SIGCONT)
    assert processes['recorder'].wait() == 0
    _assert_nothing_is_missing(bag, whole=True)
    for name in processes:
        processes[name].send(signal.SIGINT)
    for name in processes:
        assert processes[name].wait() == 0, processes[name].output
