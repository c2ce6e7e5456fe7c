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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

from piezo_ros.control.changes import changes_text, segments
from piezo_ros.control.waveform import EXCITATIONS
from piezo_ros.experiment.automatic import AUTO, KNOWN_STAGES, known_rig, predict
from piezo_ros.experiment.model_file import read_bound
from piezo_ros.model import ParameterError, ParameterSet, RigParameters
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.node_parameters import LOOP_NODES, check_node_parameters
from piezo_ros.parameters.parameter_file import read_parameter_file, read_yaml
from piezo_ros.parameters.run import PlannedRun

if TYPE_CHECKING:
    from piezo_ros.identification.tuning.linear_plant import Bound

__all__ = ['STUDIES', 'Known', 'Plan', 'plan_run', 'read_plan']

_Set = TypeVar('_Set', bound=ParameterSet)
FORMAT_VERSION: Final = 1
_PLAN_KEYS: Final = (
    'format_version', 'title', 'parameter_files', 'known_rig_files', 'uncertainty_bound_file',
    'sample_period_s', 'score_periods', 'runs', 'study', 'sweep')
_RUN_KEYS: Final = ('runs', 'known_rig_files', 'uncertainty_bound_file', 'sweep')
STUDIES: Final = ('paper',)
# The keys of a run that are short for a parameter of a node; every other key names a node.
_SHORT_KEYS: Final = {
    'scheme': 'controller',
    'waveform': 'trajectory',
    'amplitude_um': 'trajectory',
    'frequency_hz': 'trajectory',
    'harmonics': 'trajectory',
    'periods': 'trajectory',
    'ramp_periods': 'trajectory',
    'output': 'trajectory',
    'amplitude_v': 'trajectory',
    'offset_um': 'trajectory',
    'offset_v': 'trajectory',
    'dwell_s': 'trajectory',
    'settle_s': 'trajectory',
}
_CHANGES: Final = 'changes'


@dataclass(frozen=True)
class Known:
    """
    What a plan tells of the rig beside its stages, for the runs that leave something to ``auto``.

    Attributes
    ----------
    sections : mapping of str to mapping
        Stage to parameters, out of ``known_rig_files``.
    bound : control.TransferFunction or None
        W(s), out of ``uncertainty_bound_file``.

    """

    sections: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    bound: 'Bound | None' = None


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
        Stage to the parameters of the parameter files.
    study : str
        One of `STUDIES`, '' for none.
    entries : tuple of mapping
        What the plan says of each run.
    known : Known
        What it tells of the rig beside.
    sweep : mapping or None
        What it says of a sweep, see `piezo_ros.experiment.sweep_plan`; None for none.

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
    _refuse_unknown(str(path), content, _PLAN_KEYS)
    version = content.get('format_version')
    if version != FORMAT_VERSION:
        raise PlanError(f'{path}: format_version is {version!r}, only {FORMAT_VERSION} is known')
    base = _read_sections(path, content, 'parameter_files', LOOP_NODES)
    if 'sample_period_s' in content:
        for stage in LOOP_NODES:
            base[stage]['sample_period_s'] = content['sample_period_s']
    title = str(content.get('title', path.stem))
    if 'study' in content:
        if content['study'] not in STUDIES:
            raise PlanError(
                f'{path}: study is {content["study"]!r}, allowed are {", ".join(STUDIES)}')
        for key in _RUN_KEYS:
            if key in content:
                raise PlanError(f'{path}: a study makes its own runs, there must be no key {key}')
        return Plan(path, title, 4.0, (), base, str(content['study']))
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
        _refuse_unknown(where, entry, (*_SHORT_KEYS, *LOOP_NODES, _CHANGES))
        for combination in _combinations(where, entry):
            combinations.append(combination)
            runs.append(plan_run(
                base, combination, where=where, number=len(runs), known=known,
                score_periods=score_periods))
    if not runs:
        raise PlanError(f'{path}: runs is empty')
    for run in runs:
        periods = run.trajectory.periods
        if not 0.0 < score_periods <= periods:
            raise PlanError(
                f'{path}: score_periods is {score_periods}, allowed is 0 … {periods} '
                f'(periods of {run.name})')
    return Plan(
        path, title, float(score_periods), tuple(runs), base, entries=tuple(combinations),
        known=known, sweep=content.get('sweep'))


def _read_sections(
    path: Path, content: Mapping[str, Any], key: str, stages: Sequence[str],
) -> dict[str, dict[str, Any]]:
    """Return the parameters that some parameter files of a plan give to each stage."""
    sections: dict[str, dict[str, Any]] = {stage: {} for stage in stages}
    for name in _list(path, key, content.get(key, [])):
        file = path.parent / str(name)
        for stage, values in read_parameter_file(file, stages).items():
            _check(str(file), stage, values)
            sections[stage].update(values)
    return sections


def _read_known(path: Path, content: Mapping[str, Any]) -> Known:
    sections = _read_sections(path, content, 'known_rig_files', KNOWN_STAGES)
    if content.get('known_rig_files') and not any(sections.values()):
        raise PlanError(
            f'{path}: known_rig_files say nothing of {", ".join(KNOWN_STAGES)}')
    file = content.get('uncertainty_bound_file')
    return Known(sections, None if file is None else read_bound(path.parent / str(file)))


def _combinations(where: str, entry: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return one mapping for each combination of the listed values; the last key runs fastest."""
    for key, value in entry.items():
        if key in _SHORT_KEYS and value == []:
            raise PlanError(f'{where}: {key} is an empty list, it must have at least one value')
    choices = [
        value if key in _SHORT_KEYS and isinstance(value, list) else [value]
        for key, value in entry.items()]
    return [dict(zip(entry, values, strict=True)) for values in itertools.product(*choices)]


def plan_run(
    base: Mapping[str, Mapping[str, Any]], entry: Mapping[str, Any], *, where: str, number: int,
    name: str = '', known: Known | None = None, score_periods: float = 4.0,
) -> PlannedRun:
    """
    Check one run and fill in what it does not say.

    Parameters
    ----------
    base : mapping of str to mapping
        Stage to parameters that hold for every run.
    entry : mapping of str to value
        The run as in a plan, without lists of alternatives.
    where : str
        What errors begin with.
    number : int
        Number of the run, for its name.
    name : str, optional
        Its name, made of number, scheme and waveform by default.
    known : Known, optional
        What is known of the rig beside the run's own models, for what the run leaves to ``auto``.
    score_periods : float, optional
        Periods at the end of the run that will be scored.

    Raises
    ------
    PlanError
        As `read_plan`.

    """
    values = {stage: dict(base[stage]) for stage in LOOP_NODES}
    for key, value in entry.items():
        if key in LOOP_NODES:
            if not isinstance(value, Mapping):
                raise PlanError(f'{where}: {key} is {value!r}, it must be a mapping of parameters')
            values[key].update(value)
    for key, value in entry.items():
        if key in _SHORT_KEYS:
            values[_SHORT_KEYS[key]][key] = value
    if _CHANGES in entry:
        values['controller'][_CHANGES] = _changes(where, entry[_CHANGES])
    open_ = _take_out_automatic(values)
    parameters = {stage: _check(where, stage, values[stage]) for stage in LOOP_NODES}
    periods = {stage: parameters[stage]['sample_period_s'] for stage in LOOP_NODES}
    if len(set(periods.values())) > 1:
        raise PlanError(f'{where}: sample_period_s differs between the nodes: {periods}')
    run = PlannedRun(name, parameters)
    _check_travel(where, run)
    _check_changes(where, run)
    if open_:
        run = _decided(where, run, open_, known or Known(), score_periods)
    return run if name else replace(run, name=_name(run, number))


def _changes(where: str, entries: Any) -> str:
    """Return the changes of a run as the parameter of the controller wants them."""
    if not isinstance(entries, list) or not all(isinstance(each, Mapping) for each in entries):
        raise PlanError(
            f'{where}: changes is {entries!r}, it must be a list of mappings, each with at_sample')
    try:
        return changes_text(entries)
    except TypeError as error:
        raise PlanError(f'{where}: changes is {entries!r}: {error}') from None


def _check_changes(where: str, run: PlannedRun) -> None:
    """Refuse changes that cannot be made or come after the end, and what no plan can ask for."""
    at_sample = run.parameters['controller']['apply_at_sample']
    if at_sample >= 0:
        raise PlanError(
            f'{where}: controller: apply_at_sample is {at_sample}; it goes with a call during a '
            'run, a plan lists changes')
    if run.parameters['plant']['keep_state']:
        raise PlanError(f'{where}: plant: keep_state is true, every run of a plan has a new stage')
    samples = run.trajectory.samples
    for change in run.changes:
        if run.bare:
            raise PlanError(f'{where}: changes: with output voltage there is no controller')
        if change.at_sample >= samples:
            raise PlanError(
                f'{where}: changes: at_sample is {change.at_sample}, the run has {samples} samples')
    try:
        segments(run.controller, run.changes, samples)
    except ParameterError as error:
        raise PlanError(f'{where}: changes: {error}') from None


def _take_out_automatic(values: Mapping[str, dict[str, Any]]) -> tuple[str, ...]:
    """Return which of scheme and harmonics are ``auto``, and put in what is allowed for now."""
    open_ = []
    for name, for_now in (('scheme', 'ff'), ('harmonics', 0)):
        stage = values[_SHORT_KEYS[name]]
        if stage.get(name) == AUTO:
            stage[name] = for_now
            open_.append(name)
    return tuple(open_)


def _decided(
    where: str, run: PlannedRun, open_: tuple[str, ...], known: Known, score_periods: float,
) -> PlannedRun:
    """Return the run with what it leaves open decided."""
    if run.bare:
        raise PlanError(
            f'{where}: {open_[0]} is auto; with output voltage there is neither controller nor '
            'feedforward, nothing can be decided')
    if 'scheme' not in open_ and not run.controller.uses_feedforward:
        return run  # its 0 harmonics are as good as any
    try:
        prediction = predict(
            known_rig(known.sections, run.plant, run.compensator, run.trajectory),
            run.compensator, run.controller, run.trajectory, open_, bound=known.bound,
            score_periods=score_periods)
    except ValueError as error:
        raise PlanError(f'{where}: {" and ".join(open_)} auto: {error}') from None
    parameters = {stage: dict(values) for stage, values in run.parameters.items()}
    parameters['controller']['scheme'] = prediction.chosen.scheme
    parameters['trajectory']['harmonics'] = prediction.chosen.harmonics
    return replace(run, parameters=parameters, prediction=prediction)


def _name(run: PlannedRun, number: int) -> str:
    trajectory = run.trajectory
    scheme = 'bare' if run.bare else run.controller.scheme
    amplitude = f'{trajectory.amplitude_v:g}v' if run.bare else f'{trajectory.amplitude_um:g}um'
    return f'{number:03d}_{scheme}_{trajectory.waveform}_{amplitude}_{trajectory.frequency_hz:g}hz'


def _check_travel(where: str, run: PlannedRun) -> None:
    trajectory, reach_um = run.trajectory, run.plant.reach_um
    if run.bare:
        _check_rails(where, run.plant, trajectory.amplitude_v + abs(trajectory.offset_v))
        return
    offset_um = abs(trajectory.offset_um) if trajectory.waveform in EXCITATIONS else 0.0
    if not 0.0 < trajectory.amplitude_um <= reach_um - offset_um:
        beside = f', beside the offset of {offset_um:g} um,' if offset_um else ''
        raise PlanError(
            f'{where}: amplitude_um is {trajectory.amplitude_um} um, it must be above 0, and '
            f'the stage travels{beside} {reach_um:g} um to either side of its operating point')


def _check_rails(where: str, plant: RigParameters, amplitude_v: float) -> None:
    reach_v = min(
        plant.operating_point_v - plant.voltage_minimum_v,
        plant.voltage_maximum_v - plant.operating_point_v)
    if not 0.0 < amplitude_v <= reach_v:
        raise PlanError(
            f'{where}: amplitude_v is {amplitude_v} V, it must be above 0, and the rails are '
            f'{reach_v:g} V from the operating point')


def _check(where: str, stage: str, values: Mapping[str, Any]) -> dict[str, Any]:
    try:
        return check_node_parameters(stage, values)
    except ParameterError as error:
        raise PlanError(f'{where}: {stage}: {error}') from None


def _refuse_unknown(where: str, content: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for key in content:
        if key not in known:
            raise PlanError(f'{where}: unknown key {key!r}; allowed are {", ".join(known)}')


def _list(path: Path, key: str, value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise PlanError(f'{path}: {key} is {value!r}, it must be a list')
    return value
