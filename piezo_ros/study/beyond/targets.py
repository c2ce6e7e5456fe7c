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

"""What planned and learned scans of Table 4 are to reach, and what was reached."""

import math
from typing import Final, NamedTuple

import numpy as np

from piezo_ros.study.beyond.beyond_results import BeyondResults, CellResult, ScanRun

__all__ = ['Target', 'limit_use', 'targets']

# By the frequency in Hz: NRMSE in percent at every amplitude.
LEARNED_PERCENT: Final = {
    300.0: 0.15, 400.0: 0.28, 500.0: 0.50, 600.0: 0.72, 700.0: 1.0, 800.0: 1.35}
PLANNED_PERCENT: Final = {
    300.0: 0.18, 400.0: 0.32, 500.0: 0.55, 600.0: 0.80, 700.0: 1.05, 800.0: 1.40}
_ROUNDING: Final = 1e-4  # of a limit: steps of the D/A converter


class Target(NamedTuple):
    """
    One figure of merit.

    Attributes
    ----------
    name : str
        What is compared.
    value : float
        The worst that was found.
    limit : float
        What it is to be.
    is_least : bool
        Whether the limit is the least that is allowed, else the most.

    """

    name: str
    value: float
    limit: float
    is_least: bool = False

    @property
    def holds(self) -> bool:
        """Whether it is as it is to be."""
        return self.value >= self.limit if self.is_least else self.value <= self.limit


def targets(results: BeyondResults) -> list[Target]:
    """Return every figure of merit that the runs of a study have something to tell of."""
    cells = results.cells
    factors = results.column('factor')
    found = [
        Target('learned, measured NRMSE over its limit by frequency', max(
            cell.scan.learned.measured_percent / LEARNED_PERCENT[cell.frequency_hz]
            for cell in cells), 1.0),
        Target('plan alone, true NRMSE over its limit by frequency', max(
            cell.scan.runs[0].true_percent / PLANNED_PERCENT[cell.frequency_hz]
            for cell in cells), 1.0),
        Target('paper over learned, median', float(np.median(factors)), 7.0, is_least=True),
        Target('paper over learned, smallest', float(factors.min()), 3.0, is_least=True),
        Target('prediction of the plan against its run, points', max(
            map(prediction_error_percent, cells)), 0.07),
        Target('certificate gamma before the first run', max(
            cell.scan.plan.certificate.gamma for cell in cells), math.nextafter(1.0, 0.0)),
        Target('use of slew limit or rails by any sample', max(
            limit_use(results, run) for cell in cells for run in cell.scan.runs),
            1.0 + _ROUNDING)]
    known = [cell.above_best_known for cell in cells if not math.isnan(cell.best_known_percent)]
    if known:
        found.append(Target('true error over the best known', max(known), 1.5))
    if results.average_current:
        found.append(Target('use of an average current of half the peak, planned within', max(
            each.run.average_slew_v_per_s for each in results.average_current)
            / results.average_slew_v_per_s, 1.0 + _ROUNDING))
    return found + _fault_targets(results)


def _fault_targets(results: BeyondResults) -> list[Target]:
    found = []
    for name, limit, words in (
            ('final true error above nominal with u_S, kappa wrong or creep, points', 0.02,
             ('u_S', 'kappa', 'creep')),
            ('final true error above nominal with noise of 5 nm, points', 0.03, ('noise',))):
        values = [
            row.excess_percent for row in results.robustness if row.fault.startswith(words)]
        if values:
            found.append(Target(name, max(values), limit))
    ends = [
        row.scan.end_percent / row.scan.begin_percent for row in results.robustness]
    if ends:
        found.append(Target(
            'true error of the best run over that of the plan, at the end', max(ends), 1.01))
    return found


def prediction_error_percent(cell: CellResult) -> float:
    """Return by how much the plan predicted another error than its run measured."""
    return abs(
        cell.scan.plan.measured_nrmse_percent - cell.scan.runs[0].measured_percent)


def limit_use(results: BeyondResults, run: ScanRun) -> float:
    """Return the largest use of slew limit or rails by a run, 1 at the limit."""
    low_v, high_v = results.rails_v
    slew = run.slew_v_per_s / results.slew_limit_v_per_s if results.slew_limit_v_per_s else 0.0
    return max(slew, run.minimum_v / low_v, run.maximum_v / high_v)
