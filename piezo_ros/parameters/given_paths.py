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

"""Paths of a command line, checked before anything runs."""

import errno
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from piezo_ros.parameters.errors import PlanError

__all__ = ['check_paths']

_NEVER_A_PATH: Final = (errno.ELOOP, errno.ENAMETOOLONG)


def check_paths(values: Iterable[Any]) -> None:
    """
    Check every path among some values, also in lists.

    Parameters
    ----------
    values : iterable
        What a command line gives.

    Raises
    ------
    PlanError
        If a path is no text, which reports, parameter files and bags need; or if the system cannot
        follow it: a circle of links, a name that is too long.

    """
    for value in values:
        if isinstance(value, Path):
            _check_path(value)
        elif isinstance(value, list):
            check_paths(value)


def _check_path(path: Path) -> None:
    try:
        absolute = os.path.abspath(path)
    except FileNotFoundError:
        raise PlanError(f'{path}: the working directory does not exist any more') from None
    try:
        absolute.encode()
    except UnicodeEncodeError:
        raise PlanError(
            f'{absolute!r} is no text in the encoding {sys.getfilesystemencoding()} of this '
            'locale; paths must be') from None
    try:
        path.stat()
    except OSError as error:
        # What else may be wrong with it is for the command that opens or makes it to say.
        if error.errno in _NEVER_A_PATH:
            raise PlanError(f'{path}: {error.strerror}') from None
