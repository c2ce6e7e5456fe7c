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
One node graph for many runs: its nodes are activated and deactivated for each.

For plans with hundreds of short runs, of which starting processes would take most of the time. The
nodes are led through their lifecycle by its services, as any manager of ROS would. They are cleaned
up and configured again only where the topics change: every endpoint that is made anew must be
discovered again, and until the old one is forgotten a writer may take it for the new one.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from lifecycle_msgs.msg import Transition

from piezo_ros.live.node_services import NodeServices
from piezo_ros.live.node_status import has_begun, voltage_at_the_end
from piezo_ros.live.rescue import rescue
from piezo_ros.live.run_parameters import run_parameters
from piezo_ros.live.supervisor import Supervisor
from piezo_ros.parameters.errors import CampaignError
from piezo_ros.parameters.node_parameters import NODE_PARAMETERS
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult
from piezo_ros.runtime.node.declared_parameters import names_by_change

__all__ = ['KeptGraph']

_LAST_STATUS_S: Final = 5.0  # of the plant, once another node has ended the run


class KeptGraph:
    """
    Does the runs of a plan on a composed loop and a recorder that stay.

    Parameters
    ----------
    supervisor : Supervisor
        What ends the processes, which are started here and now.
    directory : Path
        Output directory; logs go below it.

    """

    def __init__(self, supervisor: Supervisor, directory: Path) -> None:
        self._supervisor = supervisor
        self._services = NodeServices(supervisor)
        # Node -> what its topics were made of, of all that are configured.
        self._configured: dict[str, dict[str, Any]] = {}
        supervisor.processes.has_begun = self._has_begun
        logs = directory / 'logs'
        logs.mkdir(parents=True, exist_ok=True)
        arguments = [*supervisor.arguments, '-p', 'autostart:=false', '-p', 'linger_s:=-1.0']
        for name in ('recorder', 'loop'):
            supervisor.processes.start(name, arguments, logs / f'{name}.log')

    def __call__(self, planned: PlannedRun, bag: Path) -> RunResult:
        """
        Do one run.

        Parameters
        ----------
        planned : PlannedRun
            The run.
        bag : Path
            Bag directory; must not exist.

        Returns
        -------
        RunResult
            Wall-clock time while samples flowed.

        Raises
        ------
        CampaignError
            If a node failed or died, or the run was stopped from outside.

        """
        bag.parent.mkdir(parents=True, exist_ok=True)
        try:
            return self._run(planned, bag)
        except CampaignError as error:
            # No run comes after this one: the recorder closes its bag, or it is rescued.
            processes = self._supervisor.processes
            processes.stop()
            self._supervisor.take_statuses()
            processes.dead()
            voltage = voltage_at_the_end(
                self._supervisor.statuses.get('plant', {}), killed=processes.was_killed('loop'))
            raise CampaignError('; '.join([str(error), *voltage, *rescue(bag)])) from None

    def _run(self, planned: PlannedRun, bag: Path) -> RunResult:
        sections = run_parameters(
            planned, bag, record=True, autostart=False, compiled=planned.nodes,
            bag_namespace=self._supervisor.bag_namespace)
        nodes = tuple(sections)
        wanted = {node: _parameters_of_topics(node, values) for node, values in sections.items()}
        if wanted != self._configured:
            self._change_states(self._configured, Transition.TRANSITION_CLEANUP)
            self._configured = {}
        for node, values in sections.items():
            self._services.set_parameters(node, values)
        self._supervisor.statuses.clear()
        if not self._configured:
            self._change_states(nodes, Transition.TRANSITION_CONFIGURE)
            self._configured = wanted
        self._change_states(nodes, Transition.TRANSITION_ACTIVATE)

        def finished(node: str) -> bool:
            return self._state_of(node) == 'finished'

        def cut_short() -> list[str]:
            return [node for node in nodes if self._state_of(node) in ('faulted', 'stopped')]

        self._supervisor.spin_until(lambda: all(map(finished, nodes)) or bool(cut_short()))
        if cut_short():
            # The voltage at its end is worth waiting for.
            self._supervisor.spin_until(
                lambda: self._state_of('plant') != 'active', timeout_s=_LAST_STATUS_S)
            raise CampaignError('; '.join(self._reasons(cut_short())))
        plant = dict(self._supervisor.statuses['plant'])
        self._change_states(nodes, Transition.TRANSITION_DEACTIVATE)
        return RunResult(float(plant['elapsed_s']))

    def _reasons(self, nodes: Sequence[str]) -> list[str]:
        """Return why runs were cut short; nodes that followed a peer count if no other says why."""
        statuses = [self._supervisor.statuses[node] for node in nodes]
        own = [status for status in statuses if not status['by_peer']]
        return [f'{status["node"]}: {status["reason"]}' for status in own or statuses]

    def _has_begun(self, name: str) -> bool:
        """Return whether a process that has ended well had begun a run: none ends by itself."""
        self._supervisor.take_statuses()
        return any(
            has_begun(status) for node, status in self._supervisor.statuses.items()
            if (node == 'recorder') == (name == 'recorder'))

    def _state_of(self, node: str) -> str:
        return str(self._supervisor.statuses.get(node, {}).get('state', ''))

    def _change_states(self, nodes: Iterable[str], transition: int) -> None:
        for node in nodes:
            self._services.change_state(node, transition)


def _parameters_of_topics(node: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a node that take effect when it is configured."""
    names = names_by_change(*NODE_PARAMETERS[node])['configuration']
    return {name: values[name] for name in sorted(names & values.keys())}
