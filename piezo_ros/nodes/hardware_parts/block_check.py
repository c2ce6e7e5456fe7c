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

"""Checks a run block by block against amplifier and stage, before each block goes out."""

import numpy as np
from numpy.typing import NDArray

from piezo_ros.hardware.device import Refused
from piezo_ros.hardware.limits import DriveLimits, block_figures

__all__ = ['BlockCheck']


class BlockCheck:
    """
    Remembers what went before a block: its last voltage, and all that the average current spans.

    Parameters
    ----------
    limits : DriveLimits
        What amplifier and stage allow.
    sample_period_s : float
        Sample period, seconds.

    """

    def __init__(self, limits: DriveLimits, sample_period_s: float) -> None:
        self._limits = limits
        self._period_s = sample_period_s
        self._window = max(1, round(limits.average_current_window_s / sample_period_s))
        self.begin(0.0)

    def begin(self, held_v: float) -> None:
        """Begin with sample 0, after a voltage that is held [V]."""
        self._held_v = held_v
        self._before_v: NDArray[np.float64] = np.empty(0)
        self._index = 0  # of the next sample

    def check(self, voltage_v: NDArray[np.float64]) -> None:
        """
        Accept the next voltages of the run, shape (N,).

        Raises
        ------
        Refused
            If one is not finite, or asks for more than is allowed; names sample, value and range.

        """
        before = self._before_v.size
        block_v = np.concatenate([self._before_v, voltage_v])
        figures = block_figures(block_v, self._held_v, self._period_s, self._limits)
        beyond = [
            f'sample {self._index - before + figure.sample}: {figure.name} is {figure.value:.4g} '
            f'{figure.unit}, allowed is {figure.range_text}'
            for figure in figures if not figure.is_allowed]
        if beyond:
            raise Refused('; '.join(beyond))
        self._index += voltage_v.size
        dropped = max(0, block_v.size - self._window)
        if dropped:
            self._held_v = float(block_v[dropped - 1])
        # A copy: the block may be large, and what is kept of it is not.
        self._before_v = block_v[dropped:].copy()
