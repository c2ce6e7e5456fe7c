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

"""The output directory of a command: made, replaced only if it is an earlier output."""

import shutil
from pathlib import Path
from typing import Final

from piezo_ros.parameters.errors import PlanError
from piezo_ros.report.files import write_atomically

__all__ = ['keep_plan', 'prepare_directory']

# Only what bears this name is ever deleted: a plan.yaml of the user's own may lie anywhere.
_MARKER: Final = '.piezo_output'
_PLAN_COPY: Final = 'plan.yaml'


def prepare_directory(directory: Path, *, force: bool) -> None:
    """
    Make a directory for the output, empty but for a mark that says what it is.

    Parameters
    ----------
    directory : Path
        Where the output goes.
    force : bool
        Replace an earlier output, which bears the mark; nothing else is ever deleted.

    Raises
    ------
    PlanError
        If the directory exists and may not be replaced.

    """
    if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
        if not force:
            raise PlanError(f'{directory} exists; --force replaces it')
        if not (directory / _MARKER).is_file():
            raise PlanError(
                f'{directory} exists and is no earlier output (it has no {_MARKER}); '
                'it is not replaced')
        shutil.rmtree(directory)
    directory.mkdir(parents=True, exist_ok=True)
    (directory / _MARKER).touch()


def keep_plan(source: Path, directory: Path) -> str:
    """Copy the file of a plan to the output made from it; return its text, for the report."""
    content = source.read_bytes()
    write_atomically(directory / _PLAN_COPY, content)
    return content.decode('utf-8')
