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

"""Models that identification and tuning wrote, read back for the next step."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from piezo_ros.model import DynamicsParameters, LinearDynamics
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.parameter_file import read_parameter_set, read_yaml

if TYPE_CHECKING:
    import control

    from piezo_ros.identification.tuning.linear_plant import Model

__all__ = ['BOUND_KIND', 'RATIONAL_KIND', 'read_bound', 'read_dynamics']

BOUND_KIND = 'uncertainty_bound'
RATIONAL_KIND = 'rational_dynamics'
FORMAT_VERSION = 1


def read_bound(path: Path) -> 'control.TransferFunction':
    """
    Return W(s) out of a file that ``piezo identify uncertainty`` wrote.

    Raises
    ------
    PlanError
        If the file is of another kind or of an unknown version.

    """
    import control
    content = _read_kind(path, read_yaml(path), BOUND_KIND)
    try:
        return control.tf(content['numerator'], content['denominator'])
    except (KeyError, TypeError, ValueError) as error:
        raise PlanError(f'{path}: {error}') from None


def read_dynamics(path: Path) -> 'Model':
    """
    Return G(s) out of a file that ``piezo identify dynamics`` wrote, (6) or a rational one.

    Raises
    ------
    PlanError
        If the file is of another kind or of an unknown version.

    """
    content = read_yaml(path)
    if not (isinstance(content, Mapping) and 'kind' in content):
        return LinearDynamics(read_parameter_set(path, 'trajectory', DynamicsParameters))
    from piezo_ros.identification.tuning.linear_plant import LinearPlant
    content = _read_kind(path, content, RATIONAL_KIND)
    try:
        return LinearPlant(
            np.array(content['numerator'], dtype=np.float64),
            np.array(content['denominator'], dtype=np.float64), float(content['delay_s']))
    except (KeyError, TypeError, ValueError) as error:
        raise PlanError(f'{path}: {error}') from None


def _read_kind(path: Path, content: Any, kind: str) -> Mapping[str, Any]:
    if not isinstance(content, Mapping) or content.get('kind') != kind:
        raise PlanError(f'{path} is no {kind}')
    if content.get('format_version') != FORMAT_VERSION:
        raise PlanError(
            f'{path}: format_version is {content.get("format_version")!r}, only {FORMAT_VERSION} '
            'is known')
    return content
