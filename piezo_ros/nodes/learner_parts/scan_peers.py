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
What a learner asks of the trajectory and the controller: their parameters, and another file.

Both are found as the nodes that write the streams; the answers come in the executor's thread.
"""

import math
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from piezo_ros.control.tables.table_changes import TableChange
from piezo_ros.parameters.node_parameters import parameter_names
from piezo_ros.runtime.node.declared_parameters import plain
from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.node.rclpy_node.guard import guarded
from piezo_ros.runtime.streams.writer_names import node_of_endpoint

__all__ = ['ScanPeers']

_ASK_AGAIN_S: Final = 1.0
# Role -> a stream that it writes.
_STREAM_OF: Final = {'trajectory': 'reference', 'controller': 'command'}


class ScanPeers:
    """
    The trajectory and the controller of a run, as a learner sees them.

    Parameters
    ----------
    node : LoopNode
        The node that asks.
    make_client : callable
        Returns the client of the parameters of a node, given its full name.

    Attributes
    ----------
    parameters : dict of str to dict
        ``'trajectory'`` and ``'controller'`` to their parameters, as far as they have answered.
    refusal : str or None
        Why the newest change was refused, '' if it was taken; None before the answer.

    """

    def __init__(
        self, node: LoopNode, make_client: Callable[[str], AsyncParameterClient],
    ) -> None:
        self.parameters: dict[str, dict[str, Any]] = {}
        self.refusal: str | None = None
        self._node = node
        self._make_client = make_client
        self._change: TableChange | None = None  # that the refusal is of
        self._asked_s: dict[str, float] = {}

    def complete(self) -> bool:
        """Ask what was not answered yet; return whether all is known."""
        for role in _STREAM_OF:
            if role not in self.parameters:
                self._ask(role)
        return not self.missing

    @property
    def missing(self) -> list[str]:
        """The roles that have not told their parameters."""
        return [role for role in _STREAM_OF if role not in self.parameters]

    def change_file(self, change: TableChange) -> None:
        """Ask the trajectory to play another file; until the answer comes, ask again."""
        self._change = change
        client = self._client('trajectory')
        if client is None or not self._is_due('change', client):
            return
        client.set_parameters_atomically(
            [Parameter('file', value=change.file),
             Parameter('apply_at_sample', value=change.at_sample)],
            callback=guarded(self._node, partial(self._got_refusal, change)))

    def forget_change(self) -> None:
        """Make ready for another change."""
        self.refusal = self._change = None
        self._asked_s.pop('change', None)

    def _ask(self, role: str) -> None:
        client = self._client(role)
        if client is not None and self._is_due(role, client):
            names = list(parameter_names(role))
            client.get_parameters(
                names, callback=guarded(self._node, partial(self._got_values, role, names)))

    def _client(self, role: str) -> AsyncParameterClient | None:
        """Return the client of the node that writes the stream of a role, once it is known."""
        node = self._node
        endpoints = node.get_publishers_info_by_topic(node.resolve_topic_name(_STREAM_OF[role]))
        # Discovery tells of an endpoint before it tells of its node.
        if len(endpoints) != 1 or endpoints[0].node_name.startswith('_'):
            return None
        return self._make_client(node_of_endpoint(endpoints[0]))

    def _is_due(self, what: str, client: AsyncParameterClient) -> bool:
        """Return whether to ask: a server that has not discovered its client does not answer."""
        now_s = time.monotonic()
        if now_s < self._asked_s.get(what, -math.inf) + _ASK_AGAIN_S:
            return False
        if not client.services_are_ready():
            return False
        self._asked_s[what] = now_s
        return True

    def _got_values(self, role: str, names: list[str], answer: Any) -> None:
        values: Mapping[str, Any] = {
            name: plain(parameter_value_to_python(value))
            for name, value in zip(names, answer.result().values, strict=True)}
        self.parameters[role] = {name: value for name, value in values.items() if value is not None}

    def _got_refusal(self, change: TableChange, answer: Any) -> None:
        if change != self._change:
            return  # the second answer of a change before this one, which was asked for twice
        result = answer.result().result
        self.refusal = '' if result.successful else (result.reason or 'without a reason')
