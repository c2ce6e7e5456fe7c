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

"""The engines of a sweep: processes of this machine, and Dask."""

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, Final

from piezo_ros.experiment.sweep.work import Engine, SweepWork, do_runs
from piezo_ros.matrix_threads import ONE_THREAD
from piezo_ros.parameters.errors import CampaignError

__all__ = ['dask_engine', 'local_engine']

_MOST_ATTEMPTS: Final = 3  # of a batch, where its worker is killed each time

_Batch = Sequence[int]
_Take = Callable[[Sequence[Mapping[str, Any]]], None]


def local_engine(workers: int) -> Engine:
    """
    Return an engine of processes of this machine.

    Parameters
    ----------
    workers : int
        Number of processes.

    """
    def engine(work: SweepWork, batches: Sequence[_Batch], take: _Take) -> None:
        before = set(multiprocessing.active_children())
        pool = _Pool(min(workers, len(batches)), work)
        try:
            pool.do(batches, take)
            pool.close()
        except BaseException:
            # No result is wanted any more.
            for child in set(multiprocessing.active_children()) - before:
                child.kill()
            raise
    return engine


class _Pool:
    """
    Executors of one process each.

    An executor of several ends all of its processes when one of them is killed; of these, only the
    one that is killed loses what it was doing.
    """

    def __init__(self, workers: int, work: SweepWork) -> None:
        self._work = work
        self._executors = [_executor() for _ in range(workers)]

    def do(self, batches: Sequence[_Batch], take: _Take) -> None:
        waiting = deque((batch, 1) for batch in batches)
        running: dict[Future[list[dict[str, Any]]], tuple[int, _Batch, int]] = {}
        idle = list(range(len(self._executors)))
        given_up: list[_Batch] = []
        while waiting or running:
            while idle and waiting:
                place = idle.pop()
                batch, attempt = waiting.popleft()
                running[self._submit(place, batch)] = (place, batch, attempt)
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                place, batch, attempt = running.pop(future)
                idle.append(place)
                try:
                    take(future.result())
                except BrokenProcessPool:
                    self._renew(place)
                    if attempt < _MOST_ATTEMPTS:
                        waiting.append((batch, attempt + 1))
                    else:
                        given_up.append(batch)
        if given_up:
            raise CampaignError(
                f'the runs {given_up[0][0]} … {given_up[0][-1]} ended their worker '
                f'{_MOST_ATTEMPTS} times (out of memory?)')

    def _submit(self, place: int, batch: _Batch) -> Future[list[dict[str, Any]]]:
        # The first task starts the process. There is one for each core already.
        with _environment(ONE_THREAD):
            try:
                return self._executors[place].submit(do_runs, self._work, batch)
            except BrokenProcessPool:  # killed while it had nothing to do
                self._renew(place)
                return self._executors[place].submit(do_runs, self._work, batch)

    def _renew(self, place: int) -> None:
        self._executors[place].shutdown()
        self._executors[place] = _executor()

    def close(self) -> None:
        for executor in self._executors:
            executor.shutdown()


def _executor() -> ProcessPoolExecutor:
    # Not forked: threads of libraries do not survive that.
    return ProcessPoolExecutor(
        1, mp_context=multiprocessing.get_context('spawn'), initializer=_prepare_worker)


@contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    """Set variables for the processes that are started meanwhile."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _prepare_worker() -> None:
    """Let a Ctrl-C end the worker without a word; the command says what is to be said."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def dask_engine(workers: int, scheduler: str = '') -> Engine:
    """
    Return an engine that is a Dask cluster.

    Parameters
    ----------
    workers : int
        Number of worker processes to start on this machine, where there is no scheduler.
    scheduler : str, optional
        Address of the scheduler of a cluster that is there already, such as
        ``tcp://127.0.0.1:8786``. Its workers need this package and must see the output directory
        by the same path.

    Raises
    ------
    ImportError
        If Dask is not installed.

    """
    import distributed

    def engine(work: SweepWork, batches: Sequence[_Batch], take: _Take) -> None:
        if scheduler:
            with distributed.Client(scheduler) as client:
                _compute(client, work, batches, take)
            return
        with distributed.LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True,
                dashboard_address=None) as cluster, distributed.Client(cluster) as client:
            _compute(client, work, batches, take)

    return engine


def _compute(client: Any, work: SweepWork, batches: Sequence[_Batch], take: _Take) -> None:
    import distributed
    shared = client.scatter(work, broadcast=True)
    futures = client.map(
        lambda batch, work: do_runs(work, batch), list(batches), work=shared, pure=False)
    try:
        for _, records in distributed.as_completed(futures, with_results=True):
            take(records)
    except distributed.KilledWorker as error:
        raise CampaignError(f'Dask gave some runs up: {error}') from None
    except (OSError, RuntimeError) as error:
        raise CampaignError(f'a Dask worker failed: {error}') from None
