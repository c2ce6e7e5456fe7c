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

"""Speed of the compiled kernels of the model and of the closed loop."""

from collections.abc import Callable
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.measurement import Measurement, Ratio, higher, lower, shortest
from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.model import HysteresisParameters, MaxwellResistiveCapacitor, Rig, RigParameters
from piezo_ros.study.table_4 import table_cells, tracking_errors

__all__ = ['KERNELS', 'KERNEL_RATIOS']

_SAMPLES: Final = 1_000_000
_MANY_SAMPLES: Final = 10_000_000
_PERIODS: Final = 3000.0
_NANOSECONDS: Final = 1e9


@cache
def _operator(elements: int) -> MaxwellResistiveCapacitor:
    """Return an operator with elements that saturate one after the other over the travel."""
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


def _inverse(elements: int, samples: int | None = None) -> Callable[[], tuple[float]]:
    def measure() -> tuple[float]:
        operator, displacement_um = _operator(elements), _displacement_um(samples or _SAMPLES)
        operator.inverse(displacement_um[:1])
        elapsed_s = shortest(lambda: operator.inverse(displacement_um))
        return (elapsed_s / len(displacement_um) * _NANOSECONDS,)
    return measure


def _forward(elements: int) -> Callable[[], tuple[float]]:
    def measure() -> tuple[float]:
        operator, voltage_v = _operator(elements), _voltage_v(elements)
        operator.forward(voltage_v[:1])
        return (shortest(lambda: operator.forward(voltage_v)) / len(voltage_v) * _NANOSECONDS,)
    return measure


def _rig() -> tuple[float]:
    rig, voltage_v = Rig(), _voltage_v(10)
    rig.run(voltage_v[:1])
    return (shortest(lambda: rig.run(voltage_v)) / len(voltage_v) * _NANOSECONDS,)


def _closed_loop() -> tuple[float, float]:
    def run(periods: float) -> int:
        trajectory = TrajectoryParameters(periods=periods)
        simulate(RigParameters(), HysteresisParameters(), ControllerParameters(), trajectory)
        return trajectory.samples
    run(1.0)
    rate = run(_PERIODS) / shortest(lambda: run(_PERIODS))
    return _NANOSECONDS / rate, rate


def _table_4() -> tuple[float]:
    cells = table_cells()
    tracking_errors(RigParameters(), cells[:1])
    return (shortest(lambda: tracking_errors(RigParameters(), cells)),)


KERNELS: Final = (
    Measurement('kernels', (lower('inverse', 'ns/sample'),), _inverse(10)),
    Measurement('kernels', (lower('inverse_40_elements', 'ns/sample'),), _inverse(40)),
    Measurement(
        'kernels', (lower('inverse_10m_samples', 'ns/sample'),), _inverse(10, _MANY_SAMPLES)),
    Measurement('kernels', (lower('forward', 'ns/sample'),), _forward(10)),
    Measurement('kernels', (lower('forward_40_elements', 'ns/sample'),), _forward(40)),
    Measurement('kernels', (lower('rig', 'ns/sample'),), _rig),
    Measurement(
        'kernels', (lower('closed_loop', 'ns/sample'), higher('closed_loop_rate', 'samples/s')),
        _closed_loop),
    Measurement('kernels', (lower('table_4', 's'),), _table_4),
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
