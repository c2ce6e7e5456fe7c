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

"""The reference of a run at single samples, as the page shows it beside the displacement."""

import math
from functools import partial
from typing import Any, Final

from piezo_ros.control import TrajectoryParameters
from piezo_ros.control.trajectory_blocks import trajectory_blocks
from piezo_ros.control.trajectory_step import trajectory_constants, trajectory_step
from piezo_ros.control.waveform import EXCITATIONS, FILE, REPEATING, motion_of
from piezo_ros.parameters.run_and_result import PlannedRun

__all__ = ['RunReference']

_OUTLINE_POINTS: Final = 240
_MOST_TABLE_SAMPLES: Final = 2_000_000  # the step takes them as a list: 64 MB


class RunReference:
    """
    What the trajectory of a run is told to send.

    The samples of the streams that a page sees are those of different moments. To compare a
    displacement with the reference of the same index, the reference is computed, by the step that
    the trajectory itself computes with.

    Parameters
    ----------
    planned : PlannedRun
        The run.

    Attributes
    ----------
    period_samples : float or None
        Period of what repeats, in samples; None where nothing does.
    settled_sample : int
        First sample after the soft start and one more period.

    """

    def __init__(self, planned: PlannedRun) -> None:
        trajectory = planned.trajectory
        self._samples = trajectory.samples
        self._at: Any = None
        self.period_samples: float | None = None
        self.settled_sample = 0
        if _table_samples(trajectory) > _MOST_TABLE_SAMPLES:
            return
        constants = trajectory_constants(trajectory)
        if trajectory.waveform in REPEATING:
            self.period_samples = 1.0 / (trajectory.frequency_hz * trajectory.sample_period_s)
        elif trajectory.waveform not in EXCITATIONS and len(constants.table) > 0:
            repeated = len(constants.table) - constants.first_repeated
            # A table that holds its last sample repeats that one.
            self.period_samples = float(repeated) if repeated > 1 else None
        if self.period_samples and not 2.0 < 2.0 * self.period_samples <= self._samples:
            self.period_samples = None  # nothing comes a second time
        period = self.period_samples or 0.0
        first = constants.first_repeated if len(constants.table) > 0 else 0
        self.settled_sample = first + math.ceil((trajectory.ramp_periods + 1.0) * period)
        if planned.bare:
            return
        if trajectory.file_changes:
            blocks = trajectory_blocks(trajectory)
            self._at = lambda index: blocks(index, 1)[0][0]
        else:
            self._at = partial(_reference_um, constants)

    @property
    def is_known(self) -> bool:
        """Whether the run follows a reference."""
        return self._at is not None

    def at(self, index: int) -> float | None:
        """Return the reference of a sample, um; None where there is none."""
        if self._at is None or not 0 <= index < self._samples:
            return None
        return float(self._at(index))

    def outline(self) -> list[tuple[float, float]]:
        """Return phase, in periods, and reference, um, along one settled period."""
        period = self.period_samples
        if period is None or self._at is None:
            return []
        first = min(self.settled_sample, self._samples - math.ceil(period) - 1)
        step = max(1, math.ceil(period / _OUTLINE_POINTS))
        indices = range(max(first, 0), max(first, 0) + math.ceil(period), step)
        return sorted((index / period % 1.0, float(self._at(index))) for index in indices)


def _table_samples(trajectory: TrajectoryParameters) -> int:
    if trajectory.waveform in EXCITATIONS:
        return trajectory.samples
    return motion_of(trajectory).reference_um.size if trajectory.waveform == FILE else 0


def _reference_um(constants: Any, index: int) -> float:
    return float(trajectory_step(constants, index)[0])


