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
The motions of both axes of a scan, made before anything moves.

A planned fast axis plays a voltage that was planned with free turns, a learned one what learning
made of that. Where planning is asked for, the compensator inverts the hysteresis that is known
best, see `known_rig`.
"""

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from piezo_ros.control.tables.motion_table import MotionTable, write_motion_table
from piezo_ros.experiment.plan.raster_scan import FAST, SLOW, RasterScan
from piezo_ros.experiment.plan.rig_limits import Demand, demand_of
from piezo_ros.experiment.planned_scan import (
    ScanRequest,
    limits_of,
    motion_of,
)
from piezo_ros.experiment.raster.slow_axis import (
    LEAD_LINES,
    approach_samples,
    rest_samples,
    slow_motion,
    slow_reference_um,
)
from piezo_ros.model import DynamicsParameters, HysteresisParameters, RigParameters
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.run_and_result import PlannedRun
from piezo_ros.planning.periodic_plan import PeriodicPlan
from piezo_ros.planning.scan import plan_for_rig

__all__ = ['PlannedFastAxis', 'RasterMotions', 'ReadyScan', 'check_scans']


@dataclass(frozen=True)
class PlannedFastAxis:
    """
    What is wanted of a fast axis, and the plan for it.

    Attributes
    ----------
    request : ScanRequest
        What is wanted, and known.
    plan : PeriodicPlan
        The plan.

    """

    request: ScanRequest
    plan: PeriodicPlan


@dataclass(frozen=True)
class ReadyScan:
    """
    A scan with its motions.

    Attributes
    ----------
    scan : RasterScan
        The scan.
    lines : int
        Lines of the fast axis, those before the image included.
    runs : mapping of str to PlannedRun
        Axis to its run.
    planned : PlannedFastAxis or None
        Where the fast axis is planned or learned.

    """

    scan: RasterScan
    lines: int
    runs: Mapping[str, PlannedRun]
    planned: PlannedFastAxis | None = None


@dataclass
class RasterMotions:
    """
    Makes the motions of scans and writes them.

    Attributes
    ----------
    directory : Path
        Where the files of the motions go.

    """

    directory: Path
    _plans: dict[tuple[ScanRequest, RigParameters], PlannedFastAxis] = field(default_factory=dict)

    def ready(self, scan: RasterScan) -> ReadyScan:
        """
        Return a scan with its motions, a learned one with what its learning begins from.

        Parameters
        ----------
        scan : RasterScan
            The scan.

        Raises
        ------
        PlanError
            If an axis cannot do what is wanted of it; the text names scan and axis.

        """
        planned = None if scan.fast.motion == 'waveform' else self._planned(scan)
        rate = scan.lines_per_sample
        known = scan.slow.known_rig(scan.slow_run)
        first_line = math.ceil(LEAD_LINES + rate * approach_samples(
            known, scan.sample_period_s, scan.approach_s))
        if planned is None:
            settled = scan.fast_run.trajectory.ramp_periods + 1.0
        else:
            repeat_from = motion_of(planned.request, planned.plan).repeat_from
            assert repeat_from is not None
            settled = rate * repeat_from
        first_line = max(first_line, math.ceil(settled - 1e-9))
        # The last retrace ends three quarters after the middle of its trace, and no trace follows.
        lines = first_line + scan.lines
        fast = self.fast_run(scan, lines, planned)
        return ReadyScan(
            scan, lines, {FAST: fast, SLOW: self._slow_run(scan, lines, first_line)}, planned)

    def fast_run(
        self, scan: RasterScan, lines: int, planned: PlannedFastAxis | None,
    ) -> PlannedRun:
        """
        Return the run of a fast axis.

        Parameters
        ----------
        scan : RasterScan
            The scan.
        lines : int
            How many lines it makes.
        planned : PlannedFastAxis or None
            What it plays; None for its waveform.

        """
        name = f'{scan.name}_{FAST}'
        if planned is None:
            return scan.fast.run(name, periods=lines)
        path = self._write(name, motion_of(planned.request, planned.plan))
        # Unless the plan says so, the command is limited by the reach of the stage.
        reach_um = scan.fast_run.plant.reach_um
        own = scan.fast.entry.get('controller', {})
        limits = {'command_minimum_um': -reach_um, 'command_maximum_um': reach_um}
        return scan.fast.run(
            name,
            {'compensator': planned.request.hysteresis.to_mapping(),
             'controller': {**limits, **own}, 'trajectory': {'harmonics': 0}},
            waveform='file', file=str(path), harmonics=0, periods=lines)

    def _planned(self, scan: RasterScan) -> PlannedFastAxis:
        trajectory = scan.fast_run.trajectory
        known = scan.fast.known_rig(scan.fast_run)
        values = known.to_mapping()
        try:
            request = ScanRequest(
                waveform=trajectory.waveform, amplitude_um=trajectory.amplitude_um,
                frequency_hz=trajectory.frequency_hz, sample_period_s=scan.sample_period_s,
                dynamics=DynamicsParameters.among(values),
                hysteresis=HysteresisParameters.among(values), limits=limits_of(known),
                band_hz=scan.band_hz,
                free_turn=scan.free_turn, ramp_periods=trajectory.ramp_periods,
                turn_fraction=trajectory.turn_fraction,
                flyback_fraction=trajectory.flyback_fraction)
            if (request, known) not in self._plans:
                self._plans[request, known] = PlannedFastAxis(*plan_for_rig(request, known))
        except ValueError as error:
            raise PlanError(f'{scan.fast.where}: {scan.fast.motion}: {error}') from None
        return self._plans[request, known]

    def _slow_run(self, scan: RasterScan, lines: int, first_line: int) -> PlannedRun:
        name = f'{scan.name}_{SLOW}'
        known = scan.slow.known_rig(scan.slow_run)
        samples = round(lines / scan.lines_per_sample)
        preview = scan.slow.motion == 'preview'
        rest = math.ceil((lines + 1.0) / scan.lines_per_sample)
        reference_um = slow_reference_um(
            rest, scan.lines, scan.size_um, scan.lines_per_sample, first_line,
            rest_samples(known, scan.sample_period_s))
        try:
            table = slow_motion(
                reference_um, samples, scan.sample_period_s, known, preview=preview)
        except ValueError as error:
            raise PlanError(f'{scan.slow.where}: {scan.slow.motion}: {error}') from None
        path = self._write(name, table)
        nodes: dict[str, Mapping[str, Any]] = {'trajectory': {'harmonics': 0}}
        if preview:
            nodes['compensator'] = HysteresisParameters.among(known.to_mapping()).to_mapping()
        return scan.slow.run(
            name, nodes, waveform='file', file=str(path), periods=1.0,
            amplitude_um=float(np.abs(table.reference_um).max()),
            frequency_hz=1.0 / (samples * scan.sample_period_s))

    def _write(self, name: str, table: MotionTable) -> Path:
        self.directory.mkdir(parents=True, exist_ok=True)
        path = (self.directory / f'{name}.npz').resolve()
        write_motion_table(path, table)
        return path


def check_scans(scans: Sequence[RasterScan]) -> list[Demand]:
    """
    Return what both axes of scans ask of their rigs, of learned ones what the plan asks.

    Parameters
    ----------
    scans : sequence of RasterScan
        The scans.

    Raises
    ------
    PlanError
        If an axis cannot do what is wanted of it.

    """
    demands = []
    with tempfile.TemporaryDirectory() as directory:
        motions = RasterMotions(Path(directory))
        for scan in scans:
            ready = motions.ready(scan)
            # The whole image counts; of the slow axis the approach, too.
            demands += [
                demand_of(ready.runs[FAST], float(scan.lines)),
                demand_of(ready.runs[SLOW], 1.0)]
    return demands
