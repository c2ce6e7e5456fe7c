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

"""Costs of a live graph: time to start, memory, processor time while idle, time to answer."""

import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

from rcl_interfaces.srv import GetParameters

from piezo_ros.live.run_parameters import run_parameters
from piezo_ros.live.supervisor import Supervisor
from piezo_ros.parameters.errors import CampaignError
from piezo_ros.parameters.run_and_result import PlannedRun

__all__ = ['Footprint', 'footprint', 'service_latency_ms', 'start_beside_peers_s']

_TIMEOUT_S: Final = 60.0
_IDLE_S: Final = 3.0
_DISCOVERY_S: Final = 1.0
_AFTER_RUN_S: Final = 1.0  # within which the work at the end of a run is done
_CALLS: Final = 100
_CALL_TIMEOUT_S: Final = 5.0
_QUANTILES: Final = 20  # the last cut is the 95th percentile
_UP: Final = ('active', 'finished')


class Footprint(NamedTuple):
    """
    Costs of a graph of four processes.

    Attributes
    ----------
    start_s : float
        Seconds from the start of the first process until all are active.
    rss_mb : float
        Resident memory after a run, MB: the sum over the processes, in which a page that several
        processes share counts once for each of them.
    pss_mb : float
        Proportional memory after a run, MB: the same sum, but a page that n processes of the
        machine share counts as 1/n in each.
    idle_percent : float
        Processor time of the busiest process after the run, percent of a core.

    """

    start_s: float
    rss_mb: float
    pss_mb: float
    idle_percent: float


class _Graph:
    """The nodes of a run as processes that stay alive after it."""

    def __init__(
        self, supervisor: Supervisor, directory: Path, planned: PlannedRun, *, composed: bool,
    ) -> None:
        self._supervisor = supervisor
        self._directory = directory
        self.processes = supervisor.processes
        self.names = ('loop',) if composed else planned.nodes
        self._arguments = supervisor.write_parameters(directory / 'parameters.yaml', run_parameters(
            planned, directory / 'bag', record=False, autostart=True,
            compiled=planned.nodes if composed else ()))

    def start(self, *names: str) -> None:
        """Start the processes of some executables."""
        for name in names:
            self.processes.start(name, self._arguments, self._directory / f'{name}.log')

    def wait(self, condition: Callable[[], bool], what: str) -> None:
        """Take in the status of the nodes until a condition is met."""
        if not self._supervisor.spin_until(condition, timeout_s=_TIMEOUT_S):
            raise CampaignError(f'waited {_TIMEOUT_S:g} s for {what}')

    @property
    def states(self) -> dict[str, str]:
        """The state of every node that has said so."""
        return {node: status['state'] for node, status in self._supervisor.statuses.items()}

    def up(self, *nodes: str) -> bool:
        """Return whether all of these nodes are active or have finished."""
        return all(self.states.get(node) in _UP for node in nodes)

    def latency_s(self, node: str, calls: int) -> list[float]:
        """Return the time that each call for a parameter of a node takes, seconds."""
        client = self._supervisor.create_client(GetParameters, f'{node}/get_parameters')
        self.wait(client.service_is_ready, f'the parameters of {node}')
        # A server that has not discovered its client yet drops the answer.
        time.sleep(_DISCOVERY_S)
        seconds = []
        for _ in range(calls):
            start = time.perf_counter()
            future = client.call_async(GetParameters.Request(names=['sample_period_s']))
            while not future.done() and time.perf_counter() - start < _CALL_TIMEOUT_S:
                self._supervisor.spin_once(_CALL_TIMEOUT_S)
            if not future.done():
                raise CampaignError(f'{node} did not answer within {_CALL_TIMEOUT_S:g} s')
            seconds.append(time.perf_counter() - start)
        return seconds


def footprint(planned: PlannedRun) -> Footprint:
    """Start the nodes of a run together, wait for its end, and measure the idle processes."""
    with _graph(planned) as graph:
        start = time.perf_counter()
        graph.start(*graph.names)
        graph.wait(lambda: graph.up(*planned.nodes), 'the nodes to be active')
        start_s = time.perf_counter() - start
        graph.wait(
            lambda: all(state == 'finished' for state in graph.states.values()), 'the end')
        time.sleep(_AFTER_RUN_S)
        pids = graph.processes.pids()
        before = {pid: _processor_s(pid) for pid in pids}
        begin = time.perf_counter()
        time.sleep(_IDLE_S)
        elapsed_s = time.perf_counter() - begin
        busiest = max(_processor_s(pid) - before[pid] for pid in pids) / elapsed_s
        return Footprint(
            start_s, sum(_memory_mb(pid, 'Rss') for pid in pids),
            sum(_memory_mb(pid, 'Pss') for pid in pids), 100.0 * busiest)


def start_beside_peers_s(planned: PlannedRun) -> float:
    """Return the seconds that the trajectory takes to be active if its peers are up already."""
    with _graph(planned) as graph:
        *peers, last = graph.names
        graph.start(*peers)
        graph.wait(lambda: all(peer in graph.states for peer in peers), 'the peers')
        start = time.perf_counter()
        graph.start(last)
        graph.wait(lambda: graph.up(last), f'{last} to be active')
        return time.perf_counter() - start


def service_latency_ms(planned: PlannedRun, *, composed: bool) -> tuple[float, float]:
    """
    Return the time that a node takes to answer a service call while the loop runs, milliseconds.

    Parameters
    ----------
    planned : PlannedRun
        A run that lasts longer than the calls.
    composed : bool
        Whether the four nodes of the loop share a process; each has its own otherwise.

    Returns
    -------
    median, percentile_95 : float
        Over calls one after the other.

    Raises
    ------
    CampaignError
        If the run ends before the last call, or a call is not answered.

    """
    with _graph(planned, composed=composed) as graph:
        graph.start(*graph.names)
        graph.wait(lambda: graph.up(*planned.nodes), 'the nodes to be active')
        seconds = graph.latency_s('controller', _CALLS)
        if graph.states['controller'] != 'active':
            raise CampaignError('the run ended before the calls did')
        cuts = statistics.quantiles(seconds, n=_QUANTILES)
        return 1e3 * statistics.median(seconds), 1e3 * cuts[-1]


@contextmanager
def _graph(planned: PlannedRun, *, composed: bool = False) -> Iterator[_Graph]:
    """Supervise the processes of a run, with a temporary directory for their files."""
    with (
        tempfile.TemporaryDirectory(prefix='piezo_bench_') as directory,
        Supervisor() as supervisor,
    ):
        yield _Graph(supervisor, Path(directory), planned, composed=composed)


def _processor_s(pid: int) -> float:
    """Return the processor time that a process has taken, seconds."""
    # `stat` counts in hundredths of a second, `schedstat` in nanoseconds.
    return 1e-9 * sum(
        int(path.read_text(encoding='utf-8').split()[0])
        for path in Path(f'/proc/{pid}/task').glob('*/schedstat'))


def _memory_mb(pid: int, kind: str) -> float:
    """Return the memory of a process, MB; kind is Rss or Pss."""
    for line in Path(f'/proc/{pid}/smaps_rollup').read_text(encoding='utf-8').splitlines():
        name, _, value = line.partition(':')
        if name == kind:
            return int(value.split()[0]) * 1024 / 1e6
    raise CampaignError(f'the system does not tell the {kind} of a process')
