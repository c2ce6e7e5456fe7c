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

"""Yardsticks: speeds of the machine itself, by which the other quantities are divided."""

import subprocess
import sys
from typing import Final

import numpy as np

from benchmarks.measurement import Measurement, higher, lower, seconds
from piezo_ros.model.compiled import kernel

__all__ = ['YARDSTICKS']

_COMPILED_STEPS: Final = 1_000_000
_INTERPRETED_STEPS: Final = 200_000
_COPIED_BYTES: Final = 64 << 20
_MATRIX_ORDER: Final = 300


@kernel
def _chain(steps: int, factor: float, offset: float) -> float:
    """Do steps of one multiplication and one addition, each of which needs the one before."""
    value = 0.0
    for _ in range(steps):
        value = value * factor + offset
    return value


def _interpreted(steps: int) -> float:
    value = 0.0
    for _ in range(steps):
        value = value * 0.5 + 1.0
    return value


def _chain_speed() -> tuple[float, float]:
    _chain(1, 0.5, 1.0)
    rate = _COMPILED_STEPS / seconds(lambda: _chain(_COMPILED_STEPS, 0.5, 1.0))
    return 1e9 / rate, rate


def _interpreter_rate() -> tuple[float]:
    return (_INTERPRETED_STEPS / seconds(lambda: _interpreted(_INTERPRETED_STEPS)),)


def _copy_rate() -> tuple[float]:
    source = np.ones(_COPIED_BYTES // 8)
    target = np.zeros_like(source)
    return (_COPIED_BYTES / seconds(lambda: np.copyto(target, source)) / 1e6,)


def _decomposition_s() -> tuple[float]:
    matrix = np.random.default_rng(1).standard_normal((_MATRIX_ORDER, _MATRIX_ORDER))
    return (seconds(lambda: np.linalg.svd(matrix)),)


def _python_start_s() -> tuple[float]:
    return (seconds(lambda: subprocess.run([sys.executable, '-c', 'pass'], check=True)),)


YARDSTICKS: Final = (
    Measurement(
        'yardsticks', (lower('chain', 'ns/step'), higher('chain_rate', 'steps/s')), _chain_speed),
    Measurement('yardsticks', (higher('interpreter', 'steps/s'),), _interpreter_rate),
    Measurement('yardsticks', (higher('copy', 'MB/s'),), _copy_rate),
    Measurement('yardsticks', (lower('decomposition', 's'),), _decomposition_s),
    Measurement('yardsticks', (lower('python_start', 's'),), _python_start_s),
)
