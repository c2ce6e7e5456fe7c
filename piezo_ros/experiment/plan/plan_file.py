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

"""Plans: which runs to do, read from YAML and checked before anything is started."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from piezo_ros.experiment.model_file import read_accuracy, read_bound
from piezo_ros.experiment.motion_files import with_motion_files
from piezo_ros.experiment.plan.automatic import KNOWN_NODES, Known
from piezo_ros.experiment.plan.entry_effects import refuse_two_values, refuse_without_effect
from piezo_ros.experiment.plan.entry_keys import refuse_unknown
from piezo_ros.experiment.plan.hardware_entry import ignored_of_rig, is_of_hardware
from piezo_ros.experiment.plan.model_rig import MODEL_RIG_KEY, model_rig, model_rig_notes
from piezo_ros.experiment.plan.raster_scan import RasterScan, read_scans
from piezo_ros.experiment.plan.run_entry import RUN_KEYS, SHORT_KEYS, checked_parameters, plan_run
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.file_lines import naming_line, with_line
from piezo_ros.parameters.node_parameters import LOOP_NODES
from piezo_ros.parameters.parameter_file import (
    parameters_of_rclpy,
    read_parameter_file,
    read_yaml,
)
from piezo_ros.parameters.run_and_result import PlannedRun

__all__ = ['PLAN_KEYS', 'STUDIES', 'Plan', 'read_plan']

FORMAT_VERSION: Final = 1
PLAN_KEYS: Final = (
    'format_version', 'title', 'parameter_files', MODEL_RIG_KEY, 'known_rig_files',
    'uncertainty_bound_file',
    'sample_period_s', 'score_periods', 'runs', 'study', 'sweep', 'scans', 'scan_defaults')
_KEYS_OF_RUNS: Final = (
    'runs', 'known_rig_files', 'uncertainty_bound_file', 'sweep', 'scans', 'scan_defaults')
_NOT_OF_SCANS: Final = ('runs', 'sweep', 'score_periods', 'uncertainty_bound_file')
STUDIES: Final = ('paper', 'beyond')
# A sweep draws more of them, and keeps none in memory.
_MOST_RUNS: Final = 10_000
_LONGEST_TITLE: Final = 500


@dataclass(frozen=True)
class Plan:
    """
    A plan.

    Attributes
    ----------
    path : Path
        Where it was read from.
    title : str
        Title of the report.
    score_periods : float
        Periods at the end of each run that are scored.
    runs : tuple of PlannedRun
        The runs, in order; none for a study, which makes its own.
    base : mapping of str to mapping
        Node to the parameters of the parameter files.
    study : str
        One of `STUDIES`, '' for none.
    entries : tuple of mapping
        What the plan says of each run.
    known : Known
        What it tells of the rig beside.
    sweep : mapping or None
        What it says of a sweep, see `piezo_ros.experiment.sweep.sweep_plan`; None for none.
    notes : tuple of str
        What of its parameter files is ignored.
    scans : tuple of RasterScan
        Its raster scans, which are in place of runs.

    """

    path: Path
    title: str
    score_periods: float
    runs: tuple[PlannedRun, ...]
    base: Mapping[str, Mapping[str, Any]]
    study: str = ''
    entries: tuple[Mapping[str, Any], ...] = ()
    known: Known = field(default_factory=Known)
    sweep: Any = None
    notes: tuple[str, ...] = ()
    scans: tuple[RasterScan, ...] = ()


def read_plan(path: Path) -> Plan:
    """
    Read a plan and check every run of it.

    Parameters
    ----------
    path : Path
        A YAML file; see config/experiments/demo.yaml. A list in a run stands for one run each.
        ``auto`` for scheme or harmonics is decided here, see config/experiments/automatic.yaml.

    Returns
    -------
    Plan
        The checked plan.

    Raises
    ------
    PlanError
        For an unknown key, a value out of range, an amplitude beyond the travel, a frequency above
        Nyquist; the text names file, run, key and value.

    """
    content = read_yaml(path)
    if not isinstance(content, Mapping):
        raise PlanError(f'{path} is no plan: the top level must be a mapping')
    with naming_line(str(path), path, content):
        refuse_unknown(str(path), content, PLAN_KEYS)
    version = content.get('format_version')
    if version != FORMAT_VERSION or isinstance(version, bool):
        raise PlanError(f'{path}: format_version is {version!r}, only {FORMAT_VERSION} is known')
    base = _read_sections(path, content, 'parameter_files', LOOP_NODES)
    base['plant'] = {**model_rig(path, _read_sections(
        path, content, MODEL_RIG_KEY, ('compensator', 'trajectory')), content), **base['plant']}
    if 'sample_period_s' in content:
        for node in LOOP_NODES:
            base[node]['sample_period_s'] = content['sample_period_s']
    title = _title(path, content.get('title', path.stem))
    if 'study' in content:
        if content['study'] not in STUDIES:
            raise PlanError(
                f'{path}: study is {content["study"]!r}, allowed are {", ".join(STUDIES)}')
        for key in _KEYS_OF_RUNS:
            if key in content:
                raise PlanError(f'{path}: a study makes its own runs, there must be no key {key}')
        if is_of_hardware(base['plant']):
            raise PlanError(f'{path}: a study is of the simulated rig, plant must have no device')
        return Plan(
            path, title, 4.0, (), base, str(content['study']), notes=_notes(path, content))
    if scans := read_scans(
            path, content, base, _read_known(path, content).sections,
            lambda values, key, nodes: _read_sections(path, values, key, nodes)):
        for key in _NOT_OF_SCANS:
            if key in content:
                raise PlanError(f'{path}: beside scans there must be no key {key}')
        if is_of_hardware(base['plant']):
            raise PlanError(f'{path}: scans are of simulated rigs, plant must have no device')
        return Plan(path, title, 4.0, (), base, notes=_notes(path, content), scans=scans)
    entries = _list(path, 'runs', content.get('runs'))
    score_periods = content.get('score_periods', 4)
    if isinstance(score_periods, bool) or not isinstance(score_periods, int | float):
        raise PlanError(f'{path}: score_periods is {score_periods!r}, it must be a number')
    known = _read_known(path, content)
    runs: list[PlannedRun] = []
    combinations: list[dict[str, Any]] = []
    for number, entry in enumerate(entries, start=1):
        where = f'{path}: run {number}'
        if not isinstance(entry, Mapping):
            raise PlanError(f'{where} is {entry!r}, it must be a mapping')
        with naming_line(where, path, entry):
            refuse_unknown(where, entry, RUN_KEYS)
            refuse_two_values(where, entry)
        _check_count(where, entry, len(runs))
        alternatives = _combinations(where, entry)
        with naming_line(where, path, entry):
            refuse_without_effect(where, base['trajectory'], alternatives)
        for alternative in alternatives:
            combination = with_motion_files(path.parent, alternative)
            combinations.append(combination)
            with naming_line(where, path, entry):
                runs.append(plan_run(
                    base, combination, where=where, number=len(runs), known=known,
                    score_periods=score_periods))
    if not runs:
        raise PlanError(f'{path}: runs is empty')
    for run in runs:
        periods = run.trajectory.periods
        if not 0.0 < score_periods <= periods:
            raise PlanError(
                f'{with_line(path, content, "score_periods")}: score_periods is {score_periods}, '
                f'it must be above 0, and at most {periods:g} (periods of {run.name})')
    if 'sweep' in content and not isinstance(content['sweep'], Mapping):
        raise PlanError(f'{path}: sweep is {content["sweep"]!r}, it must be a mapping')
    if 'sweep' in content and any(run.hardware for run in runs):
        raise PlanError(f'{path}: a sweep is of the simulated rig, plant must have no device')
    return Plan(
        path, title, float(score_periods), tuple(runs), base, entries=tuple(combinations),
        known=known, sweep=content.get('sweep'),
        notes=(*_notes(path, content), *_notes_of_devices(path, base, combinations)))


def _read_sections(
    path: Path, content: Mapping[str, Any], key: str, nodes: Sequence[str],
) -> dict[str, dict[str, Any]]:
    """Return the parameters that some parameter files of a plan give to each node."""
    sections: dict[str, dict[str, Any]] = {node: {} for node in nodes}
    for name in _list(path, key, content.get(key, [])):
        if not isinstance(name, str):
            raise PlanError(f'{path}: {key} has {name!r}, it must be the name of a file')
        file = path.parent / name
        for node, values in read_parameter_file(file, nodes).items():
            checked_parameters(str(file), node, values)
            sections[node].update(with_motion_files(file.parent, values))
    return sections


def _notes(path: Path, content: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what the parameter files give to the nodes and a plan does not pass on."""
    names = _list(path, 'parameter_files', content.get('parameter_files', []))
    files = [path.parent / str(name) for name in names]
    return *model_rig_notes(path, content), *(
        f'{file}: {", ".join(own)} of {node} is ignored: a plan has its own time and QoS'
        for file in files for node, own in parameters_of_rclpy(file, LOOP_NODES).items())


def _notes_of_devices(
    path: Path, base: Mapping[str, Mapping[str, Any]], entries: Sequence[Mapping[str, Any]],
) -> tuple[str, ...]:
    """Return which parameters of a simulated rig a plan gives to real devices in vain."""
    ignored = {
        name for entry in entries
        for name in ignored_of_rig({**base['plant'], **entry.get('plant', {})})}
    if not ignored:
        return ()
    return (
        f'{path}: {", ".join(sorted(ignored))} of plant is ignored: the device is a real stage',)


def _read_known(path: Path, content: Mapping[str, Any]) -> Known:
    sections = _read_sections(path, content, 'known_rig_files', KNOWN_NODES)
    if content.get('known_rig_files') and not any(sections.values()):
        raise PlanError(
            f'{path}: known_rig_files say nothing of {", ".join(KNOWN_NODES)}')
    file = content.get('uncertainty_bound_file', '')
    if not isinstance(file, str) or (not file and 'uncertainty_bound_file' in content):
        raise PlanError(
            f'{path}: uncertainty_bound_file is {file!r}, it must be the name of a file')
    # Later files count more, and what is known of the rig more than what the runs have.
    files = [
        path.parent / str(name) for key in ('parameter_files', 'known_rig_files')
        for name in _list(path, key, content.get(key, []))]
    return Known(
        sections, read_bound(path.parent / file) if file else None,
        read_accuracy(files))


def _combinations(where: str, entry: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return one mapping for each combination of the listed values; the last key runs fastest."""
    for key, value in entry.items():
        if key in SHORT_KEYS and value == []:
            raise PlanError(f'{where}: {key} is an empty list, it must have at least one value')
    choices = [
        value if key in SHORT_KEYS and isinstance(value, list) else [value]
        for key, value in entry.items()]
    return [dict(zip(entry, values, strict=True)) for values in itertools.product(*choices)]


def _check_count(where: str, entry: Mapping[str, Any], before: int) -> None:
    """Refuse more combinations than a plan may have, before they are made."""
    lengths = {
        key: len(value) for key, value in entry.items()
        if key in SHORT_KEYS and isinstance(value, list)}
    runs = before + math.prod(lengths.values())
    if runs > _MOST_RUNS:
        lists = ' x '.join(f'{count} of {key}' for key, count in lengths.items())
        raise PlanError(
            f'{where}: the plan has {runs} runs with it ({lists or 1}), allowed are '
            f'{_MOST_RUNS}; a sweep draws parameters for more')


def _title(path: Path, value: Any) -> str:
    if isinstance(value, bool) or not isinstance(value, str | int | float) or value != value:
        raise PlanError(f'{path}: title is a {type(value).__name__}, it must be a text')
    title = str(value)
    if len(title) > _LONGEST_TITLE:
        raise PlanError(
            f'{path}: title has {len(title)} characters, allowed are {_LONGEST_TITLE}')
    return title


def _list(path: Path, key: str, value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise PlanError(f'{path}: {key} is {value!r}, it must be a list')
    return value
