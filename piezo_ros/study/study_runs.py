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

"""The runs of a study: each is told before it starts, and its bag is read when it is done."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from piezo_ros.bag import Run, read
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult

__all__ = ['StudyRuns']


class StudyRuns:
    """
    Does the runs of a study into one directory.

    Parameters
    ----------
    directory : Path
        Of the study; bags go to ``bags`` in it unless a run is given another place.
    run : callable
        Does one run into the bag directory it is given.
    announce : callable
        Is told of each run before it starts.
    usual : int
        How many runs the study does on the rig of its plan. What learning does, and with it the
        number on another rig, is known only afterwards.

    Attributes
    ----------
    wall_seconds : dict of str to float
        Name of a run to the time that it took.

    """

    def __init__(
        self, directory: Path, run: Callable[[PlannedRun, Path], RunResult],
        announce: Callable[[str], None], usual: int,
    ) -> None:
        self._directory = directory
        self._run = run
        self._announce = announce
        self._usual = usual
        self._count = 0
        self.wall_seconds: dict[str, float] = {}

    def one(self, planned: PlannedRun, bag: Path) -> RunResult:
        """Do a run into a bag directory."""
        self._count += 1
        place = str(bag.relative_to(self._directory)).removeprefix('bags/')
        runs = max(self._count, self._usual)
        self._announce(f'[{self._count}/{runs}] {place}: {planned.description}')
        result = self._run(planned, bag)
        self.wall_seconds[planned.name] = result.wall_seconds
        return result

    def each(self, planned_runs: Sequence[PlannedRun]) -> Iterator[Run]:
        """Do runs one after the other and yield what is in their bags."""
        for planned in planned_runs:
            bag = self._directory / 'bags' / planned.name
            self.one(planned, bag)
            yield read(bag)
