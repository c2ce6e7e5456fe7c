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
The parameters of the nodes that write the streams, asked for by their services.

The graph tells the name of the node that writes a stream, and services are found by that name.
Where several nodes have it, any of them may answer: such parameters are refused.
"""

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from piezo_ros.runtime.node.declared_parameters import plain
from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.node.name_twins import count_node_names
from piezo_ros.runtime.node.rclpy_node.guard import guarded
from piezo_ros.runtime.streams.writer_names import node_of_endpoint

__all__ = ['PeerParameters']

_ASK_AGAIN_S = 0.5


class PeerParameters:
    """
    Collects the parameters of the nodes that write the streams.

    Parameters
    ----------
    recorder : LoopNode
        The node that asks.
    make_client : callable
        Returns the client of the parameters of a node, given its full name.

    Attributes
    ----------
    twins : dict of str to int
        Full node name to the number of nodes that have it, where that is more than one.

    """

    def __init__(
        self, recorder: LoopNode, make_client: Callable[[str], AsyncParameterClient],
    ) -> None:
        self.twins: dict[str, int] = {}
        self._told: dict[str, dict[str, Any]] = {}
        self._recorder = recorder
        self._make_client = make_client
        self._clients: dict[str, AsyncParameterClient] = {}
        self._asked_s: dict[str, float] = {}

    @property
    def parameters(self) -> dict[str, dict[str, Any]]:
        """Full node name to its parameters, of the nodes that have a name of their own."""
        return {name: values for name, values in self._told.items() if name not in self.twins}

    @property
    def silent(self) -> list[str]:
        """What has not answered yet, and could with certainty."""
        silent = [
            name for name in self._clients if name not in self._told and name not in self.twins]
        return silent or ([] if self._clients else ['every writer'])

    @property
    def owing(self) -> list[str]:
        """The nodes that could answer and have not: they are delayed."""
        return [
            name for name in self.silent
            if name in self._clients and self._clients[name].services_are_ready()]

    def complete(self) -> bool:
        """Ask the nodes that were not asked yet; return whether every node has answered."""
        writing, all_known = self._writing_nodes()
        for name in writing:
            if name not in self._clients:
                self._clients[name] = self._make_client(name)
        self._look_for_twins(writing)
        now_s = time.monotonic()
        for name in self.silent if self._clients else ():
            # The only node of a name is the writer as long as that one is there.
            if name not in writing:
                continue
            client = self._clients[name]
            # A server that has not discovered its client throws the answer away: ask again.
            due_s = self._asked_s.get(name, -math.inf) + _ASK_AGAIN_S
            if now_s >= due_s and client.services_are_ready():
                self._asked_s[name] = now_s
                client.list_parameters(callback=self._guarded(self._got_names, name))
        return all_known and not self.silent and not self.twins

    def _writing_nodes(self) -> tuple[list[str], bool]:
        """Return the full names of the nodes that write now, and whether these are all."""
        names, all_known = [], True
        for reader in self._recorder.readers.values():
            topic = reader.subscription.topic_name
            endpoints = self._recorder.get_publishers_info_by_topic(topic)
            # A matched writer may not be in the graph yet.
            all_known = all_known and bool(endpoints)
            for endpoint in endpoints:
                # Discovery tells of an endpoint before it tells of its node.
                if endpoint.node_name.startswith('_'):
                    all_known = False
                    continue
                names.append(node_of_endpoint(endpoint))
        return [*dict.fromkeys(names)], all_known

    def _look_for_twins(self, writing: list[str]) -> None:
        """Note which of the nodes that write now share their name, and forget what was told."""
        nodes = count_node_names(self._recorder)
        for name in writing:
            count = max(nodes[name], self._servers(name))
            if count > 1:
                if self.twins.get(name) != count:
                    self._recorder.get_logger().warning(
                        f'{count} nodes have the name {name}: which of them would tell its '
                        'parameters is not certain, so they are not recorded; give each node a '
                        'name or namespace of its own')
                self.twins[name] = count
                self._told.pop(name, None)
            elif self.twins.pop(name, None):
                self._recorder.get_logger().info(f'one node alone has the name {name} now')

    def _servers(self, name: str) -> int:
        """Return how many nodes would answer; discovery may tell of them before their names."""
        return self._recorder.count_services(f'{name}/get_parameters')

    def _guarded(self, take: Callable[..., None], *arguments: Any) -> Callable[[Any], None]:
        return guarded(self._recorder, partial(take, *arguments))

    def _got_names(self, name: str, answer: Any) -> None:
        names = list(answer.result().result.names)
        self._clients[name].get_parameters(
            names, callback=self._guarded(self._got_values, name, names))

    def _got_values(self, name: str, names: list[str], answer: Any) -> None:
        if name not in self.twins and self._servers(name) <= 1:
            self._told[name] = {
                parameter_name: plain(parameter_value_to_python(value))
                for parameter_name, value in zip(names, answer.result().values, strict=True)}
