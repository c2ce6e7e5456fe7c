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

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from piezo_ros.model import DynamicsParameters, LinearDynamics
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.parameter_file import (
    parameter_sections,
    read_parameter_set,
    read_yaml,
)

if TYPE_CHECKING:
    import control

    from piezo_ros.identification.prediction.accuracy import ModelAccuracy
    from piezo_ros.identification.tuning.linear_plant import Model
    from piezo_ros.identification.tuning.loop_evidence import LoopEvidence

__all__ = [
    'BOUND_KIND', 'RATIONAL_KIND', 'identified_facts', 'poor_verdict', 'read_accuracy',
    'read_bound', 'read_dynamics', 'read_evidence',
]

BOUND_KIND = 'uncertainty_bound'
RATIONAL_KIND = 'rational_dynamics'
FORMAT_VERSION = 1
_DYNAMICS_FACTS: Final = 'identified_dynamics'
_HYSTERESIS_FACTS: Final = 'identified_hysteresis'
_POOR: Final = 'do not trust'


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


def identified_facts(path: Path, section: str) -> dict[str, Any]:
    """
    Return what an identification says of its own model.

    Parameters
    ----------
    path : Path
        The model file.
    section : str
        ``'identified_dynamics'`` or ``'identified_hysteresis'``.

    Returns
    -------
    dict of str to value
        The section; empty where the file has none, as one that was written by hand.

    Raises
    ------
    PlanError
        If the file cannot be read.

    """
    content = read_yaml(path)
    if not isinstance(content, Mapping):
        return {}
    return {
        name: value for node, values in parameter_sections(content)
        if node.rpartition('/')[2] == section for name, value in values.items()}


def poor_verdict(path: Path) -> str:
    """Return the verdict of a model file that is not to be trusted, '' for any other."""
    for section in (_DYNAMICS_FACTS, _HYSTERESIS_FACTS):
        verdict = str(identified_facts(path, section).get('verdict', ''))
        if verdict.startswith(_POOR):
            return verdict
    return ''


def read_accuracy(paths: Iterable[Path]) -> 'ModelAccuracy':
    """
    Return what the model files of a stage tell of their errors; of several the last one counts.

    Raises
    ------
    PlanError
        If a file cannot be read, or tells something else than numbers.

    """
    from piezo_ros.identification.prediction.accuracy import ModelAccuracy
    values: dict[str, Any] = {}
    for path in paths:
        dynamics = identified_facts(path, _DYNAMICS_FACTS)
        hysteresis = identified_facts(path, _HYSTERESIS_FACTS)
        for name, facts, key in (
            ('model_error', dynamics, 'model_error'),
            ('usable_to_hz', dynamics, 'usable_to_hz'),
            ('hysteresis_rms_um', hysteresis, 'residual_rms_um'),
            ('noise_rms_um', hysteresis, 'noise_rms_um'),
            ('loop_offset_um', hysteresis, 'loop_offset_um'),
        ):
            value = _known_number(path, key, facts)
            if value is not None:
                values[name] = value
        levels = hysteresis.get('amplitude_levels_v', [])
        percents = hysteresis.get('amplitude_residual_percent', [])
        if isinstance(levels, list) and isinstance(percents, list) and (
                0 < len(levels) == len(percents)):
            values['level_v'] = tuple(
                _number(path, 'amplitude_levels_v', value) for value in levels)
            values['level_percent'] = tuple(
                _number(path, 'amplitude_residual_percent', value) for value in percents)
    return ModelAccuracy(**values)


def read_evidence(
    path: Path, model: 'Model', sample_period_s: float, *, trust_band: bool = True,
) -> 'LoopEvidence':
    """
    Return the measured points beside a model of the dynamics, and the error that its file tells.

    Parameters
    ----------
    path : Path
        The model file; its section of facts names the table of points.
    model : LinearDynamics or LinearPlant
        The model in it.
    sample_period_s : float
        Sample period of the loop that is to hold.
    trust_band : bool, optional
        Whether to take what the file tells of the error of the model.

    Raises
    ------
    PlanError
        If the table of points cannot be read.

    """
    from piezo_ros.identification.tuning.loop_evidence import LoopEvidence
    facts = identified_facts(path, _DYNAMICS_FACTS)
    known = {key: _known_number(path, key, facts) for key in ('model_error', 'usable_to_hz')}
    if not trust_band:
        known = {}
    name = str(facts.get('points_file', ''))
    if not name:
        return LoopEvidence.of(model, sample_period_s, [], [], [], sample_period_s, **known)
    from piezo_ros.identification.response.response_csv import read_response
    file = path.parent / name
    try:
        points = read_response(file)
    except (OSError, ValueError) as error:
        raise PlanError(f'{path}: points_file {file}: {error}') from None
    return LoopEvidence.of(
        model, sample_period_s, points.frequency_hz, points.response, points.standard_error,
        points.sample_period_s, **known)


def _known_number(path: Path, name: str, facts: Mapping[str, Any]) -> float | None:
    """Return a number of the facts; None where it is not told, or NaN: it could not be found."""
    value = facts.get(name)
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return None
    return _number(path, name, value)


def _number(path: Path, name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
        raise PlanError(f'{path}: {name} is {value!r}, it must be a number')
    return float(value)
