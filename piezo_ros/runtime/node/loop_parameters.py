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

"""The parameters of a node of the loop: declared, read, and changed while it lives."""

import sys
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.parameter import Parameter

from piezo_ros.parameters.node_parameters import (
    LoopNodeParameters,
    parameter_names,
    parameter_sets,
)
from piezo_ros.parameters.role_parameters import parameter_files, role_parameters
from piezo_ros.runtime.node.declared_parameters import declare, names_by_change, plain, read
from piezo_ros.runtime.node.hooks import NodeHooks
from piezo_ros.runtime.node.rclpy_node.guard import guarded
from piezo_ros.runtime.node.rclpy_node.stream_node import ServiceRefusedError

__all__ = ['ParameterChanges']


class ParameterChanges:
    """
    Declares the parameters of a node and knows which of them have changed since they were read.

    Parameters
    ----------
    node : NodeHooks
        The node; its role is one of `NODE_PARAMETERS`.
    compiled : bool
        What the parameter of that name is where the user does not set it.
    take : callable
        Is called after a change of a configured node, with the new values.

    """

    def __init__(
        self, node: NodeHooks, *, compiled: bool, take: Callable[[LoopNodeParameters], None],
    ) -> None:
        sets = parameter_sets(node.program or node.role)
        when = names_by_change(*sets)
        self._node = node
        self._take = take
        self._fixed = frozenset[str]().union(*when.values()) - when['running']  # during a run
        self._shaping = when['configuration']
        self._configured_with: dict[str, Any] = {}  # what the endpoints are made of
        self._has_unread = False
        declare(
            node, *sets, accept=self._accept,
            defaults={**({'compiled': True} if compiled else {}), **self._of_role()})
        node.add_post_set_parameters_callback(guarded(node, self._after))

    def _of_role(self) -> dict[str, Any]:
        """Return what parameter files say of the role, where ROS finds only the other name."""
        node = self._node
        if node.get_name() == node.role:
            return {}
        values = role_parameters(node.role, node.get_namespace(), parameter_files(sys.argv))
        names = parameter_names(node.program or node.role)
        return {name: value for name, value in values.items() if name in names}

    @property
    def has_unread(self) -> bool:
        """Whether parameters have changed since they were read."""
        return self._has_unread

    def read(self) -> LoopNodeParameters:
        """Return what all nodes of the loop have; whatever has changed counts as read."""
        self._has_unread = False
        return read(self._node, LoopNodeParameters)

    def note_endpoints(self) -> None:
        """Remember the parameters that the endpoints are made of now."""
        self._configured_with = self._of_endpoints()

    def check_endpoints(self) -> None:
        """
        Check that the endpoints are made of the present parameters.

        Raises
        ------
        ValueError
            If not; it names what has changed.

        """
        changed = [
            f'{name} is {value!r} and was {self._configured_with[name]!r}'
            for name, value in self._of_endpoints().items()
            if value != self._configured_with[name]]
        if changed:
            raise ValueError(
                f'{", ".join(changed)}: clean up and configure the node, for its topics change')

    def _of_endpoints(self) -> dict[str, Any]:
        return {
            name: plain(self._node.get_parameter(name).value) for name in sorted(self._shaping)}

    def _accept(self, changes: Mapping[str, Any]) -> str:
        """Return why changes that the sets allow are refused, '' where they are not."""
        node = self._node
        if node.running or node.is_activating:
            for name, value in changes.items():
                if name in self._fixed and (
                    plain(value) != plain(node.get_parameter(name).value)
                ):
                    return (
                        f'{name} takes effect at an activation and cannot change during a run; '
                        'deactivate first')
        try:
            return node.change_parameters(changes)
        except ServiceRefusedError as refusal:
            return str(refusal)

    def _after(self, changes: list[Parameter]) -> None:
        # Also while the node configures, which may have read them already.
        self._has_unread = True
        if self._node.is_configured:
            self._take(read(self._node, LoopNodeParameters))
