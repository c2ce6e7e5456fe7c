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

"""Files that a command will write, checked before its work begins."""

import os
from pathlib import Path

from piezo_ros.parameters.errors import PlanError

__all__ = ['check_output']


def check_output(path: Path, *, force: bool) -> None:
    """
    Refuse a file that could not be written, or must not be replaced.

    Parameters
    ----------
    path : Path
        The file; directories that are missing will be made.
    force : bool
        Whether it may be replaced.

    Raises
    ------
    PlanError
        If it exists and may not be replaced, is a directory, or lies where no file can be made.

    """
    if path.is_dir():
        raise PlanError(f'-o {path} is a directory, it must be a file')
    if path.exists():
        if not force:
            raise PlanError(f'{path} exists; --force replaces it')
        return
    above = next(parent for parent in path.absolute().parents if os.path.lexists(parent))
    if not above.is_dir():
        raise PlanError(f'-o {path}: {above} is no directory')
    if not os.access(above, os.W_OK | os.X_OK):
        raise PlanError(f'-o {path}: the directory {above} may not be written to')
