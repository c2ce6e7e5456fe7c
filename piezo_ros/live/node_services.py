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

"""Services of supervised nodes: parameters and lifecycle transitions, asked for until answered."""

from collections.abc import Mapping
from typing import Any, Final

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter

from piezo_ros.live.supervisor import Supervisor
from piezo_ros.parameters.errors import CampaignError

__all__ = ['NodeServices']

_START_S: Final = 30.0
_ASK_AGAIN_S: Final = 1.0
_ATTEMPTS: Final = 60
_REASON_S: Final = 0.2  # for the status that says why a transition was refused
# Transition -> the state that it leads to.
_TARGETS: Final = {
    Transition.TRANSITION_CONFIGURE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_ACTIVATE: State.PRIMARY_STATE_ACTIVE,
    Transition.TRANSITION_DEACTIVATE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_CLEANUP: State.PRIMARY_STATE_UNCONFIGURED,
}


class NodeServices:
    """
    Calls the services of the nodes of a graph.

    Every method raises `CampaignError` if the node does not answer, or refuses.

    Parameters
    ----------
    supervisor : Supervisor
        What supervises the graph.

    """

    def __init__(self, supervisor: Supervisor) -> None:
        self._supervisor = supervisor
        self._clients: dict[tuple[str, str], Any] = {}

    def set_parameters(self, node: str, values: Mapping[str, Any]) -> None:
        """Set parameters of a node, all or none."""
        request = SetParametersAtomically.Request(parameters=[
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()])
        answer = self._ask(node, 'set_parameters_atomically', SetParametersAtomically, request)
        if not answer.result.successful:
            raise CampaignError(f'{node} refuses its parameters: {answer.result.reason}')

    def change_state(self, node: str, transition: int) -> None:
        """Lead a node through a transition, also where its answer gets lost."""
        client = self._client(node, 'change_state', ChangeState)
        future = client.call_async(ChangeState.Request(transition=Transition(id=transition)))
        for _ in range(_ATTEMPTS):
            if self._supervisor.spin_until(future.done, timeout_s=_ASK_AGAIN_S):
                break
            state = self._ask(node, 'get_state', GetState, GetState.Request())
            if state.current_state.id == _TARGETS[transition]:
                return
        else:
            raise CampaignError(
                f'waited {_ATTEMPTS * _ASK_AGAIN_S:g} s for transition {transition} of {node}')
        if not future.result().success:
            self._supervisor.spin_until(lambda: False, timeout_s=_REASON_S)
            reason = self._supervisor.statuses.get(node, {}).get('reason', '')
            raise CampaignError(f'{node} refuses transition {transition}: {reason}')

    def _ask(self, node: str, service: str, service_type: Any, request: Any) -> Any:
        """Call a service that may be called twice, until it answers."""
        client = self._client(node, service, service_type)
        # A server that has not discovered its client throws the answer away: ask again.
        for _ in range(_ATTEMPTS):
            future = client.call_async(request)
            if self._supervisor.spin_until(future.done, timeout_s=_ASK_AGAIN_S):
                return future.result()
            client.remove_pending_request(future)
        raise CampaignError(f'{node} has not answered {service}, asked {_ATTEMPTS} times')

    def _client(self, node: str, service: str, service_type: Any) -> Any:
        key = (node, service)
        if key not in self._clients:
            self._clients[key] = self._supervisor.create_client(service_type, f'{node}/{service}')
        client = self._clients[key]
        if not self._supervisor.spin_until(client.service_is_ready, timeout_s=_START_S):
            raise CampaignError(f'waited {_START_S:g} s for {node} to be up')
        return client
