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

"""What the runs of a plan ask of its rig before anything is driven: travel, voltage, current."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control import simulate, simulate_bare
from piezo_ros.experiment.plan import Plan
from piezo_ros.experiment.plan.hardware_entry import rig_is_known, stand_in
from piezo_ros.model.effects.load import average_slew
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.run_and_result import PlannedRun

__all__ = ['Demand', 'check_plan', 'demand_of']

_ROUNDING = 1.0 + 1e-9


@dataclass(frozen=True)
class Demand:
    """
    What one run asks of the rig, by an offline run of the plan's own models.

    Attributes
    ----------
    name : str
        Name of the run.
    highest_um, travel_um : float
        Largest displacement from the operating point, and how far the stage travels.
    lowest_v, highest_v : float
        The voltage asked for, from the operating point.
    rails_v : tuple of float
        What the amplifier takes.
    slew_v_per_s, slew_limit_v_per_s : float
        Largest slew asked for in the scored periods, and what the amplifier gives; 0: no limit.
    average_slew_v_per_s, average_limit_v_per_s : float
        Largest mean absolute slope over the time in which the amplifier averages its current, in
        the scored periods, and what it keeps up; 0: no limit.
    limited_before, limited_scored : int
        Samples that ask for more slew, before the scored periods and in them.
    limited_rails : int
        Samples beyond a rail.

    """

    name: str
    highest_um: float
    travel_um: float
    lowest_v: float
    highest_v: float
    rails_v: tuple[float, float]
    slew_v_per_s: float
    slew_limit_v_per_s: float
    average_slew_v_per_s: float
    average_limit_v_per_s: float
    limited_before: int
    limited_scored: int
    limited_rails: int

    @property
    def beyond(self) -> bool:
        """Whether the rig cannot do what is asked where it counts."""
        return bool(
            self.limited_rails or self.limited_scored or self.beyond_average
            or self.highest_um > self.travel_um)

    @property
    def beyond_average(self) -> bool:
        """Whether more average current is asked for than the amplifier has."""
        return 0.0 < self.average_limit_v_per_s * _ROUNDING < self.average_slew_v_per_s

    @property
    def text(self) -> str:
        """Some lines for people."""
        limit, average_limit = (
            f'limit {value / 1e3:g}' if value else 'no limit'
            for value in (self.slew_limit_v_per_s, self.average_limit_v_per_s))
        lines = [
            self.name,
            f'  travel {self.highest_um:.3f} um of {self.travel_um:g} um'
            + (': BEYOND' if self.highest_um > self.travel_um else ''),
            f'  voltage {self.lowest_v:.3f} … {self.highest_v:.3f} V, rails '
            f'{self.rails_v[0]:g} … {self.rails_v[1]:g} V'
            + (f': BEYOND in {self.limited_rails} samples' if self.limited_rails else ''),
            f'  slew {self.slew_v_per_s / 1e3:.2f} V/ms, {limit}'
            + (f': BEYOND in {self.limited_scored} scored samples' if self.limited_scored else ''),
            f'  average slew {self.average_slew_v_per_s / 1e3:.2f} V/ms, {average_limit}'
            + (': BEYOND' if self.beyond_average else '')]
        if self.limited_before:
            lines.append(
                f'  (beyond the slew limit in {self.limited_before} samples before the scored '
                'periods; ramp_periods lessens that)')
        return '\n'.join(lines)


def check_plan(plan: Plan) -> list[Demand]:
    """
    Return what every run of a plan asks of its rig, of those with a rig of which a model is known.

    Parameters
    ----------
    plan : Plan
        The plan; its plant, or the model of a real stage, stands for the rig.

    Raises
    ------
    PlanError
        If the plan is a study, which decides on its runs while it runs.

    """
    if plan.study:
        raise PlanError(
            f'{plan.path}: the study {plan.study} decides on its runs while it runs; nothing can '
            'be checked before')
    # Of a real stage no model may be known: see `device_limits`.
    return [
        demand_of(stand_in(run, plan.known), plan.score_periods) for run in plan.runs
        if rig_is_known(run, plan.known)]


def demand_of(run: PlannedRun, score_periods: float) -> Demand:
    """
    Return what a run asks of its rig.

    Parameters
    ----------
    run : PlannedRun
        The run; its plant stands for the rig.
    score_periods : float
        Periods at its end that count.

    """
    if run.bare:
        bare = simulate_bare(run.plant, run.trajectory)
        voltage_v, displacement_um = bare.voltage_v, bare.displacement_um
    else:
        closed = simulate(run.plant, run.compensator, run.controller, run.trajectory)
        voltage_v, displacement_um = closed.voltage_v, closed.displacement_um
    rig, period_s = run.plant, run.trajectory.sample_period_s
    low_v, high_v = (
        rail_v - rig.operating_point_v for rail_v in (rig.voltage_minimum_v, rig.voltage_maximum_v))
    slew_v_per_s = np.abs(np.diff(voltage_v, prepend=0.0)) / period_s
    scored = int(score_periods / (run.trajectory.frequency_hz * period_s))
    too_steep = _above(slew_v_per_s, rig.slew_limit_v_per_s)
    return Demand(
        name=run.name,
        highest_um=float(np.abs(displacement_um).max()), travel_um=rig.reach_um,
        lowest_v=float(voltage_v.min()), highest_v=float(voltage_v.max()), rails_v=(low_v, high_v),
        slew_v_per_s=float(slew_v_per_s[-scored:].max()),
        slew_limit_v_per_s=rig.slew_limit_v_per_s,
        average_slew_v_per_s=float(average_slew(
            voltage_v[-scored - 1:], rig.average_slew_time_s, period_s).max()),
        average_limit_v_per_s=rig.average_slew_limit_v_per_s,
        limited_before=int(too_steep[:-scored].sum()),
        limited_scored=int(too_steep[-scored:].sum()),
        limited_rails=int(((voltage_v < low_v) | (voltage_v > high_v)).sum()))


def _above(slew_v_per_s: NDArray[np.float64], limit_v_per_s: float) -> NDArray[np.bool_]:
    if not limit_v_per_s:
        return np.zeros(slew_v_per_s.size, dtype=bool)
    return slew_v_per_s > limit_v_per_s
