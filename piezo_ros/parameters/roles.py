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

from piezo_ros.parameters.node_parameters import (
    HARDWARE_PLANT,
    NODE_PARAMETERS,
    ONLOOKER_PARAMETERS,
    parameter_names,
)
from piezo_ros.suggestions import NEARLY_SAME, did_you_mean

__all__ = [
    'FACTS_SECTIONS', 'misspelt_section', 'nodes_with_role', 'parameters_by_role', 'role_of',
    'roles_of',
]

# What identification and planning tell of their models, beside the sections of nodes.
FACTS_SECTIONS: Final = (
    'identified_dynamics', 'identified_hysteresis', 'identified_creep', 'planned_scan')
_NAMES: Final = frozenset(name for role in NODE_PARAMETERS for name in parameter_names(role))
_NODES: Final = (*NODE_PARAMETERS, *ONLOOKER_PARAMETERS)
_MISSPELT: Final = 0.8  # plnat; a controller_manager is 0.71 near
# Words of names that parameters of nodes of other packages hardly have.
_OWN_WORDS: Final = frozenset(('um', 'v', 'rad', 'rad2', 'rad3'))


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


def misspelt_section(node: str, parameters: Mapping[str, Any]) -> str:
    """
    Return why a section of a parameter file is not for a node of another package.

    The file of a whole system has sections of other nodes, which are left out. What would be lost
    with a section of ours is told by its name together with its parameters: a controller_manager
    has none of those of the controller.

    Parameters
    ----------
    node : str
        Name of the node, without namespace, that is neither a role nor a pattern.
    parameters : mapping of str to value
        The section.

    Returns
    -------
    str
        What it is, for the end of an error; '' for a node of another package.

    """
    if node in FACTS_SECTIONS:
        return ''
    if facts := did_you_mean(node, FACTS_SECTIONS, nearness=NEARLY_SAME):
        return f'which is no section that piezo writes{facts}'
    for role in (*_NODES, HARDWARE_PLANT):
        has = parameters.keys() & set(parameter_names(role))
        own = sorted(name for name in has if _OWN_WORDS & set(name.split('_')))
        name = 'plant' if role == HARDWARE_PLANT else role
        is_near = node == role or did_you_mean(node, [role], nearness=_MISSPELT)
        if own or (has and is_near):
            meant = f'; did you mean {name!r}?' if is_near else (
                f'; the section of the {name} must have its name, or every parameter of it')
            return f'and has {(own or sorted(has))[0]}, a parameter of {name}{meant}'
    return ''
