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
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np

from piezo_ros.model import (
    DynamicsParameters,
    HysteresisParameters,
    LinearDynamics,
    ParameterSet,
)
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.file_lines import with_line
from piezo_ros.parameters.parameter_file import (
    parameter_sections,
    read_yaml,
    set_with_section,
)

if TYPE_CHECKING:
    import control

    from piezo_ros.identification.prediction.accuracy import ModelAccuracy
    from piezo_ros.identification.tuning.linear_plant import Model
    from piezo_ros.identification.tuning.loop_evidence import LoopEvidence

__all__ = [
    'BOUND_KIND', 'HYSTERESIS_NAMES', 'RATIONAL_KIND', 'identified_facts', 'missing_of_model',
    'poor_verdict', 'read_accuracy', 'read_bound', 'read_dynamics', 'read_evidence', 'read_model',
    'recorded_period_s',
]

BOUND_KIND = 'uncertainty_bound'
RATIONAL_KIND = 'rational_dynamics'
FORMAT_VERSION = 1
_DYNAMICS_FACTS: Final = 'identified_dynamics'
_HYSTERESIS_FACTS: Final = 'identified_hysteresis'
_POOR: Final = 'do not trust'
HYSTERESIS_NAMES: Final = ('kappa_um_per_v', 'saturation_v')
_DYNAMICS: Final = (
    'gain_k_rad3_per_s3', 'zero_b1_rad_per_s', 'zero_b2_rad2_per_s2', 'time_constant_s',
    'damping_ratio_1', 'natural_frequency_1_rad_per_s', 'damping_ratio_2',
    'natural_frequency_2_rad_per_s')
_Set = TypeVar('_Set', bound=ParameterSet)


def missing_of_model(values: Mapping[str, Any], parameter_set: type[ParameterSet]) -> list[str]:
    """
    Return the parameters without which a model is another stage's.

    Parameters
    ----------
    values : mapping of str to value
        What is told.
    parameter_set : type of ParameterSet
        `HysteresisParameters` or `DynamicsParameters`.

    """
    names: tuple[str, ...] = HYSTERESIS_NAMES
    if parameter_set is DynamicsParameters:
        # Lists of sections are checked together when they are taken.
        names = () if values.get('dynamics', 'liu') == 'sections' else _DYNAMICS
    return [name for name in names if name not in values]


def read_model(
    path: Path, parameter_set: type[_Set], node: str = '', assumed: Mapping[str, Any] | None = None,
) -> _Set:
    """
    Return hysteresis or dynamics out of a parameter file that tells the whole of them.

    Parameters
    ----------
    path : Path
        The file.
    parameter_set : type of HysteresisParameters or DynamicsParameters
        The model.
    node : str, optional
        The node that has it: by default ``compensator`` of a hysteresis, ``trajectory`` of
        dynamics.
    assumed : mapping of str to value, optional
        As for `read_parameter_set`.

    Raises
    ------
    PlanError
        If the file has no section for the node, a value that this refuses, or not the whole model:
        the defaults are those of one stage, that of the paper.

    """
    is_dynamics = issubclass(parameter_set, DynamicsParameters)
    node = node or ('trajectory' if is_dynamics else 'compensator')
    model, section = set_with_section(path, node, parameter_set, assumed)
    missing = missing_of_model(
        section, DynamicsParameters if is_dynamics else HysteresisParameters)
    if missing:
        raise PlanError(
            f'{with_line(path, section, "")}: the model of the {node} lacks '
            f'{", ".join(missing)}; it must be whole, as piezo identify writes it: the defaults '
            'are those of the stage of the paper')
    return model


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
        _check_finite(path, content, ('numerator', 'denominator'))
        return control.tf(content['numerator'], content['denominator'])
    except KeyError as error:
        raise PlanError(f'{path} has no {error.args[0]!r}') from None
    except (TypeError, ValueError) as error:
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
        return LinearDynamics(read_model(path, DynamicsParameters))
    from piezo_ros.identification.tuning.linear_plant import LinearPlant
    content = _read_kind(path, content, RATIONAL_KIND)
    try:
        _check_finite(path, content, ('numerator', 'denominator', 'delay_s'))
        return LinearPlant(
            np.array(content['numerator'], dtype=np.float64),
            np.array(content['denominator'], dtype=np.float64), float(content['delay_s']))
    except KeyError as error:
        raise PlanError(f'{path} has no {error.args[0]!r}') from None
    except (TypeError, ValueError) as error:
        raise PlanError(f'{path}: {error}') from None


def _is_finite(value: Any) -> bool:
    """Return whether a value is a number that limits something; True and False are none."""
    return (
        isinstance(value, int | float) and not isinstance(value, bool)
        and abs(value) <= sys.float_info.max)


def _check_finite(path: Path, content: Mapping[str, Any], names: Iterable[str]) -> None:
    """Refuse what is no number, or none that limits anything."""
    for name in names:
        value = content[name]
        for each in value if isinstance(value, list) else [value]:
            if not _is_finite(each):
                raise PlanError(
                    f'{with_line(path, content, name)}: {name} is {value!r}, it must be finite '
                    'numbers')


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
    return _facts(read_yaml(path), section)


def _facts(content: Any, section: str) -> dict[str, Any]:
    """Return a section of what a model file has, empty where it has none."""
    if not isinstance(content, Mapping):
        return {}
    return {
        name: value for node, values in parameter_sections(content)
        if node.rpartition('/')[2] == section for name, value in values.items()}


def poor_verdict(path: Path) -> str:
    """Return the verdict of a model file that is not to be trusted, '' for any other."""
    content = read_yaml(path)
    for section in (_DYNAMICS_FACTS, _HYSTERESIS_FACTS):
        verdict = str(_facts(content, section).get('verdict', ''))
        if verdict.startswith(_POOR):
            return verdict
    return ''


def recorded_period_s(path: Path) -> float | None:
    """
    Return the sample period of the record that a model was identified from, None if not told.

    Raises
    ------
    PlanError
        If it is no number above 0.

    """
    content = read_yaml(path)
    for section in (_DYNAMICS_FACTS, _HYSTERESIS_FACTS):
        value = _facts(content, section).get('sample_period_s')
        if value is None:
            continue
        if not (_is_finite(value) and value > 0.0):
            raise PlanError(f'{path}: sample_period_s is {value!r}, it must be a number above 0')
        return float(value)
    return None


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
            rms = hysteresis.get('amplitude_residual_rms_um', [])
            shares = hysteresis.get('residual_order_shares', [])
            if isinstance(rms, list) and len(rms) == len(levels):
                values['level_rms_um'] = tuple(
                    _number(path, 'amplitude_residual_rms_um', value) for value in rms)
            if isinstance(shares, list) and shares:
                values['order_share'] = tuple(
                    _number(path, 'residual_order_shares', value) for value in shares)
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
