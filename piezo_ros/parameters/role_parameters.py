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
The parameters that a file gives to the role of a node, whatever the node is called.

ROS looks for a node's parameters under its name. Our files name the role (``/**/plant``); of a node
that was renamed (``-r __node:=stage``) nothing of them would arrive, and it would run on defaults.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from piezo_ros.parameters.parameter_file import parameter_sections, read_yaml

__all__ = ['full_name', 'name_matches', 'parameter_files', 'role_parameters']


def parameter_files(arguments: Sequence[str]) -> list[Path]:
    """Return the parameter files that a command line names for ROS, in order."""
    files = []
    is_for_ros = False
    for word, following in zip(arguments, (*arguments[1:], ''), strict=True):
        if word in ('--ros-args', '--'):
            is_for_ros = word == '--ros-args'
        elif is_for_ros and word == '--params-file' and following:
            files.append(Path(following))
    return files


def role_parameters(role: str, namespace: str, files: Sequence[Path]) -> dict[str, Any]:
    """
    Return what parameter files give to a node of a role in a namespace.

    Parameters
    ----------
    role : str
        The role, such as 'plant'.
    namespace : str
        Namespace of the node.
    files : sequence of Path
        The files; of two that give the same parameter, the later counts.

    Raises
    ------
    PlanError
        If a file cannot be read.

    """
    name = full_name(namespace, role)
    values: dict[str, Any] = {}
    for file in files:
        content = read_yaml(file)
        if isinstance(content, Mapping):
            for pattern, section in parameter_sections(content):
                if name_matches(pattern, name):
                    values.update(section)
    return values


def full_name(namespace: str, name: str) -> str:
    """Return the name of a node or topic with its namespace, '/' for none."""
    return f'{namespace.rstrip("/")}/{name}'


def moved_name(name: str, namespace: str, new: str) -> str:
    """
    Return the full name of a node or topic in another namespace.

    Parameters
    ----------
    name : str
        The full name; one that is not below the namespace is returned as it is.
    namespace : str
        The namespace that it is in.
    new : str
        The other one; '' leaves the name as it is.

    Examples
    --------
    >>> moved_name('/piezo_12/voltage', '/piezo_12', '/'), moved_name('/other/v', '/piezo_12', '/')
    ('/voltage', '/other/v')

    """
    below = namespace.rstrip('/') + '/'
    return full_name(new, name[len(below):]) if new and name.startswith(below) else name


def name_matches(pattern: str, name: str) -> bool:
    """
    Return whether a pattern of a parameter file fits the full name of a node.

    In the pattern, * is one part of the name and ** any number of them.
    """
    parts = {'**': '(?:/[^/]+)*', '*': '/[^/]+'}
    return re.fullmatch(''.join(
        parts.get(part, f'/{re.escape(part)}') for part in pattern.split('/') if part),
        name) is not None
