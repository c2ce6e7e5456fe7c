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

"""What a graph of four processes costs beside its speed: start, memory, idling, and its answers."""

import json
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

import rclpy
import yaml
from rcl_interfaces.srv import GetParameters
from std_msgs.msg import String

from piezo_ros.experiment.errors import CampaignError
from piezo_ros.experiment.plan import PlannedRun
from piezo_ros.nodes.process_group import ProcessGroup
from piezo_ros.nodes.run_parameters import run_parameters
from piezo_ros.nodes.supervisor import Supervisor

__all__ = ['Footprint', 'footprint', 'service_latency_ms', 'start_beside_peers_s']

_PATIENCE_S: Final = 60.0
_IDLE_S: Final = 3.0
_SETTLE_S: Final = 1.0
_GIVEN_BACK_S: Final = 1.0  # within which the code of the run is let go
_CALLS: Final = 100
_CALL_PATIENCE_S: Final = 5.0
_PERCENTILES: Final = 20  # the last of them is the 95th
_UP: Final = ('active', 'finished')


class Footprint(NamedTuple):
    """
    What four processes cost.

    Attributes
    ----------
    start_s : float
        Seconds from the start of the first process until all are active.
    memory_mb : float
        Resident memory of all after a run.
    idle_percent : float
        Processor time of the busiest of them after the run, percent of a core.

    """

    start_s: float
    memory_mb: float
    idle_percent: float


class _Graph(Supervisor):
    """The stages of a run as processes that stay after it."""

    def __init__(self, directory: Path, planned: PlannedRun, *, composed: bool) -> None:
        super().__init__(directory, '')
        self._composed = composed
        self._planned = planned
        self.processes = ProcessGroup()
        self.states: dict[str, str] = {}
        self.names = ('loop',) if composed else planned.stages

    def __enter__(self) -> '_Graph':
        super().__enter__()
        sections = run_parameters(
            self._planned, self._directory / 'bag', record=False, autostart=True,
            compiled=self._planned.stages if self._composed else ())
        self._file = self._directory / 'parameters.yaml'
        self._file.write_text(yaml.safe_dump({
            f'{self._namespace}/{node}': {'ros__parameters': dict(values)}
            for node, values in sections.items()}), encoding='utf-8')
        return self

    def __exit__(self, *_: object) -> None:
        self.processes.stop()
        self.processes.kill()
        super().__exit__()

    def start(self, *names: str) -> None:
        """Start executables."""
        for name in names:
            self.processes.start(
                name,
                ['--ros-args', '-r', f'__ns:={self._namespace}', '--params-file',
                 str(self._file)],
                self._directory / f'{name}.log')

    def wait(self, condition: Callable[[], bool], what: str) -> None:
        """Listen until a condition holds."""
        deadline = time.monotonic() + _PATIENCE_S
        while not condition():
            if self.processes.dead():
                raise CampaignError(f'{next(iter(self.processes.blamed))} failed')
            if time.monotonic() > deadline or self._stop_signal:
                raise CampaignError(f'waited {_PATIENCE_S:g} s for {what}')
            rclpy.spin_once(self._node, timeout_sec=0.05)

    def up(self, *stages: str) -> bool:
        """Return whether stages run, or did."""
        return all(self.states.get(stage) in _UP for stage in stages)

    def latency_s(self, node: str, calls: int) -> list[float]:
        """Return how long a node takes to tell a parameter, call by call, seconds."""
        client: Any = self._node.create_client(
            GetParameters, f'{self._namespace}/{node}/get_parameters')
        self.wait(client.service_is_ready, f'the parameters of {node}')
        # A server that has not discovered its client throws the answer away.
        time.sleep(_SETTLE_S)
        seconds = []
        for _ in range(calls):
            start = time.perf_counter()
            future = client.call_async(GetParameters.Request(names=['sample_period_s']))
            while not future.done() and time.perf_counter() - start < _CALL_PATIENCE_S:
                rclpy.spin_once(self._node, timeout_sec=_CALL_PATIENCE_S)
            if not future.done():
                raise CampaignError(f'{node} did not answer within {_CALL_PATIENCE_S:g} s')
            seconds.append(time.perf_counter() - start)
        return seconds

    def _note(self, message: String) -> None:
        status = json.loads(message.data)
        self.states[status['node']] = status['state']


def footprint(planned: PlannedRun) -> Footprint:
    """Start the stages of a run at once, let them do it, and watch them afterwards."""
    with _graph(planned) as graph:
        start = time.perf_counter()
        graph.start(*graph.names)
        graph.wait(lambda: graph.up(*planned.stages), 'the nodes to be active')
        start_s = time.perf_counter() - start
        graph.wait(
            lambda: all(state == 'finished' for state in graph.states.values()), 'the end')
        time.sleep(_GIVEN_BACK_S)
        pids = graph.processes.pids()
        before = {pid: _processor_s(pid) for pid in pids}
        begin = time.perf_counter()
        time.sleep(_IDLE_S)
        elapsed_s = time.perf_counter() - begin
        busiest = max(_processor_s(pid) - before[pid] for pid in pids) / elapsed_s
        return Footprint(start_s, sum(map(_resident_mb, pids)), 100.0 * busiest)


def start_beside_peers_s(planned: PlannedRun) -> float:
    """Return the seconds from the start of the trajectory, its peers being up, to its run."""
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
    Return how long a node takes to answer a service call at full rate, milliseconds.

    Parameters
    ----------
    planned : PlannedRun
        A run that outlasts the calls.
    composed : bool
        The four stages in one process.

    Returns
    -------
    median, percentile_95 : float
        Of calls one after the other.

    """
    with _graph(planned, composed=composed) as graph:
        graph.start(*graph.names)
        graph.wait(lambda: graph.up(*planned.stages), 'the nodes to be active')
        seconds = graph.latency_s('controller', _CALLS)
        if graph.states['controller'] != 'active':
            raise CampaignError('the run ended before the calls did')
        cuts = statistics.quantiles(seconds, n=_PERCENTILES)
        return 1e3 * statistics.median(seconds), 1e3 * cuts[-1]


@contextmanager
def _graph(planned: PlannedRun, *, composed: bool = False) -> Iterator[_Graph]:
    """Supervise a graph in a directory of its own."""
    with tempfile.TemporaryDirectory(prefix='piezo_bench_') as directory, _Graph(
            Path(directory), planned, composed=composed) as graph:
        yield graph


def _processor_s(pid: int) -> float:
    """Return the processor time that a process has taken."""
    # The times of `stat` count in hundredths of a second, those of the scheduler in nanoseconds.
    return 1e-9 * sum(
        int(path.read_text(encoding='utf-8').split()[0])
        for path in Path(f'/proc/{pid}/task').glob('*/schedstat'))


def _resident_mb(pid: int) -> float:
    for line in Path(f'/proc/{pid}/status').read_text(encoding='utf-8').splitlines():
        if line.startswith('VmRSS:'):
            return int(line.split()[1]) * 1024 / 1e6
    return 0.0
