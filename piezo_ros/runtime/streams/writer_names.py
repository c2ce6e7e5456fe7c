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

"""Which nodes write or read a topic, for messages about them."""

from collections.abc import Sequence
from typing import Any, Protocol

from rclpy.subscription import Subscription

from piezo_ros.parameters.role_parameters import full_name

__all__ = ['names_of_endpoints', 'node_of_endpoint', 'writers_beside', 'wrong_writers']


class _GraphNode(Protocol):
    def get_publishers_info_by_topic(self, topic_name: str) -> list[Any]:
        """Return the endpoint of every writer of a topic, by its full name."""


def node_of_endpoint(endpoint: Any) -> str:
    """Return the full name of the node that has an endpoint."""
    return full_name(endpoint.node_namespace, endpoint.node_name)


def names_of_endpoints(endpoints: Sequence[Any]) -> str:
    """Return the full names of the nodes that have some endpoints."""
    return ', '.join(map(node_of_endpoint, endpoints))


def wrong_writers(node: _GraphNode, topic: str, count: int) -> str:
    """Return that a topic has another number of writers than one, and which as far as known."""
    writers = node.get_publishers_info_by_topic(topic) if count else []
    names = f' ({names_of_endpoints(writers)})' if writers else ''
    return f'{topic} has {count} writers{names}, exactly one is needed'


def writers_beside(node: _GraphNode, subscription: Subscription) -> str:
    """
    Return what to add to a message about what came on a topic.

    Parameters
    ----------
    node : Node
        The node that subscribes.
    subscription : Subscription
        Its subscription.

    Returns
    -------
    str
        Which writers there are, '' where there is one: then it is the cause.

    """
    count = subscription.get_publisher_count()
    return f'; {wrong_writers(node, subscription.topic_name, count)}' if count > 1 else ''
