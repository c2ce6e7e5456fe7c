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

"""One run of a plan simulated offline: the same samples and the same bag as from the live graph."""

import time
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag import STREAMS, BagWriter
from piezo_ros.control import (
    ControllerParameters,
    TrajectoryParameters,
    simulate,
    simulate_bare,
)
from piezo_ros.control.closed_loop import run_loop, target_of
from piezo_ros.model import HysteresisParameters, RigParameters
from piezo_ros.parameters.errors import CampaignError
from piezo_ros.parameters.parameter_file import parameters_yaml
from piezo_ros.parameters.portable_files import told_from_bag
from piezo_ros.parameters.provenance import run_metadata
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult

__all__ = ['compile_loop', 'simulate_run', 'simulated_streams', 'write_run']

_BLOCK_SAMPLES = 1000


def simulate_run(planned: PlannedRun, bag: Path) -> RunResult:
    """
    Simulate a run and write its bag.

    Parameters
    ----------
    planned : PlannedRun
        The run.
    bag : Path
        Bag directory; must not exist.

    """
    compile_loop()
    start = time.perf_counter()
    streams = simulated_streams(planned)
    seconds = time.perf_counter() - start
    write_run(planned, streams, bag)
    return RunResult(seconds)


def simulated_streams(
    planned: PlannedRun, target: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
) -> dict[str, NDArray[np.float64]]:
    """
    Simulate a run and return its streams; displacement has one sample more.

    Parameters
    ----------
    planned : PlannedRun
        The run.
    target : tuple of ndarray, shape (N,) each, optional
        Reference and feedforward of its trajectory, where they are known already.

    """
    if planned.hardware:
        # What `stand_in` has not made a run of a simulated rig, of which more is known.
        raise CampaignError(
            f'{planned.name}: device {planned.hardware.device} is no simulated rig')
    if planned.bare:
        bare = simulate_bare(planned.plant, planned.trajectory)
        return {'voltage': bare.voltage_v, 'displacement': bare.displacement_um}
    reference_um, feedforward_um = target or target_of(planned.trajectory)
    run = run_loop(
        planned.plant, planned.compensator, planned.controller,
        planned.trajectory.sample_period_s, reference_um, feedforward_um, planned.changes)
    return dict(zip(STREAMS, run, strict=True))


@cache
def compile_loop() -> None:
    """Compile the loop or take it from the cache: start-up is no part of a run's time."""
    simulate(
        RigParameters(), HysteresisParameters(), ControllerParameters(),
        TrajectoryParameters(periods=0.01))


def write_run(
    planned: PlannedRun, streams: Mapping[str, NDArray[np.float64]], bag: Path,
) -> None:
    """
    Write the streams of a run as the recorder would.

    Parameters
    ----------
    planned : PlannedRun
        Where its parameters come from.
    streams : mapping of str to ndarray
        The streams that the run has, from index 0.
    bag : Path
        Bag directory; must not exist.

    """
    period_s = planned.trajectory.sample_period_s
    parameters = told_from_bag(bag, {node: planned.parameters[node] for node in planned.nodes})
    topics = {stream: f'/{stream}' for stream in streams}
    with BagWriter(bag, topics=topics, metadata=run_metadata(parameters)) as writer:
        writer.attach_parameters(parameters_yaml('/', parameters))
        longest = max(values.size for values in streams.values())
        for start in range(0, longest, _BLOCK_SAMPLES):
            for stream, values in streams.items():
                block = values[start:start + _BLOCK_SAMPLES]
                if block.size:
                    writer.write_block(stream, start, period_s, block)
        for stream, values in streams.items():
            writer.write_block(stream, values.size, period_s, [])
