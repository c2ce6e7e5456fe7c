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

import csv
import dataclasses
import json
import multiprocessing
import os
import signal
import sys
import threading
import time
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from piezo_ros.bag import read
from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.plan import read_plan
from piezo_ros.experiment.sweep.drawn_runs import DrawnRuns
from piezo_ros.experiment.sweep.engines import dask_engine, local_engine
from piezo_ros.experiment.sweep.run_sweep import open_sweep, run_sweep
from piezo_ros.experiment.sweep.sweep_plan import read_sweep
from piezo_ros.experiment.sweep.sweep_report import write_sweep_report
from piezo_ros.experiment.sweep.sweep_table import summary_table
from piezo_ros.experiment.sweep.work import SweepWork, do_runs, run_directory
from piezo_ros.parameters.errors import CampaignError, PlanError
from piezo_ros.report import score

PLAN = """\
format_version: 1
runs: [{scheme: [ff, fbff], periods: PERIODS}]
sweep:
  draws: DRAWS
  parameters:
    plant.gain_mismatch: {normal: [0.0, 0.02]}
    plant.kappa_um_per_v: {each_times: {uniform: [0.95, 1.05]}}
    plant.seed: {integers: [1, 1000]}
"""


def in_process(work, batches, take):
    for batch in batches:
        take(do_runs(work, batch))


@pytest.fixture
def write(tmp_path):
    def write(text=PLAN, draws=4, periods=5):
        path = tmp_path / 'plan.yaml'
        path.write_text(text.replace('DRAWS', str(draws)).replace('PERIODS', str(periods)))
        return path
    return write


@pytest.fixture
def prepare(write, tmp_path):
    def prepare(keep_bags=False, force=False, **options):
        path = write(**options)
        plan = read_sweep(read_plan(path))
        directory = tmp_path / 'out'
        open_sweep(plan, path, directory, force=force)
        return SweepWork(plan, str(directory), keep_bags)
    return prepare


def without_times(results):
    return [{**result, 'seconds': None} for result in results]


def table_of(path):
    if path.suffix == '.csv':
        return list(csv.DictReader(path.open()))
    parquet = pytest.importorskip('pyarrow.parquet')
    return parquet.read_table(path).to_pylist()


def test_every_run_of_the_plan_is_done_for_every_draw(prepare):
    work = prepare(keep_bags=True)
    seen = []
    sweep = run_sweep(work, in_process, workers=1, progress=lambda *state: seen.append(state))
    assert seen[0] == (0, 8)
    assert seen[-1] == (8, 8)
    assert [result['draw'] for result in sweep.results] == [0, 0, 1, 1, 2, 2, 3, 3]
    assert [result['scheme'] for result in sweep.results] == ['ff', 'fbff'] * 4
    gains = [result['plant.gain_mismatch'] for result in sweep.results]
    assert gains[::2] == gains[1::2]
    assert len(set(gains)) == 4
    assert not sweep.failed
    for result in sweep.results:
        # The same as a single run with these parameters, recorded, read and scored.
        run = read(run_directory(work.directory, result['number']) / 'bag')
        assert run.parameters['/plant']['gain_mismatch'] == result['plant.gain_mismatch']
        assert run.parameters['/plant']['kappa_um_per_v'] == result['plant.kappa_um_per_v']
        scored = score(run, bag='', wall_seconds=0.0)
        assert scored.nrmse_percent == result['nrmse_percent']
        assert scored.max_error_um == result['max_error_um']
    rows = table_of(sweep.table)
    assert [float(row['nrmse_percent']) for row in rows] == [
        result['nrmse_percent'] for result in sweep.results]
    assert json.loads(rows[0]['plant.kappa_um_per_v']) == sweep.results[0]['plant.kappa_um_per_v']
    median = np.median([result['nrmse_percent'] for result in sweep.results[::2]])
    lines = summary_table(sweep.results).splitlines()
    assert lines[1].startswith('ff triangle 1 um 300 Hz m = 9')
    assert f'{median:.3f}' in lines[1]


def test_without_pyarrow_the_table_is_csv(prepare, monkeypatch):
    monkeypatch.setitem(sys.modules, 'pyarrow', None)
    sweep = run_sweep(prepare(), in_process, workers=1)
    assert sweep.table.name == 'results.csv'
    assert [row['name'] for row in table_of(sweep.table)] == [
        result['name'] for result in sweep.results]


def test_an_interrupted_sweep_goes_on_where_it_was(prepare):
    work = prepare()

    def interrupted(work, batches, take):
        take(do_runs(work, batches[0]))
        run_directory(work.directory, 5).mkdir(parents=True)  # of a worker that was killed
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep(work, interrupted, workers=1)
    done = [path.parent.name for path in sorted(Path(work.directory).rglob('run.json'))]
    stamps = {name: (Path(work.directory) / 'runs' / name / 'run.json').stat().st_mtime_ns
              for name in done}
    sweep = run_sweep(work, in_process, workers=1)
    assert sweep.resumed == len(done) > 0
    for name, stamp in stamps.items():
        assert (Path(work.directory) / 'runs' / name / 'run.json').stat().st_mtime_ns == stamp
    again = run_sweep(work, in_process, workers=1)
    assert again.resumed == 8
    assert again.results == sweep.results


def test_draws_can_be_added_and_nothing_else_changed(prepare, tmp_path):
    few = run_sweep(prepare(draws=2), in_process, workers=1)
    more = run_sweep(prepare(draws=3), in_process, workers=1)
    assert more.resumed == 4
    assert more.results[:4] == few.results
    with pytest.raises(PlanError, match='another plan'):
        prepare(periods=6)
    prepare(periods=6, force=True)
    assert not list((tmp_path / 'out').rglob('run.json'))


def test_a_run_that_fails_is_told_and_the_others_go_on(prepare):
    # The rails are above the operating point for some draws.
    text = PLAN.replace('plant.seed: {integers: [1, 1000]}',
                        'plant.operating_point_v: {choice: [5.0, 11.0]}')
    sweep = run_sweep(prepare(text=text, draws=8), in_process, workers=1)
    bad = [result['plant.operating_point_v'] == 11.0 for result in sweep.results]
    assert 0 < sum(bad) < 16
    assert [bool(result['error']) for result in sweep.results] == bad
    assert 'operating_point_v is 11.0' in sweep.failed[0]['error']
    assert len(table_of(sweep.table)) == 16


@pytest.mark.parametrize(('change', 'message'), [
    (('DRAWS', '0'), 'draws of sweep is 0, it must be an integer in 1'),
    (('draws: DRAWS', 'drawn: 1'), "unknown key 'drawn' of sweep"),
    (('plant.seed', 'plant.sead'), "'plant.sead' is no parameter of compensator, controller"),
    (('integers', 'integer'), "sweep of plant.seed: 'integer' is no distribution"),
    (('plant.seed: {integers: [1, 1000]}', 'trajectory.periods: {uniform: [8, 9]}'),
     'periods is given by a run and drawn by the sweep'),
    (('plant.seed: {integers: [1, 1000]}', 'plant.noise_rms_um: {choice: [-1]}'),
     'noise_rms_um is -1'),
    (('scheme: [ff, fbff]', 'output: voltage'), 'follows no reference'),
    (('sweep:', 'sweep: 1\nx:'), 'unknown key'),
])
def test_a_wrong_sweep_is_refused_before_anything_starts(write, change, message):
    text = PLAN.replace(*change)
    with pytest.raises(PlanError, match=message) as refusal:
        read_sweep(read_plan(write(text=text)))
    assert 'plan.yaml' in str(refusal.value)


def test_a_plan_without_a_sweep_is_refused(write):
    with pytest.raises(PlanError, match='has no key sweep'):
        read_sweep(read_plan(write(text=PLAN.partition('sweep:')[0])))


def test_processes_give_the_same_results_as_one(prepare, tmp_path):
    work = prepare(draws=10)
    alone = run_sweep(
        dataclasses.replace(work, directory=str(tmp_path / 'alone')), in_process, workers=1)
    shared = run_sweep(work, local_engine(2), workers=2)
    assert without_times(shared.results) == without_times(alone.results)
    assert not multiprocessing.active_children()


def running(directory):
    """Directories of the runs that have begun and are not done."""
    return [
        path for path in (Path(directory) / 'runs').iterdir()
        if not (path / 'run.json').exists()]


def check_what_a_killed_worker_costs(work, engine, kill):
    """Kill a worker in the middle of its work; only that is done again."""
    at_work, marks = set(), []

    def strike():
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline:
            # The finished ones first: a run that ends between the looks is not one of them.
            finished = list(Path(work.directory).rglob('run.json'))
            now = running(work.directory)
            if len(now) == 2 and finished:
                at_work.update(now)
                # A run that is begun again begins in an empty directory.
                marks.extend(
                    path / 'begun_before_the_kill'
                    for path in (Path(work.directory) / 'runs').iterdir())
                for mark in marks:
                    mark.touch()
                # Also one that has begun since the first look.
                at_work.update(running(work.directory))
                kill()
                return
            time.sleep(0.001)

    (Path(work.directory) / 'runs').mkdir()
    striker = threading.Thread(target=strike)
    striker.start()
    sweep = run_sweep(work, engine, workers=2)
    striker.join()
    assert marks, 'there was no worker to kill'
    assert [result['number'] for result in sweep.results] == list(range(work.plan.runs))
    assert not sweep.failed
    assert {mark.parent for mark in marks} - at_work, 'no finished run was there'
    begun_again = [mark.parent for mark in marks if not mark.exists()]
    # The run of the killed worker; it may have come to its end in the last moment.
    assert len(begun_again) <= 1
    assert at_work.issuperset(begun_again)


def test_a_killed_process_costs_only_what_it_was_doing(prepare):
    work = prepare(draws=4, periods=12_000)
    check_what_a_killed_worker_costs(
        work, local_engine(2),
        lambda: os.kill(multiprocessing.active_children()[0].pid, signal.SIGKILL))


DEADLY = """\
import os
import signal

from piezo_ros.experiment.sweep.work import do_runs


def deadly(work, numbers):
    if 3 in numbers:
        os.kill(os.getpid(), signal.SIGKILL)
    return do_runs(work, numbers)
"""


def test_runs_that_end_their_worker_every_time_are_given_up_and_the_others_done(
        prepare, monkeypatch, tmp_path):
    # In a module of its own, where the worker finds it too.
    (tmp_path / 'deadly_runs.py').write_text(DEADLY)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(
        'piezo_ros.experiment.sweep.engines.do_runs', import_module('deadly_runs').deadly)
    work = prepare(draws=3)
    with pytest.raises(CampaignError, match=r'runs 3 … 3 ended their worker 3 times'):
        run_sweep(work, local_engine(2), workers=2)
    assert len(list(Path(work.directory).rglob('run.json'))) == 5


class TestDask:
    @pytest.fixture(scope='class')
    def cluster(self):
        distributed = pytest.importorskip('distributed')
        with distributed.LocalCluster(
                n_workers=2, threads_per_worker=1, processes=True,
                dashboard_address=None) as cluster:
            yield cluster

    def test_a_cluster_of_its_own_gives_the_same_results_as_one_process(self, prepare, tmp_path):
        pytest.importorskip('distributed')
        work = prepare(draws=10)
        alone = run_sweep(
            dataclasses.replace(work, directory=str(tmp_path / 'alone')), in_process, workers=1)
        shared = run_sweep(work, dask_engine(2), workers=2)
        assert without_times(shared.results) == without_times(alone.results)

    @pytest.mark.slow
    def test_a_killed_worker_of_a_given_cluster_costs_only_what_it_was_doing(
            self, cluster, prepare):
        work = prepare(draws=6, periods=6000)
        check_what_a_killed_worker_costs(
            work, dask_engine(2, cluster.scheduler_address),
            lambda: os.kill(cluster.workers[0].pid, signal.SIGKILL))


def test_scores_alone_are_those_of_the_runs_with_directories(prepare, tmp_path):
    kept = run_sweep(prepare(), in_process, workers=1)
    work = prepare(force=True)
    scored = run_sweep(dataclasses.replace(work, scores_only=True), in_process, workers=1)
    assert without_times(scored.results) == without_times(kept.results)
    assert not (tmp_path / 'out' / 'runs').exists()
    assert table_of(scored.table)[3]['name'] == kept.results[3]['name']


def test_scores_alone_go_on_behind_a_torn_line(prepare, tmp_path):
    work = dataclasses.replace(prepare(draws=2), scores_only=True)
    few = run_sweep(work, in_process, workers=1)
    file = tmp_path / 'out' / 'scores.jsonl'
    file.write_text(file.read_text()[:-30])  # of the last of the four runs
    more = run_sweep(dataclasses.replace(prepare(draws=3), scores_only=True), in_process, workers=1)
    assert more.resumed == 3
    assert without_times(more.results[:4]) == without_times(few.results)
    assert run_sweep(work, in_process, workers=1).resumed == 4


def outcome(make):
    """Return what a function returns, and the words of its refusal."""
    try:
        return make(), ''
    except PlanError as error:
        return None, str(error)


@pytest.mark.parametrize('drawn', [
    'plant.slew_limit_v_per_s: {uniform: [50.0, 5000.0]}',
    'controller.integral_gain_per_s: {times: {uniform: [0.5, 2.0]}}',
    'compensator.saturation_v: {each_times: {normal: [1.0, 0.01]}}',
    'trajectory.amplitude_um: {uniform: [0.5, 2.0]}',
    'trajectory.amplitude_um: {choice: [1.0, 99.0]}',  # beyond the travel
    'controller.scheme: {choice: [fb, fbff]}',
    'trajectory.block_samples: {integers: [1, 100]}',  # of no model
])
def test_a_drawn_run_is_that_of_the_plan(write, drawn):
    plan = read_sweep(read_plan(write(
        PLAN.replace('scheme: [ff, fbff], ', '').replace(
            'plant.seed: {integers: [1, 1000]}', drawn), draws=4)))
    runs = DrawnRuns(plan)
    for number in range(plan.runs):
        expected, refusal = outcome(lambda number=number: plan.run(number))
        drawn, other = outcome(lambda number=number: runs.run(number, plan.drawn(number)))
        assert other == refusal
        if refusal:
            continue
        name, planned = drawn
        assert name == expected.name
        assert planned.parameters == expected.parameters
        for node in ('plant', 'compensator', 'controller', 'trajectory'):
            assert getattr(planned, node) == getattr(expected, node)


def test_the_plan_of_a_worst_draw_gives_its_score_again(prepare, tmp_path):
    work = prepare(draws=3)
    sweep = run_sweep(dataclasses.replace(work, scores_only=True), in_process, workers=1)
    report = write_sweep_report(tmp_path / 'out', work.plan, sweep)
    worst = max(sweep.results, key=lambda result: result['nrmse_percent'])
    (run,) = read_plan(tmp_path / 'out' / 'worst' / f'{worst["number"]:06d}.yaml').runs
    simulate_run(run, tmp_path / 'bag')
    assert score(read(tmp_path / 'bag'), bag='', wall_seconds=0.0).nrmse_percent == (
        worst['nrmse_percent'])
    assert f'worst/{worst["number"]:06d}.yaml' in report.read_text()
