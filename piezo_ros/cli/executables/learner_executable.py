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

"""The executable of the learner node, which joins the node with what it learns by."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from piezo_ros.nodes.executables import run_learner

if TYPE_CHECKING:
    from piezo_ros.nodes.learner_parts.learning_protocol import Learning
    from piezo_ros.parameters.node_parameters import LearnerParameters

__all__ = ['learner']


def learner() -> int:
    """Run the learner node."""
    return run_learner(_make_learning)


def _make_learning(
    own: 'LearnerParameters', directory: Path, trajectory: Mapping[str, Any],
    controller: Mapping[str, Any],
) -> 'Learning':
    from piezo_ros.control import ControllerParameters, TrajectoryParameters
    from piezo_ros.experiment.running_learning import RunningLearning
    return RunningLearning(
        Path(own.scan), directory, TrajectoryParameters.among(trajectory),
        ControllerParameters.among(controller), runs=own.runs, settling_s=own.settling_s)


if __name__ == '__main__':
    raise SystemExit(learner())
