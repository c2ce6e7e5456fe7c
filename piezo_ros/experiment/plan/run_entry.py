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

"""One run of a plan: the parameters of its nodes out of its entry, checked against the rig."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from piezo_ros.control.changes import changes_text, segments
from piezo_ros.control.tables.motion_table import MotionTable, MotionTableError
from piezo_ros.control.trajectory_blocks import ChangingTable
from piezo_ros.control.trajectory_step import TrajectoryParameters, trajectory_constants
from piezo_ros.control.waveform import FILE, motion_of
from piezo_ros.experiment.plan.automatic import (
    Known,
    decide,
    place_is_told,
    take_out_automatic,
)
from piezo_ros.experiment.plan.hardware_entry import (
    check_hardware,
    complete_plant,
    is_of_hardware,
)
from piezo_ros.model import ParameterError, RigParameters
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.file_lines import with_line
from piezo_ros.parameters.node_parameters import LOOP_NODES, check_node_parameters
from piezo_ros.parameters.run_and_result import PlannedRun

__all__ = [
    'RUN_KEYS', 'SHORT_KEYS', 'check_run', 'checked_parameters', 'plan_run', 'run_name']

# The keys of a run that are short for a parameter of a node; every other key names a node.
SHORT_KEYS: Final = {
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
    'turn_fraction': 'trajectory',
    'flyback_fraction': 'trajectory',
    'stairs': 'trajectory',
    'axis': 'trajectory',
    'lissajous_cycles': 'trajectory',
    'lissajous_phase': 'trajectory',
    'file': 'trajectory',
    'dwell_s': 'trajectory',
    'settle_s': 'trajectory',
}
_CHANGES: Final = 'changes'
_FILE: Final = 'file'  # of a change: that of the trajectory
_BESIDE_FEEDBACK: Final = 2.0  # largest step of a table, over what the amplifier can
# Every key that the entry of a run may have.
RUN_KEYS: Final = (*SHORT_KEYS, *LOOP_NODES, _CHANGES)


def plan_run(
    base: Mapping[str, Mapping[str, Any]], entry: Mapping[str, Any], *, where: str, number: int,
    name: str = '', known: Known | None = None, score_periods: float = 4.0,
) -> PlannedRun:
    """
    Check one run and fill in what it does not say.

    Parameters
    ----------
    base : mapping of str to mapping
        Node to parameters that apply to every run.
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
    values = {node: dict(base[node]) for node in LOOP_NODES}
    for key, value in entry.items():
        if key in LOOP_NODES:
            if not isinstance(value, Mapping):
                raise PlanError(f'{where}: {key} is {value!r}, it must be a mapping of parameters')
            values[key].update(value)
    for key, value in entry.items():
        if key in SHORT_KEYS:
            values[SHORT_KEYS[key]][key] = value
    if _CHANGES in entry:
        gains, files = _changes(where, entry[_CHANGES])
        values['controller'][_CHANGES] = gains
        if files:
            values['trajectory']['file_changes'] = files
    undecided = take_out_automatic(values)
    parameters = {node: checked_parameters(where, node, values[node]) for node in LOOP_NODES}
    periods = {node: parameters[node]['sample_period_s'] for node in LOOP_NODES}
    if len(set(periods.values())) > 1:
        raise PlanError(f'{where}: sample_period_s differs between the nodes: {periods}')
    run = PlannedRun(name, parameters)
    check_run(where, run, score_periods)
    if undecided:
        known = known or Known()
        run = decide(
            where, run, undecided, known, score_periods, place_told=place_is_told(
                values['trajectory'], known.sections.get('trajectory', {})))
    check_hardware(where, run)
    return run if name else replace(run, name=run_name(run, number))


def check_run(where: str, run: PlannedRun, score_periods: float) -> None:
    """
    Refuse a motion that the stage cannot make, and changes that cannot be made.

    Parameters
    ----------
    where : str
        What errors begin with.
    run : PlannedRun
        The run.
    score_periods : float
        Periods at the end of the run that will be scored.

    Raises
    ------
    PlanError
        As `plan_run`.

    """
    _check_travel(where, run, score_periods)
    _check_changes(where, run)


def _changes(where: str, entries: Any) -> tuple[str, str]:
    """Return the changes of a run as the parameters of controller and trajectory want them."""
    if not isinstance(entries, list) or not all(isinstance(each, Mapping) for each in entries):
        raise PlanError(
            f'{where}: changes is {entries!r}, it must be a list of mappings, each with at_sample')
    try:
        return (
            changes_text(each for each in entries if _FILE not in each),
            changes_text(each for each in entries if _FILE in each))
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


def run_name(run: PlannedRun, number: int) -> str:
    """Return the name of a run, made of its number, scheme and waveform."""
    trajectory = run.trajectory
    scheme = 'bare' if run.bare else run.controller.scheme
    amplitude = f'{trajectory.amplitude_v:g}v' if run.bare else f'{trajectory.amplitude_um:g}um'
    unit = 'v' if run.bare else 'um'
    about = f'_about_{trajectory.offset:g}{unit}' if trajectory.offset else ''
    return (
        f'{number:03d}_{scheme}_{trajectory.waveform}_{amplitude}{about}_'
        f'{trajectory.frequency_hz:g}hz')


def _check_travel(where: str, run: PlannedRun, score_periods: float) -> None:
    trajectory, reach_um = run.trajectory, run.plant.reach_um
    if run.bare:
        _check_rails(where, run.plant, trajectory.amplitude_v + abs(trajectory.offset_v))
        return
    if trajectory.waveform == FILE:
        _check_motion(where, run, score_periods)
        return
    offset_um = abs(trajectory.offset_um)
    if not 0.0 < trajectory.amplitude_um <= reach_um - offset_um:
        beside = (
            f'; beside the offset of {offset_um:g} um that leaves {reach_um - offset_um:g} um'
            if offset_um else '')
        raise PlanError(
            f'{where}: amplitude_um is {trajectory.amplitude_um} um, it must be above 0, and '
            f'the stage travels {reach_um:g} um to either side of its operating point{beside}')


def _check_motion(where: str, run: PlannedRun, score_periods: float) -> None:
    """Refuse motions out of files that the stage cannot make, or that cannot be scored."""
    trajectory = run.trajectory
    try:
        for file in (trajectory.file, *(change.file for change in trajectory.table_changes)):
            _check_table(run, trajectory.replaced(file=file, file_changes=''), score_periods)
        if trajectory.file_changes:
            ChangingTable(trajectory)  # refuses what cannot follow
    except ParameterError as error:
        raise PlanError(f'{where}: {error}') from None


def _check_table(
    run: PlannedRun, trajectory: TrajectoryParameters, score_periods: float,
) -> None:
    """Refuse one of the files that a run plays."""
    plant, file = run.plant, trajectory.file
    motion = motion_of(trajectory)
    beside_um = abs(trajectory.offset_um)
    if not 0.0 < motion.greatest_um <= plant.reach_um - beside_um:
        beside = (
            f'; beside the offset of {beside_um:g} um that leaves {plant.reach_um - beside_um:g} um'
            if beside_um else '')
        raise MotionTableError(
            f'{file}: it reaches {motion.greatest_um:g} um, it must be above 0, and the stage '
            f'travels {plant.reach_um:g} um to either side of its operating point{beside}')
    trajectory_constants(trajectory)  # says what does not go with its commands
    _check_commands(run, motion, file)
    if plant.slew_limit_v_per_s:
        # Commands become voltages by the compensator's model of the stage, which may be another.
        # What either of the two allows is no jump; the amplifier limits the rest.
        most_um = plant.slew_limit_v_per_s * trajectory.sample_period_s * max(
            plant.largest_compliance_um_per_v, run.compensator.largest_compliance_um_per_v)
        # A table that is played beside feedback has what this takes away again.
        share = _BESIDE_FEEDBACK if run.controller.uses_feedback else 1.0
        motion.check_steps(share * most_um, file)
        # Another file follows at a later sample, where the run does not begin at rest.
        is_first = file == run.trajectory.file
        if is_first and (motion.command_um is not None or not trajectory.ramp_periods):
            motion.check_start(most_um, trajectory.offset_um, file)
    motion.check_period(trajectory.frequency_hz, score_periods, file)


def _check_commands(run: PlannedRun, motion: MotionTable, file: str) -> None:
    """Refuse commands of a motion that the controller would cut off."""
    law = run.controller
    if motion.command_um is None or not law.uses_feedforward:
        return
    for value_um, bad in (
            (float(motion.command_um.max()), motion.command_um.max() > law.command_maximum_um),
            (float(motion.command_um.min()), motion.command_um.min() < law.command_minimum_um)):
        if bad:
            raise MotionTableError(
                f'{file}: command_um is {value_um:g} um, the controller allows '
                f'{law.command_minimum_um:g} … {law.command_maximum_um:g} um '
                '(command_minimum_um, command_maximum_um)')


def _check_rails(where: str, plant: RigParameters, amplitude_v: float) -> None:
    reach_v = min(
        plant.operating_point_v - plant.voltage_minimum_v,
        plant.voltage_maximum_v - plant.operating_point_v)
    if not 0.0 < amplitude_v <= reach_v:
        raise PlanError(
            f'{where}: amplitude_v is {amplitude_v} V, it must be above 0, and the rails are '
            f'{reach_v:g} V from the operating point')


def checked_parameters(where: str, node: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return all parameters of a node, defaults filled in; a refusal says where they stand."""
    try:
        if node == 'plant' and is_of_hardware(values):
            return complete_plant(values)
        return check_node_parameters(node, values)
    except ParameterError as error:
        # A file has `where` alone; a plan names the line itself, see `read_plan`.
        raise PlanError(f'{with_line(where, values, str(error))}: {node}: {error}') from None
