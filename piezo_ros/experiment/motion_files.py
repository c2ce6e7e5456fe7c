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

"""Where the motion files are that the runs of a plan and its parameter files name."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from piezo_ros.control.changes import changes_text
from piezo_ros.control.tables.table_changes import table_changes_entry
from piezo_ros.parameters.run_and_result import PlannedRun

__all__ = [
    'MOTION_KEY', 'MOTION_SUFFIX', 'motion_file', 'with_copied_motions', 'with_motion_files']

MOTION_KEY: Final = 'file'
MOTION_SUFFIX: Final = '.npz'  # of the motion beside the parameter file that plays it


def motion_file(folder: Path, name: str) -> Path:
    """
    Return the path of a motion file: from a folder, else from the working directory.

    Parameters
    ----------
    folder : Path
        The folder of the plan or parameter file that names it.
    name : str
        What that file says.

    """
    beside = folder / name
    return beside if beside.is_file() else Path(name)


def with_motion_files(folder: Path, entry: Mapping[str, Any]) -> dict[str, Any]:
    """
    Return the entry of a run with the paths of its motion files in place of their names.

    Parameters
    ----------
    folder : Path
        The folder of the plan or parameter file that names them.
    entry : mapping of str to value
        The entry: a file of its own, of its trajectory, of its changes; or parameters of a node.

    """
    found: dict[str, Any] = {}
    for key, value in entry.items():
        if key == MOTION_KEY and isinstance(value, str) and value:
            found[key] = str(motion_file(folder, value))
        elif isinstance(value, Mapping):
            found[key] = with_motion_files(folder, value)
        elif isinstance(value, list):
            found[key] = [
                with_motion_files(folder, each) if isinstance(each, Mapping) else each
                for each in value]
        else:
            found[key] = value
    return found


def with_copied_motions(run: PlannedRun, copies: Mapping[str, Path]) -> PlannedRun:
    """
    Return a run that plays the copies of its motion files.

    Parameters
    ----------
    run : PlannedRun
        The run.
    copies : mapping of str to Path
        Motion files to their copies; others are played where they are.

    """
    trajectory = run.trajectory
    if not trajectory.file:
        return run
    changes = [
        change._replace(file=str(copies.get(change.file, change.file)))
        for change in trajectory.table_changes]
    return replace(run, parameters={**run.parameters, 'trajectory': {
        **run.parameters['trajectory'],
        'file': str(copies.get(trajectory.file, trajectory.file)),
        'file_changes': changes_text(map(table_changes_entry, changes))}})
