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
The raster scans of a plan: a fast axis and a slow one, each on a rig of its own.

A plan has ``scans`` in place of ``runs``, and ``scan_defaults`` for what they have in common. A
list in ``fast`` stands for one scan each.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from piezo_ros.experiment.plan.automatic import KNOWN_NODES, known_rig
from piezo_ros.experiment.plan.entry_effects import refuse_two_values, refuse_without_effect
from piezo_ros.experiment.plan.entry_keys import refuse_unknown
from piezo_ros.experiment.plan.run_entry import RUN_KEYS, SHORT_KEYS, plan_run
from piezo_ros.model import ParameterError, RigParameters
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.file_lines import naming_line
from piezo_ros.parameters.node_parameters import LOOP_NODES
from piezo_ros.parameters.run_and_result import PlannedRun

__all__ = ['AXES', 'FAST', 'SLOW', 'Axis', 'RasterScan', 'read_scans']

FAST, SLOW = 'fast', 'slow'
AXES: Final = (FAST, SLOW)
_MOTIONS: Final = {FAST: ('waveform', 'planned', 'learned'), SLOW: ('plain', 'preview')}
_FILES: Final = ('parameter_files', 'known_rig_files')
# Name of a number: default, lowest, highest; a whole one if the default is.
_OF_SCAN: Final = {'lines': (256, 2, 100_000), 'pixels': (256, 2, 100_000),
                   'central': (0.8, 0.01, 1.0)}
_OF_FAST: Final = {'free_turn': (0.2, 0.0, 0.89), 'band_hz': (0.0, 0.0, 1e9),
                   'learning_runs': (3, 1, 1000)}
_OF_SLOW: Final = {'size_um': (0.0, 0.0, 1e4), 'approach_s': (0.0, 0.0, 1e4)}
_SCAN_KEYS: Final = ('name', *_OF_SCAN, *AXES)
# What the lines decide, and what follows no reference.
_NOT_FAST: Final = (
    'periods', 'output', 'amplitude_v', 'offset_v', 'offset_um', 'file', 'dwell_s', 'settle_s')
_AXIS_KEYS: Final = {
    FAST: ('motion', *_OF_FAST, *_FILES,
           *(key for key in RUN_KEYS if key not in _NOT_FAST)),
    SLOW: ('motion', *_OF_SLOW, *_FILES, 'scheme', *LOOP_NODES, 'changes')}
_WAVEFORMS: Final = ('triangle', 'sine')
_MOST_SCANS: Final = 1000
_SOFT_START_PERIODS: Final = 2.0
_SCORED_PERIODS: Final = 1.0  # the image is scored; a slow axis goes over it once

_Sections = Mapping[str, Mapping[str, Any]]
_ReadSections = Callable[[Mapping[str, Any], str, Sequence[str]], dict[str, dict[str, Any]]]


@dataclass(frozen=True)
class Axis:
    """
    One axis of a scan.

    Attributes
    ----------
    where : str
        What errors begin with.
    motion : str
        ``waveform``, ``planned`` or ``learned`` of a fast axis, ``plain`` or ``preview`` of a slow
        one.
    base : mapping of str to mapping
        Node to the parameters of its files.
    entry : mapping of str to value
        What the plan says of its run.
    known : mapping of str to mapping
        What is known of its rig, see `known_rig`.

    """

    where: str
    motion: str
    base: _Sections
    entry: Mapping[str, Any]
    known: _Sections

    def run(self, name: str, nodes: _Sections | None = None, **values: Any) -> PlannedRun:
        """
        Return its run, checked.

        Parameters
        ----------
        name : str
            Name of the run.
        nodes : mapping of str to mapping, optional
            Node to parameters that count more than those of the plan.
        **values
            Keys of a run, see `SHORT_KEYS`, that count more.

        Raises
        ------
        PlanError
            As `plan_run`.

        """
        entry = {**self.entry, **values}
        for node, parameters in (nodes or {}).items():
            entry[node] = {**entry.get(node, {}), **parameters}
        return plan_run(
            self.base, entry, where=self.where, number=0, name=name, score_periods=_SCORED_PERIODS)

    def known_rig(self, run: PlannedRun) -> RigParameters:
        """
        Return its rig as far as it is known.

        Parameters
        ----------
        run : PlannedRun
            Its run, for what is not known better.

        Raises
        ------
        PlanError
            If what is known is inconsistent with the run.

        """
        try:
            return known_rig(self.known, run.plant, run.compensator, run.trajectory)
        except ParameterError as error:
            raise PlanError(f'{self.where}: known_rig_files: {error}') from None


@dataclass(frozen=True)
class RasterScan:
    """
    A raster scan.

    Attributes
    ----------
    name : str
        Name of its directories, unique within the plan.
    case, variant : str
        What is scanned, in words, and what distinguishes this scan from others of the case.
    lines, pixels : int
        Lines of the image, to and fro, and pixels of each.
    central : float
        Share of a line that is in the image.
    fast, slow : Axis
        Its axes.
    fast_run, slow_run : PlannedRun
        What their runs have in common with the plan; what they play is another matter.
    free_turn : float
        Share of each line, about its ends, in which the error hardly counts.
    band_hz : float
        Highest frequency of a planned voltage, see `ScanRequest`.
    learning_runs : int
        Most runs of a learning.
    size_um : float
        From the first line to the last.
    approach_s : float
        How long the slow axis takes to the first line; 0 where its slowest pole decides.

    """

    name: str
    case: str
    variant: str
    lines: int
    pixels: int
    central: float
    fast: Axis
    slow: Axis
    fast_run: PlannedRun
    slow_run: PlannedRun
    free_turn: float
    band_hz: float
    learning_runs: int
    size_um: float
    approach_s: float

    @property
    def sample_period_s(self) -> float:
        """Sample period of both axes."""
        return self.fast_run.trajectory.sample_period_s

    @property
    def lines_per_sample(self) -> float:
        """Lines, to and fro, in a sample period."""
        return self.fast_run.trajectory.frequency_hz * self.sample_period_s


def read_scans(
    path: Path, content: Mapping[str, Any], base: _Sections, known: _Sections,
    read_sections: _ReadSections,
) -> tuple[RasterScan, ...]:
    """
    Return the raster scans of a plan, none where it has no ``scans``.

    Parameters
    ----------
    path : Path
        The plan, for errors.
    content : mapping of str to value
        What is in it.
    base : mapping of str to mapping
        Node to the parameters that hold for every run.
    known : mapping of str to mapping
        What is known of the rigs, see `known_rig`.
    read_sections : callable
        Returns the parameters in the files that a mapping lists under a key, for some nodes.

    Raises
    ------
    PlanError
        For an unknown key or a value out of range; the text names scan, axis, key and value.

    """
    defaults = content.get('scan_defaults', {})
    if 'scans' not in content:
        if 'scan_defaults' in content:
            raise PlanError(f'{path}: scan_defaults belong to scans, which are not there')
        return ()
    entries = content['scans']
    if not isinstance(entries, list) or not entries:
        raise PlanError(f'{path}: scans is {entries!r}, it must be a list of one at least')
    _check_keys(f'{path}: scan_defaults', defaults, _SCAN_KEYS)
    scans: list[RasterScan] = []
    for number, entry in enumerate(entries, start=1):
        where = f'{path}: scan {number}'
        with naming_line(where, path, entry):
            _check_keys(where, entry, _SCAN_KEYS)
            both = {
                axis: _merged(where, axis, defaults.get(axis, {}), entry.get(axis, {}))
                for axis in AXES}
            fasts = _combinations(f'{where}: {FAST}', both[FAST])
            for fast in fasts:
                if len(scans) == _MOST_SCANS:
                    raise PlanError(f'{where}: the plan has more than {_MOST_SCANS} scans')
                values = {**defaults, **entry, FAST: fast, SLOW: both[SLOW]}
                axes = {
                    axis: _axis(f'{where}: {axis}', axis, values[axis], base, known, read_sections)
                    for axis in AXES}
                scans.append(_scan(where, values, axes[FAST], axes[SLOW], len(scans)))
            refuse_without_effect(f'{where}: {FAST}', base['trajectory'], fasts)
    return tuple(scans)


def _scan(
    where: str, entry: Mapping[str, Any], fast: Axis, slow: Axis, number: int,
) -> RasterScan:
    numbers: dict[str, Any] = {
        name: _number(of, name, source, limits)
        for of, source, names in (
            (where, entry, _OF_SCAN), (fast.where, entry[FAST], _OF_FAST),
            (slow.where, entry[SLOW], _OF_SLOW))
        for name, limits in names.items()}
    fast_run = fast.run('fast', periods=1.0)
    scan = fast_run.trajectory
    if scan.waveform not in _WAVEFORMS:
        raise PlanError(
            f'{fast.where}: waveform is {scan.waveform!r}, allowed are {", ".join(_WAVEFORMS)}')
    # By default the image is square.
    numbers['size_um'] = numbers['size_um'] or 2.0 * scan.amplitude_um * numbers['central']
    slow_run = slow.run(
        'slow', {'trajectory': {'harmonics': 0}}, waveform='triangle', periods=1.0,
        amplitude_um=0.5 * numbers['size_um'], frequency_hz=scan.frequency_hz)
    if slow_run.trajectory.sample_period_s != scan.sample_period_s:
        raise PlanError(
            f'{where}: sample_period_s is {scan.sample_period_s} s of the fast axis and '
            f'{slow_run.trajectory.sample_period_s} s of the slow one, it must be the same')
    for axis, run in ((fast, fast_run), (slow, slow_run)):
        if run.bare:
            raise PlanError(f'{axis.where}: output is voltage, which follows no reference')
    name = f'{number:03d}_{fast.motion}_{2.0 * scan.amplitude_um:g}um_{scan.frequency_hz:g}hz'
    case = entry.get('name', (
        f'{numbers["lines"]} lines of {2.0 * scan.amplitude_um:g} µm at {scan.frequency_hz:g} Hz'))
    variant = fast.motion if fast.motion != 'waveform' else (
        f'{fast_run.controller.scheme}, m = {scan.harmonics}')
    return RasterScan(
        name, str(case), variant, fast=fast, slow=slow, fast_run=fast_run, slow_run=slow_run,
        **numbers)


def _axis(
    where: str, axis: str, values: Mapping[str, Any], base: _Sections, known: _Sections,
    read_sections: _ReadSections,
) -> Axis:
    motion = values.get('motion', _MOTIONS[axis][0])
    if motion not in _MOTIONS[axis]:
        raise PlanError(
            f'{where}: motion is {motion!r}, allowed are {", ".join(_MOTIONS[axis])}')
    nodes = read_sections(values, 'parameter_files', LOOP_NODES)
    better = read_sections(values, 'known_rig_files', KNOWN_NODES)
    entry = {key: value for key, value in values.items() if key in RUN_KEYS}
    if axis == FAST:
        entry = {'ramp_periods': _SOFT_START_PERIODS, **entry}
    return Axis(
        where, motion, {node: {**base[node], **nodes[node]} for node in LOOP_NODES}, entry,
        {node: {**known.get(node, {}), **better[node]} for node in KNOWN_NODES})


def _merged(where: str, axis: str, defaults: Any, own: Any) -> dict[str, Any]:
    """Return what the plan says of an axis: parameters of a node are added to the common ones."""
    common = f'{where.rpartition(": scan ")[0]}: scan_defaults'
    for at, values in ((common, defaults), (where, own)):
        at_axis = f'{at}: {axis}'
        _check_keys(at_axis, values, _AXIS_KEYS[axis])
        refuse_two_values(at_axis, values)
        section = values.get('trajectory')
        for name in section if isinstance(section, Mapping) else ():
            if name in SHORT_KEYS and name not in (*_AXIS_KEYS[axis], 'output'):
                raise PlanError(f'{at_axis}: trajectory: {name} has no effect: the scan decides it')
    merged = {**defaults, **own}
    for node in LOOP_NODES:
        if isinstance(defaults.get(node), Mapping) and isinstance(own.get(node), Mapping):
            merged[node] = {**defaults[node], **own[node]}
    return merged


def _combinations(where: str, values: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return one mapping for each combination of the listed values; the last key runs fastest."""
    choices = [
        value if isinstance(value, list) and (key == 'motion' or key in SHORT_KEYS) else [value]
        for key, value in values.items()]
    for key, choice in zip(values, choices, strict=True):
        if not choice:
            raise PlanError(f'{where}: {key} is an empty list, it must have at least one value')
    return [dict(zip(values, chosen, strict=True)) for chosen in itertools.product(*choices)]


def _check_keys(where: str, values: Any, allowed: Sequence[str]) -> None:
    if not isinstance(values, Mapping):
        raise PlanError(f'{where} is {values!r}, it must be a mapping')
    refuse_unknown(where, values, allowed)


def _number(
    where: str, name: str, values: Mapping[str, Any], limits: tuple[float, float, float],
) -> float:
    default, lowest, highest = limits
    value = values.get(name, default)
    kind = 'a whole number' if isinstance(default, int) else 'a number'
    if isinstance(value, bool) or not isinstance(
            value, int if isinstance(default, int) else int | float):
        raise PlanError(f'{where}: {name} is {value!r}, it must be {kind}')
    if not lowest <= value <= highest:
        raise PlanError(f'{where}: {name} is {value}, allowed is {lowest:g} … {highest:g}')
    return value
