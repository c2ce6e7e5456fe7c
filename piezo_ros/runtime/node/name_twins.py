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
Nodes of the same full name, which ROS allows: services of one may be answered by the other.

A node that was killed stays in the graph for some seconds, so that it may be its own successor's
twin for that time.
"""

from collections import Counter
from typing import Any, Protocol

from piezo_ros.parameters.role_parameters import full_name

__all__ = ['count_node_names', 'warn_of_twins']


class GraphNode(Protocol):
    """A node, as far as it tells of the graph."""

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        """Return name and namespace of every node, those of twins several times."""

    def get_fully_qualified_name(self) -> str:
        """Return the full name of this node."""

    def get_logger(self) -> Any:
        """Return the logger of this node."""


def count_node_names(node: GraphNode) -> Counter[str]:
    """Return how many nodes the graph has of each full name."""
    return Counter(
        full_name(namespace, name)
        for name, namespace in node.get_node_names_and_namespaces())


def warn_of_twins(node: GraphNode) -> None:
    """Warn if other nodes have the full name of a node."""
    name = node.get_fully_qualified_name()
    count = count_node_names(node)[name]
    if count > 1:
        node.get_logger().warning(
            f'{count} nodes have the name {name}: its services and parameters may be answered by '
            'another one; give each node a name or namespace of its own')
