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

"""Rates of the node graph and of rings of bare messages over three hops."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from benchmarks import bare_ring, other_rings
from piezo_ros.live.graph_per_run import GraphPerRun
from piezo_ros.live.supervisor import Supervisor
from piezo_ros.parameters.errors import CampaignError
from piezo_ros.parameters.run_and_result import PlannedRun
from piezo_ros.runtime.process.middleware import set_middleware_defaults

__all__ = ['graph_rate', 'other_ring_rate', 'ring_rate']

_REPOSITORY: Final = Path(__file__).resolve().parents[1]
_TIMEOUT_S: Final = 120.0


def graph_rate(planned: PlannedRun, *, composed: bool, record: bool) -> float:
    """
    Return the closed-loop samples per second of the node graph.

    Parameters
    ----------
    planned : PlannedRun
        The run.
    composed : bool
        Whether the four nodes of the loop share a process; each has its own otherwise.
    record : bool
        Whether a recorder writes a bag.

    """
    with (
        tempfile.TemporaryDirectory(prefix='piezo_bench_') as directory,
        Supervisor() as supervisor,
    ):
        run = GraphPerRun(supervisor, Path(directory), composed=composed, record=record)
        result = run(planned, Path(directory) / 'bag')
    return planned.trajectory.samples / result.wall_seconds


def ring_rate(
    rounds: int, *, composed: bool, block_samples: int = 1, blocks_in_flight: int = 1,
) -> float:
    """
    Return the samples per second that complete the ring of ROS topics, `benchmarks.bare_ring`.

    Parameters
    ----------
    rounds : int
        Number of messages that complete the ring.
    composed : bool
        Whether the three hops share a process; each has its own otherwise.
    block_samples : int
        Samples in a message.
    blocks_in_flight : int
        Messages in the ring at the same time.

    """
    set_middleware_defaults()
    hops = ['012'] if composed else [str(hop) for hop in range(bare_ring.HOPS)]
    namespace = f'__ns:=/piezo_ring_{os.getpid()}'
    return block_samples * _first_output('bare_ring', [
        [str(rounds), str(block_samples), str(blocks_in_flight), hop,
         '--ros-args', '-r', namespace] for hop in hops])


def other_ring_rate(transport: str, rounds: int) -> float:
    """
    Return the messages per second that complete the ring over a transport other than ROS.

    Parameters
    ----------
    transport : str
        One of `benchmarks.other_rings.TRANSPORTS`.
    rounds : int
        Number of messages that complete the ring.

    """
    with tempfile.TemporaryDirectory(prefix='piezo_ring_') as directory:
        return _first_output('other_rings', [
            [transport, str(rounds), str(hop), directory] for hop in range(other_rings.HOPS)])


def _first_output(module: str, arguments: Sequence[Sequence[str]]) -> float:
    """
    Run a module in several processes at once and return the number that the first one prints.

    Raises
    ------
    CampaignError
        If a process fails or does not end in time.

    """
    processes = [
        subprocess.Popen(
            [sys.executable, '-m', f'benchmarks.{module}', *words], cwd=_REPOSITORY,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for words in arguments]
    try:
        outputs = [process.communicate(timeout=_TIMEOUT_S) for process in processes]
    except subprocess.TimeoutExpired:
        raise CampaignError(f'{module} did not end within {_TIMEOUT_S:g} s') from None
    finally:
        for process in processes:
            process.kill()
    if any(process.returncode for process in processes):
        raise CampaignError(f'{module} failed: ' + ' '.join(error for _, error in outputs))
    return float(outputs[0][0])
