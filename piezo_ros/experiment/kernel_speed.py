"""Speed of the compiled kernels, by the clock."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.model import HysteresisParameters, MaxwellResistiveCapacitor, RigParameters

__all__ = ['kernel_speeds']

_SAMPLES = 1_000_000


def kernel_speeds(rig: RigParameters) -> Iterator[tuple[str, str, float]]:
    """
    Yield name, unit and value of every measurement, once; call it once a round.

    Parameters
    ----------
    rig : RigParameters
        The rig of the closed loop.

    """
    operator = MaxwellResistiveCapacitor()
    phase = 2.0 * np.pi * 300.0 * 1e-5 * np.arange(_SAMPLES)
    displacement_um = 2.5 * np.sin(phase)
    voltage_v, _ = operator.inverse(displacement_um)
    operator.forward(voltage_v[:1])
    yield 'inverse', 'ns/sample', _seconds(
        lambda: operator.inverse(displacement_um)) / _SAMPLES * 1e9
    yield 'forward', 'ns/sample', _seconds(
        lambda: operator.forward(voltage_v)) / _SAMPLES * 1e9
    trajectory = TrajectoryParameters(periods=3000.0)
    controller, compensator = ControllerParameters(), HysteresisParameters()
    simulate(rig, compensator, controller, TrajectoryParameters(periods=1.0))
    yield 'closed_loop_offline', 'samples/s', trajectory.samples / _seconds(
        lambda: simulate(rig, compensator, controller, trajectory))


def _seconds(action: Callable[[], Any]) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start
