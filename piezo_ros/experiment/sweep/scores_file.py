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

"""The records of a sweep without directories: one file, to which each batch of runs is added."""

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

__all__ = ['ScoresFile']

_NAME: Final = 'scores.jsonl'


class ScoresFile:
    """
    One line of JSON for each run that is done.

    Parameters
    ----------
    directory : Path
        Directory of the sweep.

    """

    def __init__(self, directory: Path) -> None:
        self.path = directory / _NAME

    def read(self) -> dict[int, dict[str, Any]]:
        """Return number and record of every run; the torn line of an interruption is left out."""
        found: dict[int, dict[str, Any]] = {}
        try:
            lines = self.path.read_text(encoding='utf-8').splitlines()
        except FileNotFoundError:
            return found
        for line in lines:
            try:
                record = json.loads(line)
                found[record['number']] = record
            except (ValueError, KeyError, TypeError):
                continue
        return found

    def add(self, records: Iterable[Mapping[str, Any]]) -> None:
        """
        Add records of runs.

        Raises
        ------
        OSError
            If the file cannot be written.

        """
        with self.path.open('a+b') as file:
            if file.tell() and not _ends_with_line(file.fileno()):
                file.write(b'\n')  # behind the torn line of an interruption
            file.write(''.join(f'{json.dumps(record)}\n' for record in records).encode())


def _ends_with_line(descriptor: int) -> bool:
    os.lseek(descriptor, -1, os.SEEK_END)
    return os.read(descriptor, 1) == b'\n'
