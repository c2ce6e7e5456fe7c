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

"""What a node executable answers to ``--help``, and to words that it does not know."""

import dataclasses
import os
import sys
import textwrap
from collections.abc import Sequence
from typing import Any

from rclpy.utilities import remove_ros_args

from piezo_ros.model.parameters import constraint_of
from piezo_ros.parameters.node_parameters import (
    NODE_PARAMETERS,
    PROGRAM_PARAMETERS,
    parameter_sets,
)

__all__ = ['answer_usage']

_HELP = ('-h', '--help')
_ASSIGNING = ('-p', '--param', '-r', '--remap')
_WITH_VALUE = (
    *_ASSIGNING, '--params-file', '-e', '--enclave', '--log-level', '--log-config-file',
    '--log-file-name')
_INDENT = ' ' * 8
_WIDTH = 100


def answer_usage(roles: Sequence[str], arguments: Sequence[str]) -> int | None:
    """
    Answer a request for help or a command line that cannot be meant.

    Parameters
    ----------
    roles : sequence of str
        What the process would run.
    arguments : sequence of str
        Its command line, the name of the executable first.

    Returns
    -------
    int or None
        Exit code: 0 after help, 2 after a refusal; None where the nodes shall run.

    """
    name = roles[0] if len(roles) == 1 else 'loop'
    if wrong := _misplaced(arguments):
        print(f'{name}: {wrong}; `{name} --help` lists the parameters', file=sys.stderr)
        return 2
    try:
        _, *words = remove_ros_args(list(arguments))
    except RuntimeError:
        return None  # rclpy says what is wrong as it starts.
    if any(word in _HELP for word in words):
        _print(_help(name, roles))
        return 0
    if words:
        example = words[0] if ':=' in words[0] else 'linger_s:=5.0'
        print(
            f'{name}: unknown argument {words[0]!r}; parameters follow --ros-args, as in\n'
            f'    {name} --ros-args -p {example}\n'
            f'`{name} --help` lists them', file=sys.stderr)
        return 2
    return None


def _misplaced(arguments: Sequence[str]) -> str:
    """Return what to say of the first word for ROS that is no option and no assignment."""
    is_for_ros, flag = False, ''
    for word in arguments:
        if word in ('--ros-args', '--'):
            is_for_ros, flag = word == '--ros-args', ''
        elif not is_for_ros:
            continue
        elif flag in _ASSIGNING and ':=' not in word:
            return f'{flag} {word} assigns nothing, it must be {flag} NAME:=VALUE'
        elif flag not in _WITH_VALUE and not word.startswith('-'):
            return f'unknown argument {word!r} behind --ros-args' + (
                f', did you mean -p {word}?' if ':=' in word else '')
        # The value of an option is none itself.
        flag = '' if flag in _WITH_VALUE else word
    return ''


def _print(text: str) -> None:
    """Print a text, of which a reader such as `head` may take a part."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        # What is left would be written once more as Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _help(name: str, roles: Sequence[str]) -> str:
    nodes = ' and '.join(filter(None, [', '.join(roles[:-1]), roles[-1]]))
    managed = set(roles) <= {*NODE_PARAMETERS, *PROGRAM_PARAMETERS}
    lines = [
        f'usage: {name} [--ros-args [-p NAME:=VALUE]... [--params-file FILE]... [-r FROM:=TO]...]',
        '',
        f'Runs {nodes}, managed by the lifecycle of ROS 2, to the end of the run or to Ctrl-C.'
        if managed else f'Runs {nodes}, which looks on, to Ctrl-C.']
    for role in roles:
        lines += ['', f'Parameters of {role}:']
        fields = {
            field.name: field
            for parameter_set in parameter_sets(role)
            for field in dataclasses.fields(parameter_set)}
        for field in fields.values():
            lines += _described(field)
    return '\n'.join(lines)


def _described(field: 'dataclasses.Field[Any]') -> list[str]:
    constraint = constraint_of(field)
    default = list(field.default) if isinstance(field.default, tuple) else field.default
    shown = str(default).lower() if isinstance(default, bool) else str(default)
    unit = f' {constraint.unit}' if constraint.unit else ''
    text = constraint.description
    if constraint.choices:
        text += f'; one of {", ".join(constraint.choices)}'
    elif constraint.minimum is not None and constraint.maximum is not None:
        text += f'; {constraint.minimum:g} … {constraint.maximum:g}{unit}'
    return [
        *textwrap.wrap(f'{field.name} (default {shown or "empty"}{unit})', _WIDTH,
                       initial_indent=' ' * 4, subsequent_indent=_INDENT),
        *textwrap.wrap(text, _WIDTH, initial_indent=_INDENT, subsequent_indent=_INDENT)]
