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
Learning of a planned scan while it runs: measure, improve, hand over another table, measure again.

What is done is independent of where the samples come from. A table is measured over whole
repetitions, after it has settled; the next one follows at the sample of a repetition at which both
are nearest to each other. The output directory has the tables, ``learning.json`` with what came of
each, ``best.yaml`` with the best scan so far, and ``changes.yaml``: the scan with its changes by
sample, which gives the run again, bit for bit.
"""

import json
import math
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.control.tables.motion_table import MotionTable, write_motion_table
from piezo_ros.control.tables.table_changes import (
    TableChange,
    nearest_sample,
    table_changes_entry,
)
from piezo_ros.control.waveform import FILE, motion_of
from piezo_ros.experiment.motion_files import MOTION_SUFFIX
from piezo_ros.experiment.planned_scan import read_planned_scan, write_planned_scan
from piezo_ros.experiment.scan_beside_feedback import ScanBesideFeedback
from piezo_ros.model import ParameterError
from piezo_ros.parameters.parameter_file import parameters_yaml
from piezo_ros.planning.constrained_step import InfeasibleError
from piezo_ros.planning.learning import period_average
from piezo_ros.planning.periodic_plan import PeriodicPlan
from piezo_ros.report.files import write_atomically

__all__ = ['RunningLearning']

_FORMAT_VERSION: Final = 1
_SAME_UM: Final = 1e-9

_Floats = NDArray[np.float64]


class RunningLearning:
    """
    The learning of one run, from its samples.

    Parameters
    ----------
    scan : Path
        What ``piezo plan`` or ``piezo learn`` wrote.
    directory : Path
        Where the output goes; it must not exist.
    trajectory : TrajectoryParameters
        What the run plays.
    law : ControllerParameters
        The controller of the run.
    runs : int
        How many tables are measured at most.
    settling_s : float
        How long a table settles before it is measured, one repetition at least, seconds.

    Attributes
    ----------
    wanted_file : str
        The table that shall follow, '' for none.
    why_done : str
        Why nothing more is learned, '' before.

    Raises
    ------
    ParameterError
        If the run plays another scan than the one that is given, or the scheme is not ff or fbff.
    PlanError
        If the file is no planned scan.

    """

    def __init__(
        self, scan: Path, directory: Path, trajectory: TrajectoryParameters,
        law: ControllerParameters, *, runs: int, settling_s: float,
    ) -> None:
        self._request, plan = read_planned_scan(scan)
        self._path = scan
        self._trajectory = trajectory
        self._directory = directory
        self._most_runs = runs
        try:
            self._scan = ScanBesideFeedback(
                self._request, plan, law.replaced(scheme=law.concrete_scheme))
        except ValueError as error:
            raise ParameterError(str(error)) from None
        self._learner = self._scan.learner
        self._repeated = plan.reference_um.size
        self._settling = self._repeated * max(1, math.ceil(
            settling_s / (self._repeated * self._request.sample_period_s)))
        self._proposed = self._learner.propose()
        self._table = self._first_table(plan)
        self._played = TableChange(0, trajectory.file)
        self._changes: list[TableChange] = []
        self._measured: list[dict[str, Any]] = []
        self._window: list[_Floats] = []
        self._next_table: MotionTable | None = None
        self.wanted_file = ''
        self.why_done = ''
        assert self._table.repeat_from is not None
        self._measure_from = self._table.repeat_from
        directory.mkdir(parents=True)
        if self._scan.compares_with_plan and not self._equals(self._scan.motion(plan)):
            # What feedback compares with belongs to the first table already.
            self._want(self._proposed)

    def _first_table(self, plan: PeriodicPlan) -> MotionTable:
        """Return what the run plays, which must be the scan."""
        trajectory = self._trajectory
        if trajectory.waveform != FILE:
            raise ParameterError(
                f'waveform is {trajectory.waveform!r}: only a planned scan, waveform file, can be '
                'learned')
        if trajectory.file_changes:
            raise ParameterError(
                f'file_changes is {trajectory.file_changes!r}: with changes of its own a scan '
                'cannot be learned')
        played = motion_of(trajectory)
        for table in (self._scan.motion(plan), _plain(self._scan, plan)):
            if _same(played, table):
                return played
        raise ParameterError(
            f'file is {trajectory.file}, which is not the scan of {self._path}: amplitude, '
            'frequency or command differ')

    def _equals(self, table: MotionTable) -> bool:
        return _same(self._table, table)

    @property
    def is_done(self) -> bool:
        """Whether nothing follows the table in use."""
        return bool(self.why_done) and not self.wanted_file

    @property
    def is_measured(self) -> bool:
        """Whether the table in use is measured, so that it can be improved."""
        return sum(part.size for part in self._window) >= self._wanted_samples and (
            not self.why_done and not self.wanted_file)

    @property
    def _wanted_samples(self) -> int:
        return self._scan.repetitions * self._repeated

    def take(self, index: int, reference_um: _Floats, displacement_um: _Floats) -> None:
        """
        Take the next samples of the run.

        Parameters
        ----------
        index : int
            Of the first of them.
        reference_um, displacement_um : ndarray, shape (N,)
            What came on the topics.

        Raises
        ------
        ValueError
            If the reference is not that of the scan.

        """
        table = self._table
        places = np.arange(index, index + reference_um.size)
        beyond = places >= table.reference_um.size
        places[beyond] = table.first_repeated + (
            places[beyond] - table.first_repeated) % self._repeated
        expected_um = table.reference_um[places]
        differs = np.abs(reference_um - expected_um) > _SAME_UM
        if differs.any():
            first = int(np.argmax(differs))
            raise ValueError(
                f'reference is {reference_um[first]} um at sample {index + first}, the scan has '
                f'{expected_um[first]} um: another scan is running')
        if self.wanted_file or self.why_done:
            return
        # One that joins later begins with a whole repetition.
        if not self._window and index > self._measure_from:
            late = math.ceil((index - self._measure_from) / self._repeated)
            self._measure_from += late * self._repeated
        have = sum(part.size for part in self._window)
        first = max(self._measure_from + have - index, 0)
        part = displacement_um[first:first + self._wanted_samples - have]
        if part.size:
            self._window.append(part.copy())

    def improve(self) -> None:
        """
        Learn from what was measured, and write the next table; it takes a fraction of a second.

        Raises
        ------
        OSError
            If the output cannot be written.

        """
        learner, plan = self._learner, self._learner.plan
        measured = period_average(
            np.concatenate(self._window), plan.reference_um, plan.weight, self._scan.repetitions)
        self._window = []
        learner.tell(measured)
        nrmse_percent, sigma_percent = self._scan.percent(measured)
        self._measured.append({
            'file': self._played.file, 'from_sample': self._played.at_sample,
            'measured_from_sample': self._measure_from, 'nrmse_percent': nrmse_percent,
            'sigma_percent': sigma_percent,
            'predicted_percent': self._scan.predicted_percent(self._proposed)})
        why = self._why_over()
        if not why:
            try:
                proposed = learner.propose()
            except InfeasibleError as error:
                why = f'no table keeps the limits: {error}'
        if why:
            self.why_done, proposed = why, learner.best
        if not np.array_equal(proposed.coefficients_v, self._proposed.coefficients_v):
            self._want(proposed)
        else:
            self._begin_to_measure(self._measure_from + self._wanted_samples)
        self._keep()

    def _why_over(self) -> str:
        if self._learner.is_done:
            return 'no further table pays'
        if len(self._measured) >= self._most_runs:
            return 'as many tables as were asked for'
        # Of what comes next the best must remain to be played.
        needed = 2 * (self._settling + self._wanted_samples)
        if self._measure_from + self._wanted_samples + needed > self._trajectory.samples:
            return 'the run is too short for one more table'
        return ''

    def _want(self, plan: PeriodicPlan) -> None:
        self._proposed = plan
        self._next_table = self._scan.motion(plan)
        path = self._directory / f'{len(self._changes) + 1:03d}{MOTION_SUFFIX}'
        write_motion_table(path, self._next_table)
        self.wanted_file = str(path.absolute())

    def change_from(self, earliest: int) -> TableChange:
        """Return the change to the table that shall follow, at a sample or soon after it."""
        assert self._next_table is not None
        earliest = max(earliest, self._played.at_sample + 1)
        return TableChange(
            nearest_sample(self._table, self._next_table, earliest), self.wanted_file)

    def accept(self, change: TableChange) -> None:
        """Take note that the trajectory plays the table from a sample on."""
        assert self._next_table is not None
        self._table, self._next_table, self.wanted_file = self._next_table, None, ''
        self._played = change
        self._changes.append(change)
        self._begin_to_measure(change.at_sample + self._settling)
        self._keep()

    def refuse(self, reason: str) -> None:
        """Take note that the trajectory keeps its table; nothing more is learned."""
        self._next_table, self.wanted_file = None, ''
        self.why_done = f'the table was refused: {reason}'
        self._keep()

    def end(self) -> None:
        """Take note that the run has ended."""
        if not self.is_done:
            self._next_table, self.wanted_file = None, ''
            self.why_done = 'the run has ended'
            self._keep()

    def _begin_to_measure(self, earliest: int) -> None:
        self._window = []
        self._measure_from = math.ceil(earliest / self._repeated) * self._repeated

    def status(self) -> dict[str, Any]:
        """Return what came of it so far."""
        newest = self._measured[-1] if self._measured else {}
        best_um, span_um = self._learner.best_rms_um, np.ptp(self._learner.plan.reference_um)
        return {
            'file': self._played.file, 'changed_at': self._played.at_sample or None,
            'measured': len(self._measured), 'nrmse_percent': newest.get('nrmse_percent'),
            'best_nrmse_percent': (
                float(100.0 * best_um / span_um) if math.isfinite(best_um) else None),
            'is_done': self.is_done, 'why_done': self.why_done}

    def _keep(self) -> None:
        """Write everything so far."""
        directory, best = self._directory, self._learner.best
        write_planned_scan(
            directory / 'best.yaml', self._request, best,
            [f'learned from {len(self._measured)} tables of a running scan'])
        write_motion_table(directory / f'best{MOTION_SUFFIX}', self._scan.motion(best))
        write_atomically(directory / 'learning.json', json.dumps({
            'format_version': _FORMAT_VERSION, 'why_done': self.why_done,
            'certificate_gamma': self._learner.plan.certificate.gamma,
            'changes': [table_changes_entry(change) for change in self._changes],
            'tables': self._measured}, indent=2) + '\n')
        values = {
            name: value for name, value in self._trajectory.to_mapping().items()
            if value not in ([], '')}
        if self._changes:
            values['file_changes'] = json.dumps(
                [table_changes_entry(change) for change in self._changes])
        write_atomically(
            directory / 'changes.yaml', parameters_yaml('/**', {'trajectory': values}))


def _plain(scan: ScanBesideFeedback, plan: PeriodicPlan) -> MotionTable:
    """Return what a scan plays without feedback."""
    return ScanBesideFeedback(
        scan.request, plan, ControllerParameters(scheme='ff')).motion(plan)


def _same(one: MotionTable, other: MotionTable) -> bool:
    return one.repeat_from == other.repeat_from and all(
        first is not None and second is not None and first.shape == second.shape
        and float(np.abs(first - second).max()) <= _SAME_UM
        for first, second in (
            (one.reference_um, other.reference_um), (one.command_um, other.command_um)))
