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

"""The arguments that the launch files declare: which there are, and what was misspelt."""

import ast
import itertools
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import Any, Final, NamedTuple

from piezo_ros.parameters.errors import PlanError
from piezo_ros.suggestions import did_you_mean

__all__ = [
    'LaunchArgument',
    'check_given',
    'declared_arguments',
    'given_arguments',
    'is_launched_by',
    'misspelt_configurations',
]

# What launch itself takes from a command line, for every launch file.
_OF_LAUNCH: Final = (
    'emulate_tty', 'launch-prefix', 'launch-prefix-filter', 'sigkill_timeout', 'sigterm_timeout')
_ASSIGNS: Final = ':='
# How near to an argument a name must be to be meant for it (difflib's ratio).
_NEAR: Final = 0.85


class LaunchArgument(NamedTuple):
    """One argument of a launch file, as ``ros2 launch … --show-args`` shows it."""

    name: str
    default: str
    description: str
    choices: tuple[str, ...] = ()


def declared_arguments(launch_file: Path) -> tuple[LaunchArgument, ...]:
    """
    Return the arguments that a launch file declares, without `launch`.

    Parameters
    ----------
    launch_file : Path
        A file that calls ``DeclareLaunchArgument`` with literal texts, or names that it imports. A
        default such as ``str(CONFIG / 'rig.yaml')`` stands for the file in that folder, here
        ``rig.yaml``.

    """
    nodes = [*ast.walk(ast.parse(launch_file.read_text(encoding='utf-8')))]
    module_of = {
        alias.name: str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)
        for alias in node.names}

    def value(node: ast.expr) -> Any:
        if isinstance(node, ast.Name):
            return getattr(import_module(module_of[node.id]), node.id)
        texts = [part.value for part in ast.walk(node) if isinstance(part, ast.Constant)]
        return texts[-1] if isinstance(node, ast.Call) else ast.literal_eval(node)

    def argument(call: ast.Call) -> LaunchArgument:
        given = {str(keyword.arg): value(keyword.value) for keyword in call.keywords}
        return LaunchArgument(
            value(call.args[0]), given['default_value'], given['description'],
            tuple(given.get('choices', ())))

    calls = [
        node for node in nodes
        if isinstance(node, ast.Call) and ast.unparse(node.func) == 'DeclareLaunchArgument']
    return tuple(argument(call) for call in sorted(calls, key=lambda call: call.lineno))


def given_arguments(defaults: Mapping[str, str], values: Mapping[str, str]) -> str:
    """
    Return what was given other than by default, for the log: the defaults go without saying.

    Parameters
    ----------
    defaults : mapping of str to str
        The arguments that are declared, with their defaults.
    values : mapping of str to str
        What they are.

    Examples
    --------
    >>> given_arguments({'periods': '15.0', 'scheme': 'fbff'}, {'periods': '3', 'scheme': 'fbff'})
    'periods:=3'

    """
    return ', '.join(
        f'{name}:={values[name]}' for name, default in defaults.items()
        if not name.endswith('_file') and values[name] != default)


def is_launched_by(command_line: Sequence[str], package: str, launch_file: Path) -> bool:
    """
    Return whether a command line launches a launch file itself, not another one that includes it.

    Parameters
    ----------
    command_line : sequence of str
        That of ``ros2 launch``.
    package : str
        The package that installs the launch file.
    launch_file : Path
        The launch file.

    """
    for before, word in itertools.pairwise(command_line):
        if _ASSIGNS in word:
            continue
        # By package and name; else by path, of whichever copy or link.
        if (before, word) == (package, launch_file.name):
            return True
        if Path(word).name == launch_file.name and Path(word).exists():
            return Path(word).samefile(launch_file)
    return False


def check_given(launch_file: Path, allowed: Sequence[str], words: Iterable[str]) -> None:
    """
    Refuse arguments that a launch file does not declare: launch itself ignores them.

    Parameters
    ----------
    launch_file : Path
        The launch file.
    allowed : sequence of str
        The names that it declares.
    words : iterable of str
        What was given on the command line, as ``name:=value``.

    Raises
    ------
    PlanError
        If a name is none of the launch file's.

    """
    for word in words:
        name, assigns, _ = word.partition(_ASSIGNS)
        if assigns and name not in (*allowed, *_OF_LAUNCH):
            raise PlanError(
                f'{launch_file}: unknown argument {word}; allowed are {", ".join(allowed)}'
                f'{did_you_mean(name, allowed)}')


def misspelt_configurations(allowed: Sequence[str], names: Iterable[str]) -> dict[str, str]:
    """
    Return launch configurations that are probably misspelt arguments of an included launch file.

    What an include gives it cannot be told from what the launch files around it have for
    themselves, so that a name counts only if it is very near to an argument that is not set.

    Parameters
    ----------
    allowed : sequence of str
        The names that the included launch file declares.
    names : iterable of str
        The configurations that are set where it is included.

    Returns
    -------
    dict of str to str
        Name to the argument that was probably meant.

    Examples
    --------
    >>> misspelt_configurations(['frequency_hz', 'scheme'], ['frequncy_hz', 'scheme', 'rig_name'])
    {'frequncy_hz': 'frequency_hz'}

    """
    given = [*names]
    missing = [name for name in allowed if name not in given]
    return {
        name: nearest[0] for name in given if name not in allowed
        and (nearest := get_close_matches(name, missing, n=1, cutoff=_NEAR))}
