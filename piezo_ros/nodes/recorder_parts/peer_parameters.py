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

"""The parameters of the nodes that write the streams, asked for by their services."""

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.node.parameters import plain
from piezo_ros.runtime.node.rclpy_node.guard import guarded

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
    parameters : dict of str to dict
        Full node name to its parameters.

    """

    def __init__(
        self, recorder: LoopNode, make_client: Callable[[str], AsyncParameterClient],
    ) -> None:
        self.parameters: dict[str, dict[str, Any]] = {}
        self._recorder = recorder
        self._make_client = make_client
        self._clients: dict[str, AsyncParameterClient] = {}
        self._asked_s: dict[str, float] = {}

    @property
    def silent(self) -> list[str]:
        """What has not answered yet."""
        silent = [name for name in self._clients if name not in self.parameters]
        return silent or ([] if self._clients else ['every writer'])

    @property
    def owing(self) -> list[str]:
        """The nodes that could answer and have not: they are delayed."""
        return [
            name for name in self.silent
            if name in self._clients and self._clients[name].services_are_ready()]

    def complete(self) -> bool:
        """Ask the nodes that were not asked yet; return whether every node has answered."""
        all_known = True
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
                name = f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'
                if name not in self._clients:
                    self._clients[name] = self._make_client(name)
        now_s = time.monotonic()
        for name in self.silent if self._clients else ():
            client = self._clients[name]
            # A server that has not discovered its client throws the answer away: ask again.
            due_s = self._asked_s.get(name, -math.inf) + _ASK_AGAIN_S
            if now_s >= due_s and client.services_are_ready():
                self._asked_s[name] = now_s
                client.list_parameters(callback=self._guarded(self._got_names, name))
        return all_known and not self.silent

    def _guarded(self, take: Callable[..., None], *arguments: Any) -> Callable[[Any], None]:
        return guarded(self._recorder, partial(take, *arguments))

    def _got_names(self, name: str, answer: Any) -> None:
        names = list(answer.result().result.names)
        self._clients[name].get_parameters(
            names, callback=self._guarded(self._got_values, name, names))

    def _got_values(self, name: str, names: list[str], answer: Any) -> None:
        self.parameters[name] = {
            parameter_name: plain(parameter_value_to_python(value))
            for parameter_name, value in zip(names, answer.result().values, strict=True)}
