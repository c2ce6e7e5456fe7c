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
"""The rigs of a raster scan simulated offline: the same samples and bags as of the live graphs."""

from collections.abc import Mapping
from pathlib import Path

from piezo_ros.experiment.offline import simulate_run
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult

__all__ = ['OfflineRigs']


class OfflineRigs:
    """
    Simulates the runs of both axes.

    Nothing couples the axes but the index of their samples, so that one after the other is as good.
    """

    def alone(self, planned: PlannedRun, bag: Path) -> RunResult:
        """Simulate a run of the fast axis."""
        return simulate_run(planned, bag)

    def together(
        self, planned: Mapping[str, PlannedRun], bags: Mapping[str, Path],
    ) -> tuple[RunResult, ...]:
        """Simulate a run of each axis."""
        for bag in bags.values():
            bag.parent.mkdir(parents=True, exist_ok=True)
        return tuple(simulate_run(run, bags[axis]) for axis, run in planned.items())
