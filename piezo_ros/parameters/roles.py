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

"""The role of a node, recognised by its parameters: its name may be any."""

from collections.abc import Mapping
from typing import Any, Final

from piezo_ros.parameters.node_parameters import NODE_PARAMETERS, parameter_names

__all__ = ['nodes_with_role', 'parameters_by_role', 'role_of', 'roles_of']

_NAMES: Final = frozenset(name for role in NODE_PARAMETERS for name in parameter_names(role))


def role_of(parameters: Mapping[str, Any]) -> str | None:
    """
    Return the role of a node with some parameters.

    Parameters
    ----------
    parameters : mapping of str to value
        All parameters of the node; it may have more than those of its role.

    Returns
    -------
    str or None
        The one of `NODE_PARAMETERS` of which the node has every parameter, and none of another
        role; None if there is none.

    """
    # The plant has all that the compensator has: also one of another release, which is no plant of
    # this one, must not be taken for a compensator.
    known = parameters.keys() & _NAMES
    return next(
        (role for role in NODE_PARAMETERS if known == set(parameter_names(role))), None)


def roles_of(parameters: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """
    Return the roles of nodes.

    Parameters
    ----------
    parameters : mapping of str to mapping
        Node name, with or without namespace, to its parameters.

    Returns
    -------
    dict of str to str
        Node name, as given, to its role: by its parameters, or else the name itself without
        namespace, as for a real stage that has parameters of its own.

    """
    return {
        node: role_of(values) or node.rpartition('/')[2] for node, values in parameters.items()}


def parameters_by_role(
    parameters: Mapping[str, Mapping[str, Any]],
) -> dict[str, Mapping[str, Any]]:
    """
    Return the parameters of the nodes of one rig by role.

    Parameters
    ----------
    parameters : mapping of str to mapping
        Node name to its parameters.

    Returns
    -------
    dict of str to mapping
        Role to the parameters of the node that has it. Where several have it, nothing is said of
        it.

    """
    by_role: dict[str, Mapping[str, Any]] = {}
    for role in dict.fromkeys(roles_of(parameters).values()):
        nodes = nodes_with_role(role, parameters)
        if len(nodes) == 1:
            by_role[role] = parameters[nodes[0]]
    return by_role


def nodes_with_role(role: str, parameters: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """
    Return the nodes that have a role.

    Parameters
    ----------
    role : str
        One of `NODE_PARAMETERS`, or the name of another node.
    parameters : mapping of str to mapping
        Node name to its parameters.

    Returns
    -------
    list of str
        The nodes with the parameters of that role; those with its name only if there are none.

    """
    nodes = [node for node, own in roles_of(parameters).items() if own == role]
    return [node for node in nodes if role_of(parameters[node])] or nodes
