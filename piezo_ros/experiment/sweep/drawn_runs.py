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
The runs of a sweep: what is drawn takes the place of what the entry of the plan has.

A run of the plan is checked as a whole once. Where only parameters of the models are drawn, the
others are taken from that run, and the reference and feedforward are computed once; every drawn
value is checked. Any other draw goes the whole way through the plan.
"""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control import TrajectoryParameters
from piezo_ros.control.closed_loop import target_of
from piezo_ros.experiment.offline import simulated_streams
from piezo_ros.experiment.plan.automatic import AUTO
from piezo_ros.experiment.plan.run_entry import check_run, run_name
from piezo_ros.experiment.sweep.sweep_plan import SweepPlan
from piezo_ros.parameters.node_parameters import LOOP_NODES, NODE_PARAMETERS
from piezo_ros.parameters.run import PlannedRun

__all__ = ['DrawnRun', 'DrawnRuns']

_OF_ALL_NODES: Final = 'sample_period_s'


class DrawnRun(NamedTuple):
    """
    A run of a sweep.

    Attributes
    ----------
    name : str
        As in the plan.
    planned : PlannedRun
        Its parameters; the name is that of the first draw.

    """

    name: str
    planned: PlannedRun


class DrawnRuns:
    """
    The runs of a sweep by their numbers.

    Parameters
    ----------
    plan : SweepPlan
        The sweep.

    """

    def __init__(self, plan: SweepPlan) -> None:
        self._plan = plan
        self._first: dict[int, PlannedRun] = {}
        self._target: tuple[TrajectoryParameters, Any] | None = None
        names = [name.partition('.') for name in plan.distributions]
        of_models = all(
            parameter != _OF_ALL_NODES and parameter in NODE_PARAMETERS[node][0].names()
            for node, _, parameter in names)
        self._is_simple = [
            of_models and not self._leaves_open(entry) for entry in range(len(plan.entries))]

    def run(self, number: int, drawn: dict[str, Any]) -> DrawnRun:
        """
        Return a run.

        Parameters
        ----------
        number : int
            Its number.
        drawn : dict of str to value
            What `SweepPlan.drawn` gives for it.

        Raises
        ------
        PlanError
            If a drawn value is out of its range.

        """
        entry = number % len(self._plan.entries)
        if not self._is_simple[entry]:
            planned = self._plan.run(number)
            return DrawnRun(planned.name, planned)
        try:
            planned = self._first_of(entry)
            for node, values in _by_node(drawn).items():
                planned = planned.replaced(node, values)
            check_run('', planned, self._plan.score_periods)
        except ValueError:
            planned = self._plan.run(number)  # says where it stands, or decides what is auto
        return DrawnRun(run_name(planned, number), planned)

    def streams(self, planned: PlannedRun) -> dict[str, NDArray[np.float64]]:
        """Return the streams of a run as `simulated_streams` does."""
        trajectory = planned.trajectory
        if self._target is None or self._target[0] != trajectory:
            self._target = trajectory, target_of(trajectory)
        return simulated_streams(planned, self._target[1])

    def _leaves_open(self, number: int) -> bool:
        """Return whether an entry leaves something to be decided for each draw, or a device."""
        entry = self._plan.entries[number]
        sections = [entry, *self._plan.base.values(), *(entry.get(node, {}) for node in LOOP_NODES)]
        return any(
            'device' in each or AUTO in (each.get('scheme'), each.get('harmonics'))
            for each in sections)

    def _first_of(self, entry: int) -> PlannedRun:
        if entry not in self._first:
            self._first[entry] = first = self._plan.run(entry)
            for node in LOOP_NODES:
                getattr(first, node)  # made once here, for all draws
        return self._first[entry]


def _by_node(drawn: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return node to the drawn values of its parameters, in the order of `LOOP_NODES`."""
    found: dict[str, dict[str, Any]] = {}
    for node in LOOP_NODES:
        values = {
            name[len(node) + 1:]: value for name, value in drawn.items()
            if name.startswith(f'{node}.')}
        if values:
            found[node] = values
    return found
