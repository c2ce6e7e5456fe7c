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
A planned scan beside feedback: how it is learned, and with which command it is played.

Under the scheme ff nothing is to be added. Under fbff feedback takes its part of every change of
the command, which learning must know. Where the amplifier is at a limit, or the scan turns freely,
the stage does not reach the reference: feedback then compares with the planned output.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control import ControllerParameters
from piezo_ros.control.tables.motion_table import MotionTable
from piezo_ros.experiment.planned_scan import ScanRequest, motion_of, stage_of
from piezo_ros.planning.aligned_feedback import (
    check_aligned,
    feedback_command_um,
    filtered,
    periodic_sensitivity,
)
from piezo_ros.planning.learning import Learner, Measured
from piezo_ros.planning.periodic_plan import PeriodicPlan, weighted_rms_um

__all__ = ['ScanBesideFeedback']

LEAST_PERIODS: Final = 8.0  # that are averaged
_BINDS: Final = 0.99  # use of a limit from which feedback gets the planned output


class ScanBesideFeedback:
    """
    A planned scan under the scheme ff or fbff.

    Parameters
    ----------
    request : ScanRequest
        What is wanted.
    plan : PeriodicPlan
        Where learning begins.
    law : ControllerParameters
        The controller beside it.

    Attributes
    ----------
    learner : Learner
        What improves the scan.
    compares_with_plan : bool
        Whether feedback gets the planned output as its reference.

    Raises
    ------
    ValueError
        If the scheme is another one, or works against a feedforward that is right.

    """

    def __init__(
        self, request: ScanRequest, plan: PeriodicPlan, law: ControllerParameters,
    ) -> None:
        self.request = request
        self._law = law
        stage = stage_of(request)
        self._sensitivity: NDArray[np.complex128] | None = None
        self.compares_with_plan = False
        if law.scheme != 'ff':
            check_aligned(law)
            self.compares_with_plan = plan.limit_use > _BINDS or request.free_turn > 0.0
            self._sensitivity = periodic_sensitivity(stage, law, request.sample_period_s)
        # With its own output as the reference, all of a change of the plan comes through.
        self.learner = Learner(
            stage, plan, sensitivity=None if self.compares_with_plan else self._sensitivity)

    @property
    def repetitions(self) -> int:
        """How many repetitions are averaged."""
        request = self.request
        samples = self.learner.plan.reference_um.size
        periods = samples * request.frequency_hz * request.sample_period_s
        return math.ceil(LEAST_PERIODS / periods - 1e-6)

    def motion(self, plan: PeriodicPlan) -> MotionTable:
        """Return what the trajectory plays of a plan."""
        table = motion_of(self.request, plan)
        if not self.compares_with_plan:
            return table
        assert table.command_um is not None
        difference_um = plan.displacement_um - plan.reference_um
        # The integral would run away with a mean.
        difference_um = difference_um - difference_um.mean()
        samples = table.reference_um.size
        whole_um = np.resize(difference_um, samples) * plan.soft_start(
            samples, self.request.ramp_periods)
        period_s = self.request.sample_period_s
        return MotionTable(
            table.reference_um,
            table.command_um + feedback_command_um(self._law, whole_um, period_s), period_s,
            table.repeat_from)

    def predicted_percent(self, plan: PeriodicPlan) -> float:
        """Return the weighted error that the model expects, of the peak-to-peak reference."""
        error_um = plan.reference_um - plan.displacement_um
        if self._sensitivity is not None and not self.compares_with_plan:
            error_um = filtered(self._sensitivity, error_um)
        return 100.0 * weighted_rms_um(error_um, plan.weight) / float(np.ptp(plan.reference_um))

    def percent(self, measured: Measured) -> tuple[float, float]:
        """Return error and standard deviation of a run, of the peak-to-peak reference."""
        span_um = float(np.ptp(self.learner.plan.reference_um))
        return 100.0 * measured.rms_um / span_um, 100.0 * measured.sigma_um / span_um
