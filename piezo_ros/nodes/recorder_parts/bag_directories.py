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

"""Where a recorder writes: every run has a bag of its own, and none is overwritten."""

import time
from pathlib import Path

from piezo_ros.model.parameters import ParameterError

__all__ = ['BagDirectories']


class BagDirectories:
    """
    Chooses the directories of the bags; the later ones of one recorder are numbered.

    Parameters
    ----------
    parameter : str, optional
        Name of the parameter that the user sets, for errors.
    prefix : str, optional
        What a name made of the time begins with.

    """

    def __init__(self, parameter: str = 'bag_directory', prefix: str = 'piezo') -> None:
        self._written: set[Path] = set()
        self._parameter = parameter
        self._prefix = prefix

    def next(self, bag_directory: str) -> Path:
        """
        Return a directory that does not exist.

        Parameters
        ----------
        bag_directory : str
            What the user wants; '' for one that the time names.

        Raises
        ------
        ParameterError
            If what the user wants exists, and not as the bag of an earlier run of this recorder.

        """
        first = Path(bag_directory or time.strftime(f'{self._prefix}_%Y_%m_%d-%H_%M_%S')).absolute()
        number = 1
        while (directory := _numbered(first, number)).exists():
            if bag_directory and directory not in self._written:
                raise ParameterError(f'{self._parameter} {directory} exists; it is not overwritten')
            number += 1
        return directory

    def note_written(self, directory: Path) -> None:
        """Take note that this recorder has begun a bag."""
        self._written.add(directory)


def _numbered(directory: Path, number: int) -> Path:
    return directory if number == 1 else directory.with_name(f'{directory.name}_{number}')
