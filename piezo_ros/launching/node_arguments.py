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
What a launch file tells a node: its parameters, checked, as the command line has them.

The launch files hand the texts over to `launch`; they are made and tested without it.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from piezo_ros.model import ParameterError
from piezo_ros.parameters.bounded_yaml import yaml_content
from piezo_ros.parameters.node_parameters import (
    LOOP_NODES,
    NODE_PARAMETERS,
    check_node_parameters,
)
from piezo_ros.parameters.parameter_file import read_parameter_file

__all__ = [
    'checked_parameters',
    'node_namespace',
    'nodes_left_out',
    'reason_to_end',
    'ros_arguments',
]


def checked_parameters(
    given: Mapping[str, Mapping[str, Any]], files: Mapping[str, str],
) -> dict[str, dict[str, Any]]:
    """
    Return the parameters of nodes that go before those of their files, as they are declared.

    Parameters
    ----------
    given : mapping of str to mapping of str
        Node to its parameters, as values or as texts of the command line, checked in this order.
    files : mapping of str to str
        Node to the file with the others, for the nodes that have one.

    Returns
    -------
    dict of str to dict of str
        Node to its parameters.

    Raises
    ------
    ParameterError
        If a node would refuse a value, beside what its file says; the text names the parameter,
        the value and what is allowed.
    PlanError
        If a file cannot be read.

    Examples
    --------
    >>> checked_parameters({'trajectory': {'periods': '3', 'waveform': 'sine'}}, {})
    {'trajectory': {'periods': 3.0, 'waveform': 'sine'}}

    """
    checked = {}
    for node, parameters in given.items():
        in_file: dict[str, Any] = {}
        if node in files:
            in_file = read_parameter_file(Path(files[node]), [node]).get(node, {})
        texts = _text_parameters(node)
        own = {
            name: value if name in texts else _value(value)
            for name, value in parameters.items()}
        complete = check_node_parameters(node, {**in_file, **own})
        # As they are declared, 3 periods as 3.0: of two values for one parameter ROS takes the
        # integer, also where the other is that of a SetParameter.
        checked[node] = {name: complete[name] for name in own}
    return checked


def ros_arguments(
    nodes: Iterable[str], parameters: Mapping[str, Mapping[str, Any]], files: Mapping[str, str],
) -> list[str]:
    """
    Return what follows ``--ros-args`` for the nodes of a process: files, then parameters.

    What stands before a file would give way to it. Parameters go without the name of a node, which
    would not be found in a namespace: no two nodes of a process may differ in one.

    Parameters
    ----------
    nodes : iterable of str
        The nodes of the process.
    parameters : mapping of str to mapping of str
        Node to its parameters, from `checked_parameters`.
    files : mapping of str to str
        Node to its file, for the nodes that have one.

    Examples
    --------
    >>> ros_arguments(['plant'], {'plant': {'sample_period_s': 2e-05}}, {'plant': 'rig.yaml'})
    ['--params-file', 'rig.yaml', '-p', 'sample_period_s:=2.0e-05']

    """
    names = [*nodes]
    words = []
    for node in names:
        if node in files:
            words += ['--params-file', files[node]]
    own = {name: value for node in names for name, value in parameters[node].items()}
    for name, value in own.items():
        if value != '':
            words += ['-p', f'{name}:={_typed(value)}']
    return words


def nodes_left_out(text: str, *, composed: bool = False) -> list[str]:
    """
    Return the nodes that are not to be started, out of an argument ``plant, controller``.

    Parameters
    ----------
    text : str
        The argument `without`.
    composed : bool
        Whether all nodes are in one process, of which none can be left out.

    Raises
    ------
    ParameterError
        If a name is no node of the loop, or if all of them are in one process.

    """
    names = [name.strip() for name in text.split(',') if name.strip()]
    for name in names:
        if name not in LOOP_NODES:
            raise ParameterError(
                f'without has {name!r}, allowed are {", ".join(LOOP_NODES)}')
    if names and composed:
        raise ParameterError(
            f'without is {text!r}, it must be empty with composed: one process has all nodes')
    return names


def node_namespace(text: str) -> str:
    """
    Return a namespace as `launch_ros` takes it.

    A relative one goes into what an enclosing launch file has pushed, an absolute one stands for
    itself, and '' is what was pushed.
    """
    return text.rstrip('/') or text[:1]


def reason_to_end(executable: str, exit_code: int) -> str:
    """
    Return why the other processes of a rig end now that one of them has, '' where they go on.

    Parameters
    ----------
    executable : str
        The process that has ended.
    exit_code : int
        How; a negative one is the signal that has killed it.

    """
    if exit_code < 0:
        return f'{executable} was killed by signal {-exit_code}'
    if exit_code:
        return f'{executable} failed with exit code {exit_code}'
    return f'{executable} is done' if executable == 'recorder' else ''


def _text_parameters(node: str) -> set[str]:
    return {
        field.name for parameter_set in NODE_PARAMETERS[node]
        for field in dataclasses.fields(parameter_set) if isinstance(field.default, str)}


def _value(value: Any) -> Any:
    """Return a text as `ros2 run … -p name:=text` would take it, a value as it is."""
    if not isinstance(value, str):
        return value
    content = yaml_content(value)
    if isinstance(content, str):
        try:
            return float(content)  # 1e-5, which is text for YAML 1.1
        except ValueError:
            return content
    return content


def _typed(value: Any) -> str:
    """Return a value as YAML 1.1, which takes 1e-05 for text."""
    if isinstance(value, bool):
        return str(value).lower()
    text = repr(value) if isinstance(value, float) else str(value)
    return text if '.' in text or not isinstance(value, float) else text.replace('e', '.0e')
