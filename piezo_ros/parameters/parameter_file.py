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

"""ROS parameter files, read and written without ROS."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, TypeVar

import yaml

from piezo_ros.model import ParameterError, ParameterSet
from piezo_ros.parameters.bounded_yaml import MAXIMUM_BYTES, YamlError, yaml_content
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.file_lines import LinedMapping, with_line
from piezo_ros.parameters.node_parameters import (
    NODE_PARAMETERS,
    ONLOOKER_PARAMETERS,
    check_node_parameters,
    is_of_rclpy,
    parameter_names,
)
from piezo_ros.parameters.roles import misspelt_section, role_of
from piezo_ros.suggestions import NEARLY_SAME, did_you_mean

__all__ = [
    'parameter_sections',
    'parameters_of_rclpy',
    'parameters_yaml',
    'read_parameter_file',
    'read_parameter_set',
    'read_yaml',
    'set_with_section',
]

_SECTION: Final = 'ros__parameters'
_EVERY_NODE: Final = ('*', '**')
_ROLES: Final = (*NODE_PARAMETERS, *ONLOOKER_PARAMETERS)
_Set = TypeVar('_Set', bound=ParameterSet)


def read_yaml(path: Path) -> Any:
    """
    Return the content of a YAML file.

    Raises
    ------
    PlanError
        If it cannot be read, or a mapping in it has a key twice.

    """
    try:
        with path.open('rb') as file:
            return yaml_content(file.read(MAXIMUM_BYTES + 1), as_typed=True)
    except OSError as error:
        raise PlanError(f'{path}: {error.strerror}') from None
    except YamlError as error:
        raise PlanError(f'{path} is no YAML: {error}') from None


def parameter_sections(
    content: Mapping[str, Any], prefix: str = '',
) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """
    Yield the sections of a ROS parameter file: the name of the node and the parameters.

    Parameters
    ----------
    content : mapping
        The file, or a part of it. Namespaces may be written into each other, as ROS allows.
    prefix : str, optional
        Name of the part.

    Yields
    ------
    name : str
        Name or pattern of the node, with its namespaces, such as ``/**/plant``.
    values : mapping of str to value
        Its parameters.

    """
    for key, value in content.items():
        if not isinstance(value, Mapping):
            continue
        if key == _SECTION:
            yield prefix, value
        else:
            yield from parameter_sections(value, f'{prefix}/{str(key).strip("/")}')


def read_parameter_file(path: Path, nodes: Iterable[str]) -> dict[str, LinedMapping]:
    """
    Return the parameters that a ROS parameter file gives to some nodes.

    Parameters
    ----------
    path : Path
        A file of the form ``/**/plant: {ros__parameters: {…}}``.
    nodes : iterable of str
        Node names to look for, without namespace.

    Returns
    -------
    dict of str to dict
        Node name to its parameters, for the nodes that the file names. Of a section for
        every node (``/**``) each takes what it has, as in ROS. What all parameters of a node of
        another name are, as `ros2 param dump` writes them, goes to the node that has these. What
        rclpy declares itself is left out, see `parameters_of_rclpy`.

    Raises
    ------
    PlanError
        If the file is of another form, or a section or its parameters are misspelt ones of ours.

    """
    return {
        node: LinedMapping(
            ((name, value) for name, value in values.items() if not is_of_rclpy(name)),
            values.lines)
        for node, values in _sections_of(path, nodes).items()}


def parameters_of_rclpy(path: Path, nodes: Iterable[str]) -> dict[str, list[str]]:
    """
    Return which parameters of rclpy itself a ROS parameter file gives to some nodes.

    These are ``use_sim_time``, ``qos_overrides`` and the like, as `ros2 param dump` writes them.
    Only a node that is started with the file takes them.

    Parameters
    ----------
    path, nodes
        As for `read_parameter_file`, which has accepted the file.

    Returns
    -------
    dict of str to list of str
        Node name to the names of the parameters, for nodes with any.

    """
    names = {
        node: [name for name in values if is_of_rclpy(name)]
        for node, values in _sections_of(path, nodes).items()}
    return {node: own for node, own in names.items() if own}


def _sections_of(path: Path, nodes: Iterable[str]) -> dict[str, LinedMapping]:
    """Return everything that a file gives to some nodes; raises as `read_parameter_file`."""
    content = read_yaml(path)
    if not isinstance(content, Mapping):
        raise PlanError(f'{path} is no ROS parameter file: the top level must be a mapping')
    _check_nesting(path, content)
    parameters: dict[str, LinedMapping] = {}
    for name, values in parameter_sections(content):
        last = name.rpartition('/')[2]
        if last not in (*_ROLES, *_EVERY_NODE):
            last = role_of(values) or last
        _check_section(path, name, last, values)
        for node in nodes:
            taken = values if last == node else {
                name: value for name, value in values.items()
                if name in parameter_names(node) or is_of_rclpy(name)}
            if last in (node, *_EVERY_NODE):
                section = parameters.setdefault(node, LinedMapping())
                section.update(taken)
                section.lines.update(getattr(values, 'lines', {}))
    return parameters


def _check_nesting(path: Path, content: Mapping[str, Any], namespace: str = '') -> None:
    """Refuse what stands in no mapping of parameters: it would be left out."""
    for key, value in content.items():
        where = with_line(path, content, key)
        if key == _SECTION:
            if not namespace:
                raise PlanError(f'{where}: {_SECTION} is in no node, it must be below a name')
        elif isinstance(value, Mapping) and any(parameter_sections({key: value})):
            _check_nesting(path, value, f'{namespace}/{key.strip("/")}')
        elif _SECTION in content:
            raise PlanError(f'{where}: {key!r} stands beside {_SECTION}, it must be in it')
        else:
            raise PlanError(f'{where}: {key!r} has no mapping {_SECTION}')


def _check_section(path: Path, name: str, node: str, values: Mapping[str, Any]) -> None:
    """Refuse a section, or a parameter for every node, that is a misspelt one of ours."""
    if node in _EVERY_NODE:
        known = {own for role in _ROLES for own in parameter_names(role)}
        for own in values:
            meant = did_you_mean(own, known, nearness=NEARLY_SAME)
            if own not in known and meant:
                raise PlanError(
                    f'{with_line(path, values, own)}: no node of this package has the parameter '
                    f'{own!r}{meant} One of another node belongs in the section of that')
    elif node not in _ROLES and (why := misspelt_section(node, values)):
        raise PlanError(
            f'{with_line(path, values, "")}: the section {name!r} is of no node of this package, '
            f'{why}')


def read_parameter_set(
    path: Path, node: str, parameter_set: type[_Set], assumed: Mapping[str, Any] | None = None,
) -> _Set:
    """
    Return a parameter set out of a ROS parameter file.

    Parameters
    ----------
    path : Path
        The file.
    node : str
        The node that has these parameters.
    parameter_set : type of ParameterSet
        Which of the node's parameters.
    assumed : mapping of str to value, optional
        What applies where the file does not say otherwise; then come the node's own defaults.

    Raises
    ------
    PlanError
        If the file says nothing of the node, or something that the node refuses.

    """
    return set_with_section(path, node, parameter_set, assumed)[0]


def set_with_section(
    path: Path, node: str, parameter_set: type[_Set], assumed: Mapping[str, Any] | None = None,
) -> tuple[_Set, dict[str, Any]]:
    """
    Return a parameter set out of a ROS parameter file, and the section that it is made of.

    Parameters
    ----------
    path, node, parameter_set, assumed
        As for `read_parameter_set`.

    Returns
    -------
    parameter_set : ParameterSet
        The set.
    section : dict of str to value
        What the file says of the node.

    Raises
    ------
    PlanError
        As from `read_parameter_set`.

    """
    sections = read_parameter_file(path, [node])
    if node not in sections:
        raise PlanError(f'{path} has no section for {node}')
    try:
        values = check_node_parameters(node, {**(assumed or {}), **sections[node]})
        return parameter_set.among(values), sections[node]
    except ParameterError as error:
        where = with_line(path, sections[node], str(error))
        raise PlanError(f'{where}: {error}') from None


def parameters_yaml(namespace: str, parameters: Mapping[str, Mapping[str, Any]]) -> str:
    """
    Return a ROS parameter file of all nodes.

    Parameters
    ----------
    namespace : str
        Namespace of the nodes, '/' for none.
    parameters : mapping of str to mapping
        Node name to its parameters. A name that begins with '/' has its namespace with it.

    """
    prefix = namespace.rstrip('/')
    return yaml.dump({
        node if node.startswith('/') else f'{prefix}/{node}': {'ros__parameters': dict(values)}
        for node, values in sorted(parameters.items())},
        Dumper=getattr(yaml, 'CSafeDumper', yaml.SafeDumper), sort_keys=True)
