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
value is checked, and a drawn model is made once for all runs of the draw that have it. Any other
draw goes the whole way through the plan.
"""

from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.closed_loop import target_of
from piezo_ros.experiment.offline import simulated_streams
from piezo_ros.experiment.plan.automatic import AUTO
from piezo_ros.experiment.plan.run_entry import check_run, run_name
from piezo_ros.experiment.sweep.sweep_plan import SweepPlan
from piezo_ros.model import ParameterSet
from piezo_ros.parameters.node_parameters import LOOP_NODES, NODE_PARAMETERS
from piezo_ros.parameters.run_and_result import PlannedRun

__all__ = ['DrawnRun', 'DrawnRuns']

_OF_ALL_NODES: Final = 'sample_period_s'
_KEPT_TARGETS: Final = 16  # references with their feedforward; a plan has few of them


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
        self._target = lru_cache(maxsize=_KEPT_TARGETS)(target_of)
        # Node to what is drawn of it, as node.name and as name.
        self._drawn = _by_node(plan.distributions)
        # Of one draw: node, its model in the first draw, and that model as it is drawn.
        self._draw = -1
        self._models: list[tuple[str, ParameterSet, ParameterSet]] = []
        of_models = all(
            parameter != _OF_ALL_NODES and parameter in NODE_PARAMETERS[node][0].names()
            for node, names in self._drawn.items() for _, parameter in names)
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
        draw, entry = divmod(number, len(self._plan.entries))
        if not self._is_simple[entry]:
            planned = self._plan.run(number)
            return DrawnRun(planned.name, planned)
        try:
            planned = self._first_of(entry)
            for node, names in self._drawn.items():
                values = {parameter: drawn[name] for name, parameter in names}
                model = self._drawn_model(draw, node, getattr(planned, node), values)
                planned = planned.with_model(node, model, values)
            check_run('', planned, self._plan.score_periods)
        except ValueError:
            planned = self._plan.run(number)  # says where it stands, or decides what is auto
        return DrawnRun(run_name(planned, number), planned)

    def streams(self, planned: PlannedRun) -> dict[str, NDArray[np.float64]]:
        """Return the streams of a run as `simulated_streams` does."""
        return simulated_streams(planned, self._target(planned.trajectory))

    def _drawn_model(
        self, draw: int, node: str, model: ParameterSet, values: Mapping[str, Any],
    ) -> ParameterSet:
        """Return a model with the values of a draw, made once for all runs that have the model."""
        if draw != self._draw:
            self._draw, self._models = draw, []
        for known, before, after in self._models:
            if known == node and (before is model or before == model):
                return after
        after = model.replaced(**values)
        self._models.append((node, model, after))
        return after

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


def _by_node(names: Iterable[str]) -> dict[str, list[tuple[str, str]]]:
    """Return node to ``node.name`` and name of its parameters, in the order of `LOOP_NODES`."""
    found: dict[str, list[tuple[str, str]]] = {}
    for node in LOOP_NODES:
        own = [(name, name[len(node) + 1:]) for name in names if name.startswith(f'{node}.')]
        if own:
            found[node] = own
    return found
