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

"""Speed of the node graph and of the bare transport, in one round after the other."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from piezo_ros.experiment.errors import CampaignError
from piezo_ros.experiment.plan import PlannedRun
from piezo_ros.nodes.bare_ring import HOPS
from piezo_ros.nodes.graph import GraphRunner
from piezo_ros.nodes.middleware import set_middleware_defaults

__all__ = ['graph_rate', 'ring_rate']


def ring_rate(
    rounds: int, *, composed: bool, block_samples: int = 1, blocks_in_flight: int = 1,
) -> float:
    """
    Return the samples per second that come round in the bare three-hop ring.

    Parameters
    ----------
    rounds : int
        How many messages come round.
    composed : bool
        All hops in one process in place of one process each.
    block_samples : int
        Samples in a message.
    blocks_in_flight : int
        Messages on their way at once.

    """
    set_middleware_defaults()
    parts = ['012'] if composed else [str(hop) for hop in range(HOPS)]
    processes = [
        subprocess.Popen(
            [sys.executable, '-m', 'piezo_ros.nodes.bare_ring', str(rounds), str(block_samples),
             str(blocks_in_flight), part, '--ros-args', '-r', f'__ns:=/piezo_ring_{os.getpid()}'],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for part in parts]
    try:
        outputs = [process.communicate(timeout=120.0) for process in processes]
    finally:
        for process in processes:
            process.kill()
    if any(process.returncode for process in processes):
        raise CampaignError('the bare ring failed: ' + ' '.join(error for _, error in outputs))
    return float(outputs[0][0]) * block_samples


def graph_rate(
    planned: PlannedRun, *, composed: bool, record: bool,
    progress: Callable[[float], None] = lambda share: None,
) -> float:
    """
    Return the closed-loop samples per second of the node graph.

    Parameters
    ----------
    planned : PlannedRun
        What to run.
    composed : bool
        The four stages in one process in place of one process each.
    record : bool
        Whether a recorder listens.
    progress : callable
        Is told the share that is done.

    """
    with tempfile.TemporaryDirectory(prefix='piezo_bench_') as directory, GraphRunner(
            Path(directory), composed=composed, record=record, progress=progress) as runner:
        result = runner(planned, Path(directory) / 'bag')
    return planned.trajectory.samples / result.wall_seconds
