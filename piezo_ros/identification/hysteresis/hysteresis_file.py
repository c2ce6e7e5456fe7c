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

from collections.abc import Mapping, Sequence
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification.hysteresis.hysteresis_validation import Validation
from piezo_ros.identification.verdict import Verdict
from piezo_ros.identification.yaml_text import yaml_value
from piezo_ros.model.hysteresis import HysteresisParameters

__all__ = ['hysteresis_facts', 'parameter_yaml']

_FORMAT_VERSION: Final = 1

_Floats = NDArray[np.float64]
Fact: TypeAlias = float | int | str | Sequence[float]


def parameter_yaml(
    parameters: HysteresisParameters, kappa_standard_error_um_per_v: _Floats,
    saturation_standard_error_v: _Floats, notes: Sequence[str],
    facts: Mapping[str, Fact] | None = None,
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
    facts : mapping of str to value, optional
        What stands in a section of its own, which no node reads.

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
    values = {'kappa_um_per_v': parameters.kappa_um_per_v, 'saturation_v': parameters.saturation_v}
    if parameters.asymmetry_threshold_um:  # an empty list has no type in ROS
        values['asymmetry_threshold_um'] = parameters.asymmetry_threshold_um
        values['asymmetry_weight'] = parameters.asymmetry_weight
    sections = [*_section('compensator', values)]
    if facts:
        sections += _section('identified_hysteresis', facts)
    return '\n'.join([*comments, *sections, ''])


def hysteresis_facts(
    validation: Validation, verdict: Verdict, *, rms_um: float, samples_used: int,
    samples_lost: int, delay_samples: float, offset_um: float, loop_offset_um: float,
    range_v: tuple[float, float],
    drift_um_per_sample: float = 0.0, sample_period_s: float | None = None,
) -> dict[str, Fact]:
    """Return what later steps read of an identification, names with units to values."""
    return {
        'verdict': str(verdict),
        'samples_used': samples_used,
        'samples_lost': samples_lost,
        'fit_percent': float(validation.fit_percent),
        'residual_rms_um': rms_um,
        'noise_rms_um': float(validation.noise_rms_um),
        'whiteness': float(validation.whiteness),
        'largest_residual_percent': validation.worst_percent,
        'amplitude_levels_v': [level.amplitude_v for level in validation.levels],
        'amplitude_residual_percent': [level.percent for level in validation.levels],
        'amplitude_uncertainty_percent': [
            level.uncertainty_percent for level in validation.levels],
        'amplitude_residual_rms_um': [
            float(np.sqrt(level.mean_square_um2.sum())) for level in validation.levels],
        # An empty list has no type in ROS.
        **({'residual_order_shares': shares} if (shares := validation.order_shares.tolist())
           else {}),
        'findings': '; '.join(validation.findings),
        'delay_samples': delay_samples,
        'drift_um_per_sample': drift_um_per_sample,
        **({} if sample_period_s is None else {'delay_s': delay_samples * sample_period_s}),
        'offset_um': offset_um,
        'loop_offset_um': loop_offset_um,
        'minimum_v': range_v[0],
        'maximum_v': range_v[1],
    }


def _section(node: str, values: Mapping[str, Fact]) -> list[str]:
    return [f'/**/{node}:', '  ros__parameters:', *(
        f'    {name}: {yaml_value(value)}' for name, value in values.items())]


def _error_text(error: float) -> str:
    return f'{error:<10.2g}' if np.isfinite(error) else f'{"not needed":<10}'
