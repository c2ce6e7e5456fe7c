"""One run of a plan simulated offline: the same samples and the same bag as from the live graph."""

import time
from functools import cache
from pathlib import Path

from piezo_ros.bag import BagWriter
from piezo_ros.control import (
    ClosedLoopRun,
    ControllerParameters,
    TrajectoryParameters,
    simulate,
)
from piezo_ros.experiment.campaign import RunResult
from piezo_ros.experiment.plan import PlannedRun
from piezo_ros.experiment.provenance import parameters_yaml, run_metadata
from piezo_ros.model import HysteresisParameters, RigParameters

__all__ = ['simulate_run', 'write_run']

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
    _compile()
    start = time.perf_counter()
    run = simulate(
        planned.plant, planned.compensator, planned.controller, planned.trajectory)
    seconds = time.perf_counter() - start
    write_run(planned, run, bag)
    return RunResult(seconds)


@cache
def _compile() -> None:
    """Compile the loop or take it from the cache: start-up is no part of a run's time."""
    simulate(
        RigParameters(), HysteresisParameters(), ControllerParameters(),
        TrajectoryParameters(periods=0.01))


def write_run(planned: PlannedRun, run: ClosedLoopRun, bag: Path) -> None:
    """
    Write the streams of a run as the recorder would.

    Parameters
    ----------
    planned : PlannedRun
        Where its parameters come from.
    run : ClosedLoopRun
        The streams.
    bag : Path
        Bag directory; must not exist.

    """
    period_s = planned.trajectory.sample_period_s
    streams = {
        'reference': run.reference_um,
        'feedforward': run.feedforward_um,
        'command': run.command_um,
        'voltage': run.voltage_v,
        'displacement': run.displacement_um,
    }
    with BagWriter(bag, metadata=run_metadata(planned.parameters)) as writer:
        writer.attach_parameters(parameters_yaml('/', planned.parameters))
        longest = max(values.size for values in streams.values())
        for start in range(0, longest, _BLOCK_SAMPLES):
            for stream, values in streams.items():
                block = values[start:start + _BLOCK_SAMPLES]
                if block.size:
                    writer.write_block(stream, start, period_s, block)
        for stream, values in streams.items():
            writer.write_block(stream, values.size, period_s, [])
