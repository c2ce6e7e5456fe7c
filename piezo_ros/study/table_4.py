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

"""Table 4 of Liu 2015 offline: tracking errors of FF and FBFF over amplitudes and frequencies."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros import paper
from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.model import HysteresisParameters, RigParameters
from piezo_ros.report.metrics import nrmse, tail

__all__ = [
    'SCHEMES',
    'Agreement',
    'agreement',
    'published_errors',
    'table_cells',
    'tracking_errors',
]

SCHEMES = ('ff', 'fbff')
_PERCENT = 100.0


class Agreement(NamedTuple):
    """
    How close two tables of FF and FBFF errors are.

    Attributes
    ----------
    median_deviation : float
        Median over all cells of the relative deviation.
    verdicts : int
        Conditions in which the better scheme is the same.
    conditions : int
        Number of conditions.

    """

    median_deviation: float
    verdicts: int
    conditions: int


def table_cells(amplitudes_um: Iterable[float] | None = None) -> tuple[tuple[float, float], ...]:
    """Return (amplitude in um, frequency in Hz) of every condition of some rows, all by default."""
    rows = tuple(paper.TABLE_4) if amplitudes_um is None else tuple(amplitudes_um)
    return tuple((row, frequency_hz) for row in rows for frequency_hz in paper.TABLE_4[row])


def published_errors(cells: Iterable[tuple[float, float]]) -> NDArray[np.float64]:
    """Return the published NRMSE of some conditions, percent, shape (conditions, 2)."""
    return np.array([paper.TABLE_4[amplitude][frequency] for amplitude, frequency in cells])


def tracking_errors(
    plant: RigParameters,
    cells: Iterable[tuple[float, float]],
    *,
    compensator: HysteresisParameters | None = None,
    controller: ControllerParameters | None = None,
    trajectory: TrajectoryParameters | None = None,
    score_periods: float = 4.0,
) -> NDArray[np.float64]:
    """
    Return the NRMSE of triangle tracking under FF and FBFF.

    Parameters
    ----------
    plant : RigParameters
        The rig.
    cells : iterable of (amplitude in um, frequency in Hz)
        The conditions.
    compensator, controller, trajectory : parameter sets, optional
        As published by default; scheme, amplitude and frequency are replaced.
    score_periods : float, optional
        Periods at the end that are scored.

    Returns
    -------
    ndarray, shape (conditions, 2)
        Percent of the peak-to-peak reference, FF and FBFF.

    """
    compensator = compensator or HysteresisParameters()
    controller = controller or ControllerParameters()
    trajectory = trajectory or TrajectoryParameters()
    laws = [controller.replaced(scheme=scheme) for scheme in SCHEMES]
    rows = []
    for amplitude_um, frequency_hz in cells:
        scan = trajectory.replaced(amplitude_um=amplitude_um, frequency_hz=frequency_hz)
        window = tail(scan.samples, frequency_hz, scan.sample_period_s, score_periods)
        row = []
        for law in laws:
            run = simulate(plant, compensator, law, scan)
            displacement_um = run.displacement_um[:scan.samples]
            row.append(_PERCENT * nrmse(run.reference_um[window], displacement_um[window]))
        rows.append(row)
    return np.array(rows)


def agreement(errors: NDArray[np.float64], published: NDArray[np.float64]) -> Agreement:
    """Compare two tables, each of shape (conditions, 2) with FF and FBFF."""
    better, better_published = (table[:, 0] < table[:, 1] for table in (errors, published))
    return Agreement(
        float(np.median(np.abs(errors / published - 1.0))),
        int(np.count_nonzero(better == better_published)), len(errors))
