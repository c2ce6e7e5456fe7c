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

import json
import math
import signal
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import rclpy
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from std_msgs.msg import String

from piezo_ros.nodes.parameters import names_by_change
from piezo_ros.nodes.process_group import POLL_S, ProcessGroup
from piezo_ros.nodes.rescue import rescue
from piezo_ros.nodes.run_parameters import run_parameters
from piezo_ros.nodes.running_time import RunningTime
from piezo_ros.nodes.supervisor import Supervisor, stopped_by
from piezo_ros.parameters.errors import CampaignError
from piezo_ros.parameters.node_parameters import NODE_PARAMETERS
from piezo_ros.parameters.run import PlannedRun, RunResult

__all__ = ['KeptGraph']

_START_S: Final = 30.0
_ASK_AGAIN_S: Final = 1.0
_ATTEMPTS: Final = 60
_LAST_STATUS_S: Final = 5.0  # of the plant, once another node has ended the run
# Transition -> the state that it leads to.
_TARGETS: Final = {
    Transition.TRANSITION_CONFIGURE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_ACTIVATE: State.PRIMARY_STATE_ACTIVE,
    Transition.TRANSITION_DEACTIVATE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_CLEANUP: State.PRIMARY_STATE_UNCONFIGURED,
}


class KeptGraph(Supervisor):
    """
    Does runs on a composed loop and a recorder that stay.

    Parameters
    ----------
    directory : Path
        Output directory; logs go below it.
    namespace : str
        Namespace of the nodes; of its own for every process by default.

    """

    def __init__(self, directory: Path, *, namespace: str = '') -> None:
        super().__init__(directory, namespace)
        self._statuses: dict[str, dict[str, Any]] = {}
        self._clients: dict[tuple[str, str], Any] = {}
        # Node -> what its topics were made of, of all that are configured.
        self._configured: dict[str, dict[str, Any]] = {}

    def __enter__(self) -> 'KeptGraph':
        """Start the processes; take over SIGINT and SIGTERM."""
        super().__enter__()
        self._processes = ProcessGroup()
        logs = self._directory / 'logs'
        logs.mkdir(parents=True, exist_ok=True)
        arguments = [
            '--ros-args', '-r', f'__ns:={self._namespace}', '-p', 'autostart:=false',
            '-p', 'linger_s:=-1.0']
        for name in ('recorder', 'loop'):
            self._processes.start(name, arguments, logs / f'{name}.log')
        return self

    def __exit__(self, *_: object) -> None:
        """End the processes and give everything back."""
        self._processes.stop()
        self._processes.kill()
        super().__exit__()

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
            self._processes.stop()
            voltage_v = self._statuses.get('plant', {}).get('voltage_v')
            voltage = [] if voltage_v is None else [f'the voltage deviation is {voltage_v:g} V']
            raise CampaignError('; '.join([str(error), *voltage, *rescue(bag)])) from None

    def _run(self, planned: PlannedRun, bag: Path) -> RunResult:
        sections = run_parameters(
            planned, bag, record=True, autostart=False, compiled=planned.stages)
        nodes = tuple(sections)
        wanted = {node: _parameters_of_topics(node, values) for node, values in sections.items()}
        if wanted != self._configured:
            self._change_states(self._configured, Transition.TRANSITION_CLEANUP)
            self._configured = {}
        for node, values in sections.items():
            self._set_parameters(node, values)
        self._statuses.clear()
        if not self._configured:
            self._change_states(nodes, Transition.TRANSITION_CONFIGURE)
            self._configured = wanted
        self._change_states(nodes, Transition.TRANSITION_ACTIVATE)

        def finished(node: str) -> bool:
            return self._state_of(node) == 'finished'

        def cut_short() -> list[str]:
            return [node for node in nodes if self._state_of(node) in ('faulted', 'stopped')]

        self._spin_until(lambda: all(map(finished, nodes)) or bool(cut_short()))
        if cut_short():
            # The voltage at its end is worth waiting for.
            self._spin_until(
                lambda: self._state_of('plant') != 'active', timeout_s=_LAST_STATUS_S)
            raise CampaignError('; '.join(self._reasons(cut_short())))
        plant = dict(self._statuses['plant'])
        self._change_states(nodes, Transition.TRANSITION_DEACTIVATE)
        return RunResult(float(plant['elapsed_s']))

    def _reasons(self, nodes: Sequence[str]) -> list[str]:
        """Return why runs were cut short; nodes that followed a peer count if no other says why."""
        statuses = [self._statuses[node] for node in nodes]
        own = [status for status in statuses if not status['by_peer']]
        return [f'{status["node"]}: {status["reason"]}' for status in own or statuses]

    def _state_of(self, node: str) -> str:
        return str(self._statuses.get(node, {}).get('state', ''))

    def _set_parameters(self, node: str, values: Mapping[str, Any]) -> None:
        request = SetParametersAtomically.Request(parameters=[
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()])
        answer = self._ask(node, 'set_parameters_atomically', SetParametersAtomically, request)
        if not answer.result.successful:
            raise CampaignError(f'{node} refuses its parameters: {answer.result.reason}')

    def _change_states(self, nodes: Iterable[str], transition: int) -> None:
        for node in nodes:
            self._change_state(node, transition)

    def _change_state(self, node: str, transition: int) -> None:
        """Lead a node through a transition, also where its answer gets lost."""
        client = self._client(node, 'change_state', ChangeState)
        future = client.call_async(ChangeState.Request(transition=Transition(id=transition)))
        for _ in range(_ATTEMPTS):
            self._spin_until(future.done, timeout_s=_ASK_AGAIN_S)
            if future.done():
                break
            state = self._ask(node, 'get_state', GetState, GetState.Request())
            if state.current_state.id == _TARGETS[transition]:
                return
        else:
            raise CampaignError(
                f'waited {_ATTEMPTS * _ASK_AGAIN_S:g} s for transition {transition} of {node}')
        if not future.result().success:
            self._spin_until(lambda: False, timeout_s=0.2)
            reason = self._statuses.get(node, {}).get('reason', '')
            raise CampaignError(f'{node} refuses transition {transition}: {reason}')

    def _ask(self, node: str, service: str, service_type: Any, request: Any) -> Any:
        """Call a service that may be called twice, until it answers."""
        client = self._client(node, service, service_type)
        # A server that has not discovered its client throws the answer away: ask again.
        for _ in range(_ATTEMPTS):
            future = client.call_async(request)
            self._spin_until(future.done, timeout_s=_ASK_AGAIN_S)
            if future.done():
                return future.result()
            client.remove_pending_request(future)
        raise CampaignError(f'{node} has not answered {service}, asked {_ATTEMPTS} times')

    def _client(self, node: str, service: str, service_type: Any) -> Any:
        key = (node, service)
        if key not in self._clients:
            self._clients[key] = self._node.create_client(
                service_type, f'{self._namespace}/{node}/{service}')
        client = self._clients[key]
        self._spin_until(client.service_is_ready, timeout_s=_START_S)
        if not client.service_is_ready():
            raise CampaignError(f'waited {_START_S:g} s for {node} to be up')
        return client

    def _spin_until(
        self, condition: Callable[[], bool], *, timeout_s: float = math.inf,
    ) -> None:
        """Serve status and answers until a condition holds or the time is over."""
        waited = RunningTime()
        while not condition() and waited.elapsed_s() < timeout_s:
            if self._stop_signal:
                raise CampaignError(stopped_by(self._stop_signal))
            if self._processes.dead():
                name, code = next(iter(self._processes.blamed.items()))
                how = f'was killed by {signal.Signals(-code).name}' if code < 0 else 'failed'
                raise CampaignError(f'{name} {how}')
            rclpy.spin_once(self._node, timeout_sec=POLL_S)

    def _note(self, message: String) -> None:
        status = json.loads(message.data)
        self._statuses[status['node']] = status


def _parameters_of_topics(node: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a node that take effect when it is configured."""
    names = names_by_change(*NODE_PARAMETERS[node])['configuration']
    return {name: values[name] for name in sorted(names & values.keys())}
