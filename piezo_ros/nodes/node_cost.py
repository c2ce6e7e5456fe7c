"""What nodes cost beside their samples: start-up, memory, idling; and how quickly they answer."""

import json
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final

import rclpy
from rcl_interfaces.srv import GetParameters
from std_msgs.msg import String

from piezo_ros.experiment.errors import CampaignError
from piezo_ros.nodes.process_group import ProcessGroup
from piezo_ros.nodes.supervisor import Supervisor

__all__ = ['idle_cost', 'service_latency_s', 'start_up_s']

_STAGES: Final = ('compensator', 'controller', 'plant', 'trajectory')
_PATIENCE_S: Final = 30.0
_SETTLE_S: Final = 2.0
_IDLE_S: Final = 3.0
_CALLS: Final = 100
_LONG: Final = ('-p', 'periods:=1e5')


class _Nodes(Supervisor):
    """Nodes that end with the context, and the newest status of each."""

    def __init__(self) -> None:
        self._keep = tempfile.TemporaryDirectory(prefix='piezo_bench_')
        super().__init__(Path(self._keep.name), f'piezo_cost_{os.getpid()}')
        self.processes = ProcessGroup()
        self._states: dict[str, str] = {}

    def __exit__(self, *details: object) -> None:
        self.processes.stop()
        self.processes.kill()
        super().__exit__(*details)
        self._keep.cleanup()

    def start(self, names: Iterable[str], *arguments: str) -> None:
        """Start some executables."""
        for name in names:
            self.processes.start(
                name, ['--ros-args', '-r', f'__ns:={self._namespace}', *arguments],
                self._directory / f'{name}.log')

    def _note(self, message: String) -> None:
        status = json.loads(message.data)
        self._states[status['node']] = status['state']

    def wait(self, what: str, condition: Callable[[], bool]) -> None:
        """Serve the statuses until a condition holds."""
        deadline = time.monotonic() + _PATIENCE_S
        while not condition():
            rclpy.spin_once(self._node, timeout_sec=0.005)
            if time.monotonic() > deadline or self.processes.dead():
                raise CampaignError(f'waited for {what}; states: {self._states}')

    def active(self, names: Iterable[str]) -> bool:
        """Return whether nodes are active."""
        return all(self._states.get(name) == 'active' for name in names)

    def latencies_s(self, node: str) -> list[float]:
        """Ask a node for a parameter again and again; return how long each answer took."""
        client: Any = self._node.create_client(
            GetParameters, f'{self._namespace}/{node}/get_parameters')
        self.wait(f'the services of {node}', client.service_is_ready)
        request = GetParameters.Request(names=['sample_period_s'])
        # A server that has not discovered its client throws the answer away.
        time.sleep(_SETTLE_S)
        taken: list[float] = []
        for _ in range(_CALLS):
            began = time.perf_counter()
            self.wait(f'an answer of {node}', client.call_async(request).done)
            taken.append(time.perf_counter() - began)
        return taken


def start_up_s(*, together: bool) -> float:
    """
    Return the time from the start of a process until its node is active.

    Parameters
    ----------
    together : bool
        All four stages at once, until the last one is active; else the last of them alone, its
        peers being up.

    """
    with _Nodes() as nodes:
        late = _STAGES if together else _STAGES[-1:]
        if not together:
            nodes.start(_STAGES[:-1], '-p', 'handshake_timeout_s:=60.0')
            time.sleep(_SETTLE_S)
        began = time.perf_counter()
        nodes.start(late, *_LONG)
        nodes.wait('the nodes to be active', lambda: nodes.active(late))
        return time.perf_counter() - began


def idle_cost() -> tuple[float, float]:
    """Return the largest share of a core that an idle stage uses, and the memory of four, bytes."""
    with _Nodes() as nodes:
        nodes.start(_STAGES, '-p', 'autostart:=false')
        time.sleep(_SETTLE_S)
        if nodes.processes.dead():
            raise CampaignError('an idle node has died')
        numbers = nodes.processes.numbers()
        before = [_processor_s(number) for number in numbers]
        time.sleep(_IDLE_S)
        used = [
            (_processor_s(number) - start) / _IDLE_S
            for number, start in zip(numbers, before, strict=True)]
        return max(used), sum(_resident_bytes(number) for number in numbers)


def service_latency_s(*, composed: bool) -> float:
    """Return the 95th percentile of the time that a node takes to answer, at full rate."""
    with _Nodes() as nodes:
        nodes.start(['loop'] if composed else _STAGES, *_LONG)
        nodes.wait('the nodes to be active', lambda: nodes.active(_STAGES))
        return statistics.quantiles(nodes.latencies_s('plant'), n=20)[-1]


def _processor_s(number: int) -> float:
    fields: Any = Path(f'/proc/{number}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def _resident_bytes(number: int) -> float:
    pages = int(Path(f'/proc/{number}/statm').read_text().split()[1])
    return float(pages * os.sysconf('SC_PAGE_SIZE'))
