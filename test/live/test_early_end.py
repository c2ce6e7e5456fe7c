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

"""A process that ends well before its run is named at once: its peers would wait for it."""

import signal
from types import SimpleNamespace

import pytest

from piezo_ros.live.graph_per_run import LiveRun
from piezo_ros.live.kept_graph import KeptGraph
from piezo_ros.live.process_group import ProcessGroup
from piezo_ros.parameters.run_and_result import PlannedRun

NODES = ('compensator', 'controller', 'plant', 'trajectory')
PARAMETERS = {node: {'output': 'position'} for node in NODES}
WAITING = {'state': 'inactive', 'reason': '', 'by_peer': False, 'index': 0}


class Rig:
    """A supervised run, of which some processes have ended with exit codes."""

    def __init__(self, names=('recorder', *NODES)):
        self.codes = dict.fromkeys(names)
        self.statuses = {}
        self.under_way = {}  # statuses that have come and are not taken yet
        self.processes = ProcessGroup()
        self.processes._processes = {
            name: SimpleNamespace(
                poll=lambda name=name: self.codes[name], send_signal=lambda number: None)
            for name in names}
        self.run = LiveRun(self, PlannedRun('run', PARAMETERS))

    def take_statuses(self):
        self.statuses.update(self.under_way)

    def say(self, statuses=None, /, **states):
        for node, state in states.items():
            (self.statuses if statuses is None else statuses)[node] = {
                **WAITING, 'node': node, 'state': state}


@pytest.fixture
def rig():
    return Rig()


@pytest.mark.parametrize('states', [
    {'compensator': 'inactive', 'plant': 'active'}, {'compensator': 'unconfigured'},
    {'controller': 'inactive'}])  # and not a word of the one that has ended
def test_a_node_that_ends_before_its_run_is_named(rig, states):
    rig.say(**states)
    rig.codes['compensator'] = 0
    assert rig.processes.dead()
    assert rig.run.problems(stopped=False)[0] == (
        'compensator ended before its run (exit code 0)')


def test_the_reason_that_it_gave_is_told(rig):
    rig.say(compensator='inactive')
    rig.statuses['compensator']['reason'] = 'stopped while waiting for the peers'
    rig.codes['compensator'] = 0
    assert rig.run.problems(stopped=False) == [
        'compensator ended before its run (exit code 0): stopped while waiting for the peers']


@pytest.mark.parametrize('states', [
    {'compensator': 'active'}, {'compensator': 'finished'},
    {'controller': 'finished', 'plant': 'inactive'}, {}])
def test_one_that_had_begun_or_of_which_nothing_is_known_is_not_blamed(rig, states):
    rig.say(**states)
    rig.codes['compensator'] = 0
    assert not rig.processes.dead()


def test_what_it_said_last_counts_although_it_was_not_taken_yet(rig):
    rig.say(compensator='inactive')
    rig.say(rig.under_way, compensator='finished')
    rig.codes['compensator'] = 0
    assert not rig.processes.dead()


def test_a_recorder_that_ends_before_its_run_is_named(rig):
    rig.say(recorder='inactive', plant='active')
    rig.codes['recorder'] = 0
    assert rig.processes.dead()


def test_a_composed_loop_has_begun_with_any_of_its_nodes():
    rig = Rig(('recorder', 'loop'))
    rig.codes['loop'] = 0
    rig.say(recorder='inactive')
    rig.say(**dict.fromkeys(NODES, 'inactive'))
    assert rig.processes.dead()
    rig.processes.blamed.clear()
    rig.say(trajectory='active')
    assert not rig.processes.dead()


def test_one_that_was_told_to_end_is_not_blamed(rig):
    rig.say(**dict.fromkeys(NODES, 'inactive'))
    for name, process in rig.processes._processes.items():
        process.send_signal = lambda number, name=name: rig.codes.update({name: 0})
    rig.processes.stop()
    assert not rig.processes.dead()


def test_a_death_is_blamed_once_for_how_it_was(rig):
    rig.codes['plant'] = -signal.SIGKILL
    assert rig.processes.dead()
    assert rig.processes.dead()
    assert rig.processes.blamed == {'plant': -signal.SIGKILL}


def test_no_node_of_a_kept_graph_ends_by_itself(tmp_path, monkeypatch):
    rig = Rig(('recorder', 'loop'))
    rig.arguments = []
    monkeypatch.setattr(rig.processes, 'start', lambda *arguments: None)
    KeptGraph(rig, tmp_path)
    rig.codes['loop'] = 0
    rig.say(recorder='active')
    assert rig.processes.dead()
    rig.processes.blamed.clear()
    rig.say(plant='stopped')
    assert not rig.processes.dead()
