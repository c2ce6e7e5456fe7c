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
What rclpy takes from the environment and the command line, checked before it is initialised.

rclpy and the middleware refuse these late, with a traceback or none, and name no variable.
"""

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from piezo_ros.parameters.errors import PlanError
from piezo_ros.user_directories import is_writable, temporary_directory

__all__ = [
    'check_ros_environment',
    'checked_arguments',
    'checked_namespace',
    'keep_discovery_on_this_machine',
]

_HIGHEST_DOMAIN: Final = 232  # the ports of the next one are beyond 65535
# Any of them is the user's own choice of which machines find each other.
_DISCOVERY_VARIABLES: Final = (
    'ROS_AUTOMATIC_DISCOVERY_RANGE', 'ROS_STATIC_PEERS', 'ROS_DISCOVERY_SERVER',
    'ROS_LOCALHOST_ONLY')
# Names of topics have at most 247 characters; what stands behind the namespace has 38 at most,
# /compensator/set_parameters_atomically.
_LONGEST_NAMESPACE: Final = 200
_NAMESPACE: Final = re.compile(r'/|(/[A-Za-z_][A-Za-z0-9_]*)+')
_REMAPPED_NAMESPACE: Final = re.compile(r'((?:[^:=]+:)?__ns:=)(.+)', re.DOTALL)


def check_ros_environment() -> None:
    """
    Check domain and log directory; choose a log directory where there is no home for one.

    Raises
    ------
    PlanError
        If a variable of the environment has a value that ROS cannot use; the text names it.

    """
    _check_domain(os.environ.get('ROS_DOMAIN_ID', ''))
    _check_log_directory()


def keep_discovery_on_this_machine() -> None:
    """
    Let nodes of this process and its children be found from this machine alone.

    Nothing is changed where the user has said anything about discovery.
    """
    if not any(os.environ.get(variable) for variable in _DISCOVERY_VARIABLES):
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'


def _check_domain(text: str) -> None:
    try:
        domain = int(text.strip() or '0')
    except ValueError:
        domain = -1
    if not 0 <= domain <= _HIGHEST_DOMAIN:
        raise PlanError(
            f'ROS_DOMAIN_ID is {text!r}, it must be an integer in 0 … {_HIGHEST_DOMAIN}')


def _check_log_directory() -> None:
    for variable, below in (('ROS_LOG_DIR', '.'), ('ROS_HOME', 'log')):
        value = os.environ.get(variable)
        if value:
            if not is_writable(Path(os.path.expanduser(value)) / below):
                raise PlanError(
                    f'{variable} is {value!r}, it must be a directory that can be written')
            return
    home = os.environ.get('HOME')
    if not home or not is_writable(Path(home) / '.ros' / 'log'):
        os.environ['ROS_LOG_DIR'] = str(temporary_directory() / 'log')
        is_writable(temporary_directory() / 'log')


def checked_namespace(text: str) -> str:
    """
    Return a namespace as ROS has it: one slash before each name, none behind the last.

    Raises
    ------
    PlanError
        If ROS does not take it, or names of topics in it would be too long.

    """
    namespace = '/' + text.strip('/')
    if not _NAMESPACE.fullmatch(namespace):
        raise PlanError(
            f'the namespace is {text!r}, allowed are names of letters, digits and _, which begin '
            'with no digit, with one / between them')
    if len(namespace) > _LONGEST_NAMESPACE:
        raise PlanError(
            f'the namespace is {text!r} and has {len(namespace)} characters, allowed are '
            f'{_LONGEST_NAMESPACE}')
    return namespace


def checked_arguments(arguments: Sequence[str]) -> list[str]:
    """
    Return the arguments of a node, the namespace in them as `checked_namespace` has it.

    Raises
    ------
    PlanError
        As `checked_namespace`.

    """
    checked = []
    for word in arguments:
        found = _REMAPPED_NAMESPACE.fullmatch(word)
        checked.append(f'{found[1]}{checked_namespace(found[2])}' if found else word)
    return checked
