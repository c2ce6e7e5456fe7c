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

"""The parameters that a node had in a recorded run, found by the role of the node."""

from typing import Any, TypeVar

from piezo_ros.bag.bag_error import BagError
from piezo_ros.bag.recorded_run import Run
from piezo_ros.bag.recording import Recording
from piezo_ros.model import ParameterSet
from piezo_ros.parameters.roles import nodes_with_role

__all__ = ['recorded_node', 'recorded_parameters']

_Set = TypeVar('_Set', bound=ParameterSet)


def recorded_node(
    run: Run | Recording, role: str, *, anywhere: bool = False,
) -> dict[str, Any] | None:
    """
    Return what a bag says of the node that had a role.

    Parameters
    ----------
    run : Run or Recording
        The run.
    role : str
        One of `NODE_PARAMETERS`.
    anywhere : bool, optional
        Whether the only such node will do, where there is none in the namespace of the rig.

    Returns
    -------
    dict of str to value or None
        Its parameters; None if the bag says nothing of such a node.

    Raises
    ------
    BagError
        If several nodes in the namespace of the rig have this role.

    """
    own = {
        name: values for name, values in run.parameters.items()
        if (name.rpartition('/')[0] or '/') == run.namespace}
    nodes = nodes_with_role(role, own)
    if len(nodes) > 1:
        raise BagError(
            f'{run.path}: several nodes are the {role} by their parameters, the run had one: '
            f'{", ".join(nodes)}')
    if not nodes and anywhere:
        nodes = nodes_with_role(role, run.parameters)
    return run.parameters[nodes[0]] if len(nodes) == 1 else None


def recorded_parameters(
    run: Run | Recording, role: str, parameter_set: type[_Set],
) -> _Set:
    """
    Return the parameters that a node had in a run.

    Parameters
    ----------
    run : Run or Recording
        The run.
    role : str
        What the node is: one of `NODE_PARAMETERS`, whatever its name.
    parameter_set : type of ParameterSet
        Which of its parameters.

    Raises
    ------
    BagError
        If the bag does not contain the parameters of the node, or tells of several.

    """
    values = recorded_node(run, role, anywhere=True)
    if values is None:
        raise BagError(f'{run.path} does not hold the parameters of {role}')
    return parameter_set.among(values)
