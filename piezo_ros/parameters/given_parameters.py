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
The parameters that a command line gives to nodes: which of them arrive, and which are misspelt.

ROS ignores a parameter that a node does not declare, and the node runs with its default. Where two
places give the same parameter, ROS does not take the later word but the later *pattern*: it keeps
the parameters by the name of the node that they are for, such as ``/**`` (as for ``-p`` without a
node) or ``/**/plant``, and applies these in the order in which they came up first. One ``-p`` ahead
of ``--params-file`` makes every ``-p`` give way to the file, also those behind it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from piezo_ros.model import ParameterError
from piezo_ros.parameters.bounded_yaml import YamlError, yaml_content
from piezo_ros.parameters.node_parameters import (
    NODE_PARAMETERS,
    ONLOOKER_PARAMETERS,
    PARAMETERS_OF_RCLPY,
    is_of_rclpy,
    parameter_names,
)
from piezo_ros.parameters.parameter_file import parameter_sections, read_yaml
from piezo_ros.parameters.role_parameters import full_name, name_matches
from piezo_ros.suggestions import did_you_mean

__all__ = ['GivenParameter', 'TakingNode', 'check_given', 'given_parameters']

_EVERY_NODE: Final = '/**'
_ROLES: Final = (*NODE_PARAMETERS, *ONLOOKER_PARAMETERS)


class GivenParameter(NamedTuple):
    """
    One parameter as a command line gives it.

    Attributes
    ----------
    pattern : str
        Name or pattern of the nodes that it is for, with a slash ahead.
    name : str
        The parameter.
    value : object
        Its value.
    file : str
        The parameter file, '' for ``-p``.

    """

    pattern: str
    name: str
    value: Any
    file: str = ''

    @property
    def place(self) -> str:
        """Where it is given, in words."""
        if self.file:
            return f'in {self.pattern} of {self.file}'
        return 'by -p' if self.pattern == _EVERY_NODE else f'by -p for {self.pattern}'

    @property
    def is_for_many(self) -> bool:
        """Whether nodes of any name may be meant."""
        return self.pattern.rpartition('/')[2] in ('*', '**')


class TakingNode(NamedTuple):
    """
    A node of the process.

    Attributes
    ----------
    role : str
        Its role.
    namespace, name : str
        Where it is in the graph.
    declares : callable
        Returns whether it has declared a parameter of a name.

    """

    role: str
    namespace: str
    name: str
    declares: Callable[[str], bool]

    @property
    def full_name(self) -> str:
        """Its name with namespace."""
        return full_name(self.namespace, self.name)

    @property
    def full_names(self) -> tuple[str, ...]:
        """The names under which files and command lines find it: its own, and that of its role."""
        return self.full_name, full_name(self.namespace, self.role)

    def is_meant(self, given: GivenParameter) -> bool:
        """Return whether a parameter is for this node."""
        # Only files find a node by its role; what -p names is the node itself.
        names = self.full_names if given.file else (self.full_name,)
        return any(name_matches(given.pattern, name) for name in names)


def given_parameters(arguments: Sequence[str]) -> list[GivenParameter]:
    """
    Return what a command line gives, in its order.

    Parameters
    ----------
    arguments : sequence of str
        The command line.

    Raises
    ------
    PlanError
        If a parameter file cannot be read.

    """
    given: list[GivenParameter] = []
    is_for_ros = False
    for word, following in zip(arguments, (*arguments[1:], ''), strict=True):
        if word in ('--ros-args', '--'):
            is_for_ros = word == '--ros-args'
        elif is_for_ros and word == '--params-file' and following:
            given += _in_file(following)
        elif is_for_ros and word in ('-p', '--param') and ':=' in following:
            given.append(_by_word(following))
    return given


def _in_file(path: str) -> Iterator[GivenParameter]:
    content = read_yaml(Path(path))
    if isinstance(content, Mapping):
        for pattern, section in parameter_sections(content):
            for name, value in _flat(section):
                yield GivenParameter(pattern, name, value, path)


def _by_word(word: str) -> GivenParameter:
    left, _, text = word.partition(':=')
    node, _, name = left.rpartition(':')
    try:
        value = yaml_content(text.encode())
    except YamlError:
        value = text
    return GivenParameter(f'/{node.strip("/")}' if node else _EVERY_NODE, name, value)


def _flat(section: Mapping[str, Any], prefix: str = '') -> Iterator[tuple[str, Any]]:
    """Yield the parameters of a section, those within mappings with dots in their names."""
    for key, value in section.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', value


def check_given(given: Sequence[GivenParameter], nodes: Sequence[TakingNode]) -> list[str]:
    """
    Return warnings of what a command line gives in vain to the nodes of a process.

    A name that no node takes is refused where it is meant for these nodes: given by ``-p``, or in a
    section for one of them. In a section for many nodes it may be that of a foreign node.

    Parameters
    ----------
    given : sequence of GivenParameter
        What is given.
    nodes : sequence of TakingNode
        The nodes, which have declared their parameters.

    Returns
    -------
    list of str
        One line each.

    Raises
    ------
    ParameterError
        If a parameter is misspelt, or named for a node that is not there.

    """
    warnings = []
    for each in given:
        meant = [node for node in nodes if node.is_meant(each)]
        if not meant:
            _check_node(each, nodes)
        elif not is_of_rclpy(each.name) and not any(node.declares(each.name) for node in meant):
            warnings.append(_told_in_vain(each, meant))
    return [
        *dict.fromkeys(filter(None, warnings)), *_unused_files(given, nodes),
        *(line for node in nodes for line in _overruled(given, node))]


def _check_node(given: GivenParameter, nodes: Sequence[TakingNode]) -> None:
    """Refuse a ``-p`` for a node that is neither here nor another one of this package."""
    if given.file or given.is_for_many:
        return
    last = given.pattern.rpartition('/')[2]
    if last in _ROLES and not any(last in (node.role, node.name) for node in nodes):
        return  # One command line for several executables.
    names = ', '.join(node.full_name for node in nodes)
    raise ParameterError(
        f'-p {given.pattern.lstrip("/")}:{given.name}:=… is for the node {given.pattern}, this '
        f'process has {names}; without a name of a node it is for all of them')


def _told_in_vain(given: GivenParameter, meant: Sequence[TakingNode]) -> str:
    """Return what to say of a parameter that no node has, '' for nothing; raises if misspelt."""
    owners = [role for role in _ROLES if given.name in parameter_names(role)]
    roles = ', '.join(node.role for node in meant)
    nearest = _nearest(given.name, meant)
    unknown = f'unknown parameter {given.name!r} of {roles}, given {given.place}{nearest}'
    if not given.is_for_many:
        raise ParameterError(unknown)
    if given.file:
        return '' if owners else f'{unknown}; it is ignored'
    if not owners:
        raise ParameterError(unknown)
    return f'{roles} has no parameter {given.name}, which is one of {", ".join(owners)}: ignored'


def _nearest(name: str, meant: Sequence[TakingNode]) -> str:
    known = [
        *PARAMETERS_OF_RCLPY, *(own for node in meant for own in parameter_names(node.role))]
    return did_you_mean(name, known) or f'; `{meant[0].role} --help` lists what there is'


def _unused_files(
    given: Sequence[GivenParameter], nodes: Sequence[TakingNode],
) -> Iterator[str]:
    """Yield what to say of files with no section for any node of the process."""
    for file in dict.fromkeys(each.file for each in given if each.file):
        own = [each for each in given if each.file == file]
        if not any(node.is_meant(each) for each in own for node in nodes):
            names = ', '.join(node.full_name for node in nodes)
            patterns = ', '.join(dict.fromkeys(each.pattern for each in own))
            yield f'{file} gives nothing to {names}: it has sections for {patterns}'


def _overruled(given: Sequence[GivenParameter], node: TakingNode) -> Iterator[str]:
    """Yield what to say of each ``-p`` that gives way to a file."""
    by_pattern: dict[str, dict[str, GivenParameter]] = {}
    for each in given:
        by_pattern.setdefault(each.pattern, {})[each.name] = each
    arriving: dict[str, GivenParameter] = {}
    for pattern, values in by_pattern.items():
        if name_matches(pattern, node.full_name):
            arriving.update(values)
    last_words = {
        each.name: each for each in given
        if not each.file and name_matches(each.pattern, node.full_name)}
    for name, word in last_words.items():
        taken = arriving[name]
        if taken.file and taken.value != word.value and node.declares(name):
            yield (
                f'{name} is {taken.value!r} as {taken.file} says, not {word.value!r} as -p says: '
                'ROS lets every -p give way to the file if one of them, or a section /**, stands '
                'ahead of it; give --params-file first')
