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

"""The ``sweep`` of a plan: which parameters are drawn, and how often."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

from piezo_ros.experiment.plan import Known, Plan, plan_run
from piezo_ros.experiment.plan.entry_keys import refuse_unknown
from piezo_ros.experiment.sweep.distribution import Distribution, read_distribution
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.file_lines import naming_line
from piezo_ros.parameters.node_parameters import LOOP_NODES, check_node_parameters, parameter_names
from piezo_ros.parameters.run_and_result import PlannedRun

__all__ = ['KEYS', 'SweepPlan', 'read_sweep']

KEYS: Final = ('draws', 'seed', 'parameters')
_MOST_DRAWS: Final = 10**7


@dataclass(frozen=True)
class SweepPlan:
    """
    A plan of which every run is done once for each draw of some parameters.

    Attributes
    ----------
    where : str
        The file, for errors.
    base : mapping of str to mapping
        Node to the parameters of the parameter files.
    entries : tuple of mapping
        The runs of the plan, without lists of alternatives.
    known : Known
        What the plan tells of the rig beside its nodes.
    score_periods : float
        Periods at the end of each run that are scored.
    draws, seed : int
        Number of draws, and their seed.
    distributions : mapping of str to Distribution
        ``node.name`` of a parameter to how it is drawn.

    """

    where: str
    base: Mapping[str, Mapping[str, Any]]
    entries: tuple[Mapping[str, Any], ...]
    known: Known
    score_periods: float
    draws: int
    seed: int
    distributions: Mapping[str, Distribution]

    @property
    def runs(self) -> int:
        """Number of all runs."""
        return self.draws * len(self.entries)

    @property
    def digest(self) -> str:
        """Digest of all that determines the runs but their number, so that draws can be added."""
        content = {
            'base': self.base, 'entries': self.entries, 'score_periods': self.score_periods,
            'seed': self.seed, 'known': self.known.sections, 'bound': str(self.known.bound),
            'distributions': {
                name: [each.kind, each.arguments, each.relative]
                for name, each in self.distributions.items()}}
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def drawn(self, number: int) -> dict[str, Any]:
        """Return ``node.name`` and value of what is drawn for a run."""
        draw, which = divmod(number, len(self.entries))
        return {
            name: distribution.draw(self._without_draw[which][name], name, self.seed, draw)
            for name, distribution in self.distributions.items()}

    @cached_property
    def _without_draw(self) -> tuple[dict[str, Any], ...]:
        """What each entry has for a parameter that is drawn relative to it, else None."""
        found: list[dict[str, Any]] = []
        for entry in self.entries:
            values = dict.fromkeys(self.distributions)
            for name, distribution in self.distributions.items():
                node, _, parameter = name.partition('.')
                if distribution.relative:
                    told = {**self.base[node], **entry.get(node, {})}
                    values[name] = told[parameter] if parameter in told else (
                        check_node_parameters(node, {})[parameter])
            found.append(values)
        return tuple(found)

    def run(self, number: int) -> PlannedRun:
        """
        Return a run.

        Parameters
        ----------
        number : int
            0 … `runs` - 1; the runs of one draw follow one another.

        Raises
        ------
        PlanError
            If a drawn value is out of its range.

        """
        draw, which = divmod(number, len(self.entries))
        entry = {key: value for key, value in self.entries[which].items() if key not in LOOP_NODES}
        sections = {
            node: dict(self.entries[which].get(node, {})) for node in LOOP_NODES}
        for name, value in self.drawn(number).items():
            node, _, parameter = name.partition('.')
            sections[node][parameter] = value
        return plan_run(
            self.base, {**sections, **entry}, where=f'{self.where}: run {number} (draw {draw})',
            number=number, known=self.known, score_periods=self.score_periods)


def read_sweep(plan: Plan) -> SweepPlan:
    """
    Return the sweep of a plan; its first draw is checked as a whole.

    Parameters
    ----------
    plan : Plan
        The plan, as `read_plan` gives it.

    Raises
    ------
    PlanError
        If there is no sweep, or a key, a parameter or a distribution is wrong.

    """
    content = plan.sweep
    where = str(plan.path)
    if content is None:
        raise PlanError(f'{where} has no key sweep, which says what is drawn')
    if not isinstance(content, Mapping):
        raise PlanError(f'{where}: sweep is {content!r}, it must be a mapping')
    with naming_line(where, plan.path, content):
        refuse_unknown(where, content, KEYS, ' of sweep')
    if any(run.bare for run in plan.runs):
        raise PlanError(f'{where}: a run with output voltage follows no reference and has no score')
    sweep = SweepPlan(
        where, plan.base, plan.entries, plan.known, plan.score_periods,
        _integer(where, content, 'draws', 1, _MOST_DRAWS),
        _integer(where, content, 'seed', 0, 2**53, default=1),
        _distributions(where, content.get('parameters')))
    for name, distribution in sweep.distributions.items():
        node, _, short = name.partition('.')
        if any(short in entry or (not distribution.relative and short in entry.get(node, {}))
               for entry in plan.entries):
            raise PlanError(f'{where}: {short} is given by a run and drawn by the sweep')
    for number in range(len(sweep.entries)):
        sweep.run(number)
    return sweep


def _integer(
    where: str, content: Mapping[str, Any], key: str, low: int, high: int,
    default: int | None = None,
) -> int:
    value = content.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise PlanError(
            f'{where}: {key} of sweep is {value!r}, it must be an integer in {low} … {high}')
    return value


def _distributions(where: str, content: Any) -> dict[str, Distribution]:
    if not isinstance(content, Mapping) or not content:
        raise PlanError(
            f'{where}: parameters of sweep is {content!r}, it must be a mapping of '
            '<node>.<parameter> to a distribution')
    found = {}
    for name, value in content.items():
        node, _, parameter = str(name).partition('.')
        if node not in LOOP_NODES or parameter not in parameter_names(node):
            raise PlanError(
                f'{where}: parameters of sweep: {name!r} is no parameter of '
                f'{", ".join(LOOP_NODES)}, as in plant.gain_mismatch')
        try:
            found[str(name)] = read_distribution(value)
        except ValueError as error:
            raise PlanError(f'{where}: sweep of {name}: {error}') from None
    return found
