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

"""Speed of the compiled kernels, and the yardsticks beside which they are judged."""

import subprocess
import sys
import time
from collections.abc import Callable
from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.experiment.benchmark import Measurement, Quantity, Ratio
from piezo_ros.experiment.tracking_table import table_cells, tracking_errors
from piezo_ros.model import HysteresisParameters, MaxwellResistiveCapacitor, Rig, RigParameters
from piezo_ros.model.compiled import kernel

__all__ = ['KERNELS', 'KERNEL_RATIOS', 'YARDSTICKS', 'seconds']

_SAMPLES: Final = 1_000_000
_MANY_SAMPLES: Final = 10_000_000
_INTERPRETED_STEPS: Final = 200_000
_COPIED_BYTES: Final = 64 << 20
_MATRIX_ORDER: Final = 300
_NANOSECONDS: Final = 1e9


def seconds(action: Callable[[], Any]) -> float:
    """Return the wall-clock time that an action takes, seconds."""
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


@kernel
def _chain(steps: int, factor: float, offset: float) -> float:
    """Do steps that each wait for the one before: one multiplication and one addition."""
    value = 0.0
    for _ in range(steps):
        value = value * factor + offset
    return value


def _interpreted(steps: int) -> float:
    value = 0.0
    for _ in range(steps):
        value = value * 0.5 + 1.0
    return value


def _yardstick_compiled() -> tuple[float, float]:
    _chain(1, 0.5, 1.0)
    rate = _SAMPLES / seconds(lambda: _chain(_SAMPLES, 0.5, 1.0))
    return _NANOSECONDS / rate, rate


def _yardstick_interpreted() -> tuple[float]:
    return (_INTERPRETED_STEPS / seconds(lambda: _interpreted(_INTERPRETED_STEPS)),)


def _yardstick_copy() -> tuple[float]:
    source = np.ones(_COPIED_BYTES // 8)
    target = np.zeros_like(source)
    return (_COPIED_BYTES / seconds(lambda: np.copyto(target, source)) / 1e6,)


def _yardstick_solve() -> tuple[float]:
    matrix = np.random.default_rng(1).standard_normal((_MATRIX_ORDER, _MATRIX_ORDER))
    return (seconds(lambda: np.linalg.svd(matrix)),)


def _yardstick_python() -> tuple[float]:
    return (seconds(lambda: subprocess.run([sys.executable, '-c', 'pass'], check=True)),)


@cache
def _operator(elements: int) -> MaxwellResistiveCapacitor:
    """Return an operator whose elements saturate one after the other over the travel."""
    default = MaxwellResistiveCapacitor()
    if elements == len(default.parameters.saturation_v):
        return default
    kappa = np.full(elements + 1, float(elements))
    kappa[-1] = 1.5
    return MaxwellResistiveCapacitor(
        kappa.tolist(), np.linspace(0.02, 1.5, elements) / elements)  # type: ignore[arg-type]


@cache
def _displacement_um(samples: int) -> NDArray[np.float64]:
    return np.asarray(2.5 * np.sin(2.0 * np.pi * 300.0 * 1e-5 * np.arange(samples)))


@cache
def _voltage_v(elements: int) -> NDArray[np.float64]:
    return _operator(elements).inverse(_displacement_um(_SAMPLES))[0]


def _inverse(elements: int, samples: int = _SAMPLES) -> Callable[[], tuple[float]]:
    def measure() -> tuple[float]:
        operator, displacement_um = _operator(elements), _displacement_um(samples)
        operator.inverse(displacement_um[:1])
        return (seconds(lambda: operator.inverse(displacement_um)) / samples * _NANOSECONDS,)
    return measure


def _forward(elements: int) -> Callable[[], tuple[float]]:
    def measure() -> tuple[float]:
        operator, voltage_v = _operator(elements), _voltage_v(elements)
        operator.forward(voltage_v[:1])
        return (seconds(lambda: operator.forward(voltage_v)) / _SAMPLES * _NANOSECONDS,)
    return measure


def _rig() -> tuple[float]:
    rig, voltage_v = Rig(), _voltage_v(10)
    rig.run(voltage_v[:1])
    return (seconds(lambda: rig.run(voltage_v)) / _SAMPLES * _NANOSECONDS,)


def _closed_loop() -> tuple[float, float]:
    def run(periods: float) -> int:
        trajectory = TrajectoryParameters(periods=periods)
        simulate(RigParameters(), HysteresisParameters(), ControllerParameters(), trajectory)
        return trajectory.samples
    run(1.0)
    rate = run(3000.0) / seconds(lambda: run(3000.0))
    return _NANOSECONDS / rate, rate


def _table_4() -> tuple[float]:
    cells = table_cells()
    tracking_errors(RigParameters(), cells[:1])
    return (seconds(lambda: tracking_errors(RigParameters(), cells)),)


def _lower(name: str, unit: str) -> Quantity:
    return Quantity(name, unit, higher_is_better=False)


def _higher(name: str, unit: str) -> Quantity:
    return Quantity(name, unit, higher_is_better=True)


YARDSTICKS: Final = (
    Measurement(
        'yardsticks', (_lower('chain', 'ns/step'), _higher('chain_rate', 'steps/s')),
        _yardstick_compiled),
    Measurement('yardsticks', (_higher('interpreter', 'steps/s'),), _yardstick_interpreted),
    Measurement('yardsticks', (_higher('copy', 'MB/s'),), _yardstick_copy),
    Measurement('yardsticks', (_lower('decomposition', 's'),), _yardstick_solve),
    Measurement('yardsticks', (_lower('python_start', 's'),), _yardstick_python),
)
KERNELS: Final = (
    Measurement('kernels', (_lower('inverse', 'ns/sample'),), _inverse(10)),
    Measurement('kernels', (_lower('inverse_40_elements', 'ns/sample'),), _inverse(40)),
    Measurement(
        'kernels', (_lower('inverse_10m_samples', 'ns/sample'),), _inverse(10, _MANY_SAMPLES)),
    Measurement('kernels', (_lower('forward', 'ns/sample'),), _forward(10)),
    Measurement('kernels', (_lower('forward_40_elements', 'ns/sample'),), _forward(40)),
    Measurement('kernels', (_lower('rig', 'ns/sample'),), _rig),
    Measurement(
        'kernels',
        (_lower('closed_loop', 'ns/sample'), _higher('closed_loop_rate', 'samples/s')),
        _closed_loop),
    Measurement('kernels', (_lower('table_4', 's'),), _table_4),
)
KERNEL_RATIOS: Final = (
    Ratio('inverse_over_chain', 'inverse', 'chain', higher_is_better=False),
    Ratio('forward_over_chain', 'forward', 'chain', higher_is_better=False),
    Ratio('closed_loop_over_chain', 'closed_loop', 'chain', higher_is_better=False),
    Ratio('inverse_40_over_10_elements', 'inverse_40_elements', 'inverse',
          higher_is_better=False),
    Ratio('forward_40_over_10_elements', 'forward_40_elements', 'forward',
          higher_is_better=False),
    Ratio('inverse_10m_over_1m_samples', 'inverse_10m_samples', 'inverse',
          higher_is_better=False),
)
