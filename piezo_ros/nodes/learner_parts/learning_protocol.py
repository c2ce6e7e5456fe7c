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

"""What the learner needs of the mathematics; it is given to the node by its executable."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.tables.table_changes import TableChange
from piezo_ros.parameters.node_parameters import LearnerParameters

__all__ = ['Learning', 'MakeLearning']

_Floats = NDArray[np.float64]


class Learning(Protocol):
    """The learning of one run, from its samples; see `RunningLearning`."""

    wanted_file: str
    why_done: str

    @property
    def is_done(self) -> bool:
        """Whether nothing follows the table in use."""

    @property
    def is_measured(self) -> bool:
        """Whether the table in use can be improved."""

    def take(self, index: int, reference_um: _Floats, displacement_um: _Floats) -> None:
        """Take the next samples of the run."""

    def improve(self) -> None:
        """Learn from what was measured, and write the next table."""

    def change_from(self, earliest: int) -> TableChange:
        """Return the change to the table that shall follow, at a sample or soon after it."""

    def accept(self, change: TableChange) -> None:
        """Take note that the trajectory plays the table."""

    def refuse(self, reason: str) -> None:
        """Take note that the trajectory keeps its table."""

    def end(self) -> None:
        """Take note that the run has ended."""

    def status(self) -> dict[str, Any]:
        """Return what came of it so far."""


# Settings, output directory, parameters of trajectory and controller -> what learns.
MakeLearning = Callable[
    [LearnerParameters, Path, Mapping[str, Any], Mapping[str, Any]], Learning]
