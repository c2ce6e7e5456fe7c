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

"""ROS parameter files, read without ROS."""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from piezo_ros.experiment.errors import PlanError
from piezo_ros.experiment.node_parameters import NODE_PARAMETERS, parameter_names
from piezo_ros.experiment.roles import role_of

__all__ = ['read_parameter_file', 'read_yaml']


# The compiled one is ten times quicker, where it is installed.
class _Loader(getattr(yaml, 'CSafeLoader', yaml.SafeLoader)):  # type: ignore[misc]
    """Reads numbers as the parameter files of ROS do: 1e-5 is one, with or without a point."""


_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float', re.compile(r'[-+]?[0-9]+[eE][-+]?[0-9]+$'), list('-+0123456789'))


def read_yaml(path: Path) -> Any:
    """
    Return the content of a YAML file.

    Raises
    ------
    PlanError
        If it cannot be read.

    """
    try:
        # A loader of the safe kind.
        return yaml.load(path.read_text(encoding='utf-8'), _Loader)
    except OSError as error:
        raise PlanError(f'{path}: {error.strerror}') from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        # ValueError: no UTF-8, a date that does not exist, a number beyond all bounds.
        raise PlanError(f'{path} is no YAML: {error}') from None


def read_parameter_file(path: Path, nodes: Iterable[str]) -> dict[str, dict[str, Any]]:
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
        another name are, as `ros2 param dump` writes them, goes to the node that has these.

    Raises
    ------
    PlanError
        If the file is of another form.

    """
    content = read_yaml(path)
    if not isinstance(content, Mapping):
        raise PlanError(f'{path} is no ROS parameter file: the top level must be a mapping')
    parameters: dict[str, dict[str, Any]] = {}
    for key, section in content.items():
        if not isinstance(section, Mapping) or not isinstance(
                section.get('ros__parameters'), Mapping):
            raise PlanError(f'{path}: {key!r} has no mapping ros__parameters')
        last = str(key).rpartition('/')[2]
        values = section['ros__parameters']
        if last not in (*NODE_PARAMETERS, '*', '**'):
            last = role_of(values) or last
        for node in nodes:
            if last == node:
                parameters.setdefault(node, {}).update(values)
            elif last in ('*', '**'):
                parameters.setdefault(node, {}).update(
                    (name, value) for name, value in values.items()
                    if name in parameter_names(node))
    return parameters
