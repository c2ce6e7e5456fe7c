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
"""Two graphs of a raster scan, led together: what ends one, ends the other."""

from types import SimpleNamespace

import pytest

from piezo_ros.live import raster_rigs
from piezo_ros.live.raster_rigs import RasterRigs
from piezo_ros.parameters.errors import CampaignError
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult

AXES = ('fast', 'slow')


class FakeGraph:
    """A graph with a run that lasts some looks, and ends well or not."""

    def __init__(self, supervisor, directory, *, composed, progress):
        self.progress = progress
        self.looks, self.problem, self.dead = 3, '', False
        self.calls = []

    def __call__(self, planned, bag):
        self.progress(1.0)
        return RunResult(1.0)

    def start(self, planned, bag):
        self.calls.append('start')
        self.planned = planned
        return SimpleNamespace(
            over=lambda: self.looks <= 0, finished=lambda: self.looks <= 0 and not self.problem)

    def interrupted(self):
        return self.dead

    def follow(self, run):
        self.looks -= 1
        self.progress(1.0 - self.looks / 10.0)

    def end(self, run):
        self.calls.append('end')

    def kill(self):
        self.calls.append('kill')

    def result(self, run, bag):
        if self.problem or self.looks > 0:
            raise CampaignError(self.problem or 'the run ended after 5 of 10 samples')
        return RunResult(2.0)


@pytest.fixture
def rigs(monkeypatch, tmp_path):
    monkeypatch.setattr(raster_rigs, 'GraphPerRun', FakeGraph)
    monkeypatch.setattr(raster_rigs.time, 'sleep', lambda seconds: None)
    shares = []
    supervisor = SimpleNamespace(below=lambda name: SimpleNamespace(namespace=f'/scan/{name}'))
    made = RasterRigs(supervisor, tmp_path, AXES, progress=shares.append)
    planned = dict.fromkeys(AXES, PlannedRun('scan', {'trajectory': {'periods': 3.0}}))
    return SimpleNamespace(
        rigs=made, graphs=made._graphs, shares=shares,
        together=lambda: made.together(
            planned, {axis: tmp_path / 'scan' / axis for axis in AXES}))


def test_both_axes_go_on_until_both_are_over(rigs, tmp_path):
    rigs.graphs['slow'].looks = 7
    assert [result.wall_seconds for result in rigs.together()] == [2.0, 2.0]
    assert all(graph.calls == ['start', 'end', 'kill'] for graph in rigs.graphs.values())
    assert (tmp_path / 'scan').is_dir()
    # Of both axes the one that is behind is shown.
    assert rigs.shares == sorted(rigs.shares)


def test_each_axis_keeps_step_with_the_other(rigs):
    rigs.together()
    trajectories = {
        axis: graph.planned.parameters['trajectory'] for axis, graph in rigs.graphs.items()}
    assert trajectories == {
        'fast': {'periods': 3.0, 'lockstep_with': '../slow'},
        'slow': {'periods': 3.0, 'lockstep_with': '../fast'}}


@pytest.mark.parametrize(('how', 'problem'), [
    ({'dead': True, 'problem': 'plant was killed by SIGKILL'}, 'plant was killed by SIGKILL'),
    ({'looks': 1, 'problem': 'plant: watchdog'}, 'plant: watchdog')])
def test_what_fails_on_one_axis_ends_the_other_and_is_named(rigs, how, problem):
    rigs.graphs['fast'].looks = 10**6
    vars(rigs.graphs['slow']).update(how)
    with pytest.raises(CampaignError) as told:
        rigs.together()
    assert str(told.value) == f'slow axis: {problem}'
    assert rigs.graphs['fast'].calls == ['start', 'end', 'kill']


def test_a_graph_that_does_not_start_leaves_no_process_of_the_other(rigs):
    def refuse(planned, bag):
        raise CampaignError('stopped by SIGINT')

    rigs.graphs['slow'].start = refuse
    with pytest.raises(CampaignError, match='stopped by SIGINT'):
        rigs.together()
    assert rigs.graphs['fast'].calls == ['start', 'kill']


def test_learning_is_done_by_the_fast_axis_alone(rigs, tmp_path):
    assert rigs.rigs.alone(None, tmp_path).wall_seconds == 1.0
    assert not rigs.graphs['slow'].calls
    assert rigs.shares == [1.0]
