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

"""The device that a parameter file tells of, for commands that use it without a graph."""

from pathlib import Path
from typing import Any

from piezo_ros.model import ParameterError
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.file_lines import LinedMapping, with_line
from piezo_ros.parameters.hardware_parameters import HardwareParameters
from piezo_ros.parameters.node_parameters import HARDWARE_PLANT, parameter_names
from piezo_ros.parameters.parameter_file import read_parameter_file
from piezo_ros.suggestions import did_you_mean

__all__ = ['read_hardware']


def read_hardware(path: Path) -> HardwareParameters:
    """
    Return the hardware parameters in the section of the plant.

    Parameters
    ----------
    path : Path
        A ROS parameter file. What it says of a simulated rig is left out.

    Raises
    ------
    PlanError
        If it has no plant with a device, or a value that is refused.

    """
    values: dict[str, Any] = read_parameter_file(path, ['plant']).get('plant', LinedMapping())
    if 'device' not in values:
        raise PlanError(f'{path} has no section for plant with a device')
    known = {*parameter_names(HARDWARE_PLANT), *parameter_names('plant')}
    for name in values:
        if name not in known:
            raise PlanError(
                f'{with_line(path, values, name)}: unknown parameter {name!r} of '
                f'{HARDWARE_PLANT}{did_you_mean(name, known)}')
    try:
        return HardwareParameters.among(values)
    except ParameterError as error:
        raise PlanError(f'{with_line(path, values, str(error))}: {error}') from None
