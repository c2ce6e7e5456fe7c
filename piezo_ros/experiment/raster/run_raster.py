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
"""Does the raster scans of a plan: both axes at once, then their images and the report."""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from piezo_ros.bag import BagError
from piezo_ros.experiment.output_directory import keep_plan
from piezo_ros.experiment.plan import Plan
from piezo_ros.experiment.plan.raster_scan import AXES, FAST
from piezo_ros.experiment.raster.motions import PlannedFastAxis, RasterMotions, ReadyScan
from piezo_ros.experiment.raster.recorded_scans import ScanRecord, imaged, write_records
from piezo_ros.experiment.scan_learning import ScanLearning
from piezo_ros.interruption import interruptible
from piezo_ros.parameters.errors import CampaignError, failure_text
from piezo_ros.parameters.provenance import software_versions
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult
from piezo_ros.report.page.raster_report import write_raster_report
from piezo_ros.report.scanned_image import ScannedImage

__all__ = ['RasterCampaign', 'Rigs', 'run_raster']


class Rigs(Protocol):
    """What does the runs of both axes."""

    def alone(self, planned: PlannedRun, bag: Path) -> RunResult:
        """Do a run of the fast axis alone."""

    def together(
        self, planned: Mapping[str, PlannedRun], bags: Mapping[str, Path],
    ) -> tuple[RunResult, ...]:
        """Do a run of each axis, both at once."""


@dataclass(frozen=True)
class RasterCampaign:
    """
    What came of the scans of a plan.

    Attributes
    ----------
    scans : tuple of ScannedImage
        The images.
    report : Path
        The written report.html.

    """

    scans: tuple[ScannedImage, ...]
    report: Path


def run_raster(
    plan: Plan, directory: Path, rigs: Rigs, announce: Callable[[str], None] = lambda text: None,
) -> RasterCampaign:
    """
    Do every raster scan of a plan and write the report.

    Parameters
    ----------
    plan : Plan
        The plan.
    directory : Path
        As `prepare_directory` leaves it; bags/, motions/, learning/, the report and images/ are
        written.
    rigs : Rigs
        Does the runs.
    announce : callable, optional
        Is told of each scan before it starts.

    Raises
    ------
    PlanError
        If an axis cannot do what is wanted of it; nothing has moved then.
    CampaignError
        If a run does not come to its end. The scans before it are reported all the same.

    """
    motions = RasterMotions(directory / 'motions')
    ready = [motions.ready(scan) for scan in plan.scans]
    plan_text = keep_plan(plan.path, directory).text
    images: list[ScannedImage] = []
    records: list[ScanRecord] = []
    notes: list[str] = []
    failure: CampaignError | None = None
    for number, each in enumerate(ready, start=1):
        scan = each.scan
        announce(f'[{number}/{len(ready)}] {scan.case}: {scan.variant}')
        try:
            runs = dict(each.runs)
            if scan.fast.motion == 'learned':
                assert each.planned is not None
                learned, words = _learn(each, each.planned, directory, rigs)
                notes.append(words)
                runs[FAST] = motions.fast_run(scan, each.lines, learned)
            bags = {axis: directory / 'bags' / scan.name / axis for axis in AXES}
            for result in rigs.together(runs, bags):
                notes += [f'{scan.name}: {note}' for note in result.notes]
            record = ScanRecord(scan.name, scan.case, scan.variant, scan.pixels, scan.central)
            images.append(imaged(directory, directory, record))
            records.append(record)
            write_records(directory, records)
        except (CampaignError, BagError, OSError, ValueError) as error:
            failure = CampaignError(f'{scan.name}: {failure_text(error)}')
            notes.append(f'The campaign ended at scan {number}, {failure}')
            break
    if failure and not images:
        raise failure
    try:
        with interruptible():
            report = write_raster_report(
                directory, title=plan.title, scans=images, software=software_versions(),
                notes=notes, plan=plan_text, command=' '.join(['piezo', *sys.argv[1:]]))
    except OSError as error:
        before = '' if failure is None else f'{failure}; '
        raise CampaignError(
            f'{before}the report cannot be written: {failure_text(error)}; the bags are whole, '
            f'`piezo report {directory} -o DIR` reports them') from None
    if failure:
        raise failure
    return RasterCampaign(tuple(images), report)


def _learn(
    ready: ReadyScan, planned: PlannedFastAxis, directory: Path, rigs: Rigs,
) -> tuple[PlannedFastAxis, str]:
    """Improve the plan of a fast axis by runs of it alone; return it and what was done."""
    scan = ready.scan
    # The axis as it will scan, but for its scheme: learning is without feedback.
    base = {node: dict(values) for node, values in ready.runs[FAST].parameters.items()}
    learning = ScanLearning(
        planned.request, planned.plan, directory / 'learning' / scan.name, base)
    learning.directory.mkdir(parents=True, exist_ok=True)

    def run(once: PlannedRun, bag: Path) -> RunResult:
        bag.parent.mkdir(parents=True, exist_ok=True)
        return rigs.alone(
            replace(once, name=f'{scan.name}_learning_{len(learning.runs):03d}'), bag)

    while not learning.is_done and len(learning.runs) < scan.learning_runs:
        learning.next_run(run)
    errors = ', '.join(f'{each.nrmse_percent:.3f}' for each in learning.runs)
    words = (
        f'{scan.name}: {len(learning.runs)} learning runs, weighted error with the noise of the '
        f'sensor {errors} %.')
    return PlannedFastAxis(planned.request, learning.learner.best), words
