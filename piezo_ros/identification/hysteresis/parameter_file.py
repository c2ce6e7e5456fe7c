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

"""The ROS parameter file of the compensator, with the standard errors as comments."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification.yaml_text import yaml_list
from piezo_ros.model.hysteresis import HysteresisParameters

__all__ = ['parameter_yaml']

_FORMAT_VERSION: Final = 1

_Floats = NDArray[np.float64]


def parameter_yaml(
    parameters: HysteresisParameters, kappa_standard_error_um_per_v: _Floats,
    saturation_standard_error_v: _Floats, notes: Sequence[str],
) -> str:
    """
    Return the text of a parameter file for the compensator.

    Parameters
    ----------
    parameters : HysteresisParameters
        The n + 1 elements.
    kappa_standard_error_um_per_v : ndarray, shape (n + 1,)
        Standard errors of the compliances.
    saturation_standard_error_v : ndarray, shape (n,)
        Standard errors of the saturation voltages.
    notes : sequence of str
        Comments at the top.

    Returns
    -------
    str
        YAML that ``--params-file`` of ROS 2 and other YAML parsers read as the same numbers.

    """
    lines = [f'model format_version: {_FORMAT_VERSION}', 'MRC hysteresis, identified by piezo_ros']
    for note in notes:
        lines += note.splitlines()
    error_title = f'+- {"std. error":<10}'
    lines += ['', f'{"i":>3}  {"kappa (um/V)":>14} {error_title}  {"u_S (V)":>12} {error_title}']
    limits = [
        f'  {value:12.6g} +- {_error_text(error)}' for value, error in zip(
            parameters.saturation_v, saturation_standard_error_v, strict=True)]
    for i, (value, error, limit) in enumerate(zip(
            parameters.kappa_um_per_v, kappa_standard_error_um_per_v, [*limits, ''], strict=True)):
        lines.append(f'{i + 1:3d}  {value:14.6g} +- {_error_text(error)}{limit}')
    comments = [f'# {line}'.rstrip() for line in lines]
    return '\n'.join([
        *comments,
        '/**/compensator:',
        '  ros__parameters:',
        f'    kappa_um_per_v: {yaml_list(parameters.kappa_um_per_v)}',
        f'    saturation_v: {yaml_list(parameters.saturation_v)}',
        ''])


def _error_text(error: float) -> str:
    return f'{error:<10.2g}' if np.isfinite(error) else f'{"not needed":<10}'
