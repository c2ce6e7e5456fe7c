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

"""The models that a study has identified, as parameter files for nodes, plans and commands."""

from pathlib import Path
from typing import Final, Protocol

from piezo_ros.identification.place.placed_file import undecided_parameter_yaml
from piezo_ros.report.files import write_atomically

__all__ = ['MODELS_BELOW', 'write_models']

MODELS_BELOW: Final = 'models'


class _Hysteresis(Protocol):
    def to_parameter_yaml(self, *, source: str, sample_period_s: float | None = None) -> str: ...


class _Dynamics(Protocol):
    def to_parameter_yaml(self, source: str) -> str: ...


class _Tuning(Protocol):
    def to_parameter_yaml(self, *, source: str) -> str: ...


def write_models(
    directory: Path, hysteresis: _Hysteresis, dynamics: _Dynamics, tuning: _Tuning | None = None,
) -> None:
    """
    Write the models of a study below its output, in the files that `piezo identify` would write.

    Parameters
    ----------
    directory : Path
        The output of the study; ``models/compensator.yaml``, ``models/trajectory.yaml`` and, with
        gains, ``models/controller.yaml`` are written.
    hysteresis : HysteresisFit
        The hysteresis.
    dynamics : DynamicsFit
        The dynamics behind its inverse.
    tuning : PiTuning, optional
        The gains for these.

    Raises
    ------
    OSError
        If a file cannot be written.

    """
    models = directory / MODELS_BELOW
    write_atomically(
        models / 'compensator.yaml', hysteresis.to_parameter_yaml(source='identify_hysteresis'))
    write_atomically(models / 'trajectory.yaml', undecided_parameter_yaml(
        dynamics.to_parameter_yaml('stepped sines behind the identified inverse')))
    if tuning is not None:
        write_atomically(
            models / 'controller.yaml', tuning.to_parameter_yaml(source='trajectory.yaml'))
