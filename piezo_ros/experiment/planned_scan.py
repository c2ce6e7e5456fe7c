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

"""
Planned scans as files: made from identified models, played by the nodes, read back to be learned.

A planned scan is a ROS parameter file for the trajectory node, beside it its motion (NPZ). A
further section of the file, ``planned_scan``, which ROS ignores, has what the plan was made of.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from piezo_ros.control.tables.motion_table import MotionTable, write_motion_table
from piezo_ros.experiment.model_file import identified_facts
from piezo_ros.experiment.motion_files import MOTION_SUFFIX
from piezo_ros.model import (
    DynamicsParameters,
    HysteresisParameters,
    ParameterError,
)
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.parameter_file import parameters_yaml
from piezo_ros.planning.constrained_step import AmplifierLimits
from piezo_ros.planning.harmonics import harmonic_basis, orders_of_band
from piezo_ros.planning.periodic_plan import PeriodicPlan, known_plan
from piezo_ros.planning.scan import ScanRequest, limits_of, planned_scan, stage_of
from piezo_ros.report.files import put_in_place, write_atomically

__all__ = [
    'ScanRequest', 'limits_of', 'motion_of', 'planned_scan', 'read_planned_scan', 'stage_of',
    'write_motion', 'write_planned_scan',
]

FACTS: Final = 'planned_scan'
FORMAT_VERSION: Final = 1


def motion_of(
    request: ScanRequest, plan: PeriodicPlan, compensator: HysteresisParameters | None = None,
) -> MotionTable:
    """
    Return the motion of a plan: its soft start, one repetition to settle, and one to repeat.

    Parameters
    ----------
    request : ScanRequest
        What was wanted.
    plan : PeriodicPlan
        The plan.
    compensator : HysteresisParameters, optional
        What the compensator inverts; that of the plan by default.

    """
    samples = plan.reference_um.size
    ramp = math.ceil(
        (request.ramp_periods + 1.0) / (request.frequency_hz * request.sample_period_s))
    ramp += plan.mean_start_samples(request.ramp_periods)
    first = (math.ceil(ramp / samples) + 1) * samples
    count = first + samples
    about_mean_um = np.resize(plan.reference_um, count) - request.offset_um
    return MotionTable(
        request.offset_um * plan.mean_start(count, request.ramp_periods)
        + about_mean_um * plan.soft_start(count, request.ramp_periods),
        plan.command_um(count, compensator or request.hysteresis, request.ramp_periods),
        request.sample_period_s, repeat_from=first)


def write_planned_scan(
    path: Path, request: ScanRequest, plan: PeriodicPlan, notes: Sequence[str] = (),
) -> tuple[Path, ...]:
    """
    Write a planned scan and return its files.

    Parameters
    ----------
    path : Path
        The parameter file to write; the motion gets its name and the suffix ``.npz``.
    request : ScanRequest
        What was wanted.
    plan : PeriodicPlan
        The plan.
    notes : sequence of str, optional
        Comments at the top.

    """
    facts = {name: value for name, value in _facts(request, plan).items() if value != []}
    return _write(path, motion_of(request, plan), request.dynamics, notes, {
        'amplitude_um': request.amplitude_um, 'frequency_hz': request.frequency_hz}, facts)


def write_motion(
    path: Path, table: MotionTable, dynamics: DynamicsParameters, amplitude_um: float,
    notes: Sequence[str] = (),
) -> tuple[Path, ...]:
    """
    Write a motion that is played once and return its files.

    Parameters
    ----------
    path : Path
        The parameter file to write; the motion gets its name and the suffix ``.npz``.
    table : MotionTable
        The motion.
    dynamics : DynamicsParameters
        The model that it was planned with.
    amplitude_um : float
        Its largest displacement.
    notes : sequence of str, optional
        Comments at the top.

    """
    # As far as something is periodic here, it is the whole.
    length_s = table.reference_um.size * table.sample_period_s
    return _write(path, table, dynamics, notes, {
        'amplitude_um': amplitude_um, 'frequency_hz': 1.0 / length_s, 'periods': 1.0})


def _write(
    path: Path, table: MotionTable, dynamics: DynamicsParameters, notes: Sequence[str],
    scan: Mapping[str, float], facts: Mapping[str, Any] | None = None,
) -> tuple[Path, ...]:
    """Write a motion and the parameter file that plays it."""
    motion_path = path.parent.resolve() / path.with_suffix(MOTION_SUFFIX).name
    with put_in_place(motion_path) as unfinished:
        write_motion_table(unfinished, table)
    sections: dict[str, Mapping[str, Any]] = {'trajectory': {
        'waveform': 'file', 'file': str(motion_path), 'sample_period_s': table.sample_period_s,
        'harmonics': 0, **scan, **_given(dynamics)}}
    if facts:
        sections[FACTS] = facts
    text = ''.join(f'# {line}\n' for note in notes for line in note.splitlines())
    write_atomically(path, text + parameters_yaml('/**', sections))
    return path, motion_path


def _given(parameters: DynamicsParameters) -> dict[str, Any]:
    """Return the parameters but for empty lists, in which ROS cannot tell the type."""
    return {name: value for name, value in parameters.to_mapping().items() if value != []}


def _facts(request: ScanRequest, plan: PeriodicPlan) -> dict[str, Any]:
    facts: dict[str, Any] = {
        'format_version': FORMAT_VERSION,
        'waveform': request.waveform, 'offset_um': request.offset_um,
        'turn_fraction': request.turn_fraction, 'flyback_fraction': request.flyback_fraction,
        'band_hz': request.band, 'free_turn': request.free_turn,
        'ramp_periods': request.ramp_periods, 'uncertainty': request.uncertainty,
        'uncertainty_percent': request.uncertainty_percent, 'noise_rms_um': request.noise_rms_um,
        'kappa_um_per_v': list(request.hysteresis.kappa_um_per_v),
        'saturation_v': list(request.hysteresis.saturation_v),
        'asymmetry_threshold_um': list(request.hysteresis.asymmetry_threshold_um),
        'asymmetry_weight': list(request.hysteresis.asymmetry_weight),
        'coefficients_v': plan.coefficients_v.tolist(),
        'predicted_nrmse_percent': plan.predicted_nrmse_percent,
        'truncation_percent': plan.truncation_percent,
        'limit_use': plan.limit_use,
        'certificate_gamma': plan.certificate.gamma,
    }
    for name in ('slew_v_per_s', 'average_slew_v_per_s', 'minimum_v', 'maximum_v'):
        value = getattr(request.limits, name)
        if math.isfinite(value):
            facts[name] = value
    return facts


def read_planned_scan(path: Path) -> tuple[ScanRequest, PeriodicPlan]:
    """
    Read a planned scan back.

    Parameters
    ----------
    path : Path
        What `write_planned_scan` wrote.

    Raises
    ------
    PlanError
        If the file is none, or of an unknown version.

    """
    facts = identified_facts(path, FACTS)
    trajectory = identified_facts(path, 'trajectory')
    if not facts or not trajectory:
        raise PlanError(f'{path} is no planned scan: it has no section {FACTS}')
    version = facts.get('format_version')
    if version != FORMAT_VERSION:
        raise PlanError(
            f'{path}: format_version of {FACTS} is {version!r}, only {FORMAT_VERSION} is known')
    try:
        request = _request(facts, trajectory)
        return request, _known(request, facts)
    except KeyError as error:
        raise PlanError(f'{path}: {FACTS} has no {error.args[0]}') from None
    except (TypeError, ValueError) as error:
        raise PlanError(f'{path}: {error}') from None


def _known(request: ScanRequest, facts: Mapping[str, Any]) -> PeriodicPlan:
    """Return the plan of which a file has the coefficients."""
    orders = orders_of_band(
        request.band, request.frequency_hz, request.sample_period_s,
        is_symmetric=request.is_symmetric)
    coefficients_v = np.array(facts['coefficients_v'], dtype=np.float64)
    size = harmonic_basis(np.zeros(1), orders).shape[1]
    if coefficients_v.shape != (size,):
        raise ValueError(
            f'coefficients_v has {coefficients_v.size} values, the band has {size}')
    return known_plan(
        stage_of(request), request.reference_um, request.frequency_hz, request.sample_period_s,
        orders=orders, coefficients_v=coefficients_v,
        truncation_percent=float(facts['truncation_percent']), limits=request.limits,
        weight=request.weight, accuracy=request.accuracy)


def _request(facts: Mapping[str, Any], trajectory: Mapping[str, Any]) -> ScanRequest:
    limits = {
        name: float(facts[name])
        for name in ('slew_v_per_s', 'average_slew_v_per_s', 'minimum_v', 'maximum_v')
        if name in facts}
    hysteresis = HysteresisParameters.among(facts)
    if not {'kappa_um_per_v', 'saturation_v'} <= facts.keys():
        raise ParameterError('the hysteresis is not there')
    return ScanRequest(
        waveform=str(facts['waveform']), amplitude_um=float(trajectory['amplitude_um']),
        frequency_hz=float(trajectory['frequency_hz']),
        sample_period_s=float(trajectory['sample_period_s']),
        dynamics=DynamicsParameters.among(trajectory), hysteresis=hysteresis,
        limits=AmplifierLimits(**limits), band_hz=float(facts['band_hz']),
        free_turn=float(facts['free_turn']), ramp_periods=float(facts['ramp_periods']),
        uncertainty=float(facts['uncertainty']),
        uncertainty_percent=float(facts.get('uncertainty_percent', 0.0)),
        noise_rms_um=float(facts.get('noise_rms_um', 0.0)),
        **{name: float(facts[name])
           for name in ('offset_um', 'turn_fraction', 'flyback_fraction') if name in facts})
