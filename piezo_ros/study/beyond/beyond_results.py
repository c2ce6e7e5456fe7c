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

"""What the study of planned and learned scans gives."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification import DynamicsFit, HysteresisFit, UncertaintyBound
from piezo_ros.planning.periodic_plan import PeriodicPlan

__all__ = [
    'AverageCurrentRun', 'BeyondResults', 'CellResult', 'LearnedScan', 'RobustnessRow', 'ScanRun',
]


@dataclass(frozen=True)
class ScanRun:
    """
    One run of a planned scan, errors in percent of the peak-to-peak reference.

    Attributes
    ----------
    measured_percent : float
        NRMSE of the last four periods, as in the paper.
    true_percent : float
        NRMSE of the displacement without the noise of the sensor.
    slew_v_per_s, average_slew_v_per_s : float
        Largest slope of the voltage in the whole run, and mean absolute slope of its last
        repetition.
    minimum_v, maximum_v : float
        Extremes of the voltage, deviations.

    """

    measured_percent: float
    true_percent: float
    slew_v_per_s: float
    average_slew_v_per_s: float
    minimum_v: float
    maximum_v: float


@dataclass(frozen=True)
class LearnedScan:
    """
    A planned scan with its runs.

    Attributes
    ----------
    plan : PeriodicPlan
        Before the first run.
    runs : tuple of ScanRun
        The first one as planned, the others learned.
    best : int
        Number of the run that the learning takes for the best.
    begin_percent, end_percent : float
        True error of the plan and of the best run, both on the stage as it is at the end.
    true_gamma : float
        Contraction with the true slope of the simulated stage, for comparison.

    """

    plan: PeriodicPlan
    runs: tuple[ScanRun, ...]
    best: int
    begin_percent: float
    end_percent: float
    true_gamma: float

    @property
    def learned(self) -> ScanRun:
        """The best run."""
        return self.runs[self.best]


@dataclass(frozen=True)
class CellResult:
    """
    One condition of Table 4, errors in percent of the peak-to-peak reference.

    Attributes
    ----------
    amplitude_um, frequency_hz : float
        The triangle.
    paper_percent : float
        The better of the published errors of FF and FBFF.
    published_percent, identified_percent : float
        The better of FF and FBFF on this rig, as published and with re-identified models, m = 9.
    scan : LearnedScan
        Planned and learned.
    best_known_percent : float
        Best known true error; NaN where it is not known of this rig.

    """

    amplitude_um: float
    frequency_hz: float
    paper_percent: float
    published_percent: float
    identified_percent: float
    scan: LearnedScan
    best_known_percent: float = math.nan

    @property
    def factor(self) -> float:
        """By which learning is better than the better scheme of the paper, both measured."""
        return self.paper_percent / self.scan.learned.measured_percent

    @property
    def above_best_known(self) -> float:
        """True error of the learned scan over the best known one."""
        return self.scan.learned.true_percent / self.best_known_percent


@dataclass(frozen=True)
class RobustnessRow:
    """
    A learning under a fault, beside the nominal one.

    Attributes
    ----------
    fault : str
        What is wrong with model or stage.
    amplitude_um, frequency_hz : float
        The triangle.
    scan : LearnedScan
        The runs.
    nominal_percent : float
        True error of the nominal learning.

    """

    fault: str
    amplitude_um: float
    frequency_hz: float
    scan: LearnedScan
    nominal_percent: float

    @property
    def excess_percent(self) -> float:
        """True error at the end above that of the nominal learning."""
        return self.scan.end_percent - self.nominal_percent


@dataclass(frozen=True)
class AverageCurrentRun:
    """A scan that is planned within an average current, too, and its run."""

    amplitude_um: float
    frequency_hz: float
    plan: PeriodicPlan
    run: ScanRun


@dataclass(frozen=True)
class BeyondResults:
    """Everything that the page of the study shows."""

    hysteresis: HysteresisFit
    dynamics: DynamicsFit
    uncertainty: UncertaintyBound
    slew_limit_v_per_s: float
    rails_v: tuple[float, float]
    average_slew_v_per_s: float  # that of the section on average current
    cells: tuple[CellResult, ...]
    robustness: tuple[RobustnessRow, ...]
    average_current: tuple[AverageCurrentRun, ...]

    def column(self, name: str) -> NDArray[np.float64]:
        """Return an attribute of every cell."""
        return np.array([getattr(cell, name) for cell in self.cells])
