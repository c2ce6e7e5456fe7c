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
Directories for what a program keeps for itself: also without a home, or with one of another user.

Containers and services often run without HOME, or with a home that they cannot write.
"""

import os
import stat
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

__all__ = ['cache_directory', 'is_writable', 'temporary_directory']


def cache_directory() -> Path:
    """
    Return the directory of the user for caches, made when missing.

    It is the first that can be written of ``$XDG_CACHE_HOME``, ``~/.cache`` and a temporary one.
    """
    return next(filter(is_writable, _caches()), None) or temporary_directory()


def is_writable(directory: Path) -> bool:
    """Return whether files can be made in a directory, which is made when missing."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(directory, os.W_OK | os.X_OK)


@cache
def temporary_directory() -> Path:
    """
    Return a directory among the temporary files that only this user can read and write.

    Raises
    ------
    OSError
        If there is no place for temporary files.

    """
    if not hasattr(os, 'getuid'):  # Windows, where temporary files are those of the user
        return Path(tempfile.mkdtemp(prefix='piezo_ros-'))
    directory = Path(tempfile.gettempdir()) / f'piezo_ros-{os.getuid()}'
    try:
        directory.mkdir(mode=0o700, exist_ok=True)
        found = directory.lstat()
    except OSError:
        return Path(tempfile.mkdtemp(prefix='piezo_ros-'))
    # Another user may have made it first, in order to put files into it.
    is_own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()
    if is_own and not found.st_mode & 0o077:
        return directory
    return Path(tempfile.mkdtemp(prefix='piezo_ros-'))


def _caches() -> Iterator[Path]:
    given = os.environ.get('XDG_CACHE_HOME')
    if given:
        yield Path(given)
    try:
        yield Path.home() / '.cache'
    except RuntimeError:  # no HOME, and no entry for the user in the password file
        return
