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
The output directory of a command: made, replaced only if it is an earlier output.

It can be done again from itself: its plan has the files that it names beside it.
"""

import errno
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import yaml

from piezo_ros.experiment.motion_files import MOTION_KEY, motion_file
from piezo_ros.experiment.named_files import file_nodes
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.portable_files import OUTPUT_MARKER
from piezo_ros.report.files import write_atomically

__all__ = [
    'PlanCopy', 'check_directory', 'copy_plan', 'keep_plan', 'prepare_directory',
    'resume_directory']

_PLAN_COPY: Final = 'plan.yaml'
_FILES_BELOW: Final = 'plan_files'


class PlanCopy(NamedTuple):
    """
    The copy of a plan.

    Attributes
    ----------
    text : str
        Its text.
    files : mapping of str to Path
        The files that the plan names, as found from its folder, to their copies.

    """

    text: str
    files: Mapping[str, Path]


def check_directory(directory: Path, *, force: bool) -> None:
    """
    Refuse a directory for the output that could not be made, or must not be replaced.

    Parameters
    ----------
    directory : Path
        Where the output shall go.
    force : bool
        Whether an earlier output, which bears the mark, may be replaced; nothing else may.

    Raises
    ------
    PlanError
        If the directory exists and may not be replaced.
    OSError
        If it could not be made.

    """
    # Only what is marked is ever deleted: a plan.yaml of the user's own may lie anywhere.
    if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
        if not force:
            raise PlanError(f'{directory} exists; --force replaces it')
        _check_mark(directory, 'it is not replaced')
    above = next(parent for parent in (
        directory.absolute(), *directory.absolute().parents) if parent.exists())
    if not above.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(directory))
    if not os.access(above, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(above))


def prepare_directory(directory: Path, *, force: bool) -> None:
    """
    Make a directory for the output, empty but for a mark that says what it is.

    All that a command reads must have been read before, or lie elsewhere.

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
    check_directory(directory, force=force)
    directory.mkdir(parents=True, exist_ok=True)
    mark = directory / OUTPUT_MARKER
    mark.touch()
    # The directory itself stays: it may be a link, or the working directory of a shell. So does
    # the mark: what an interruption leaves can be replaced again.
    for entry in directory.iterdir():
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry)
        elif entry != mark:
            entry.unlink()


def resume_directory(directory: Path, record: str, *, force: bool = False) -> bool:
    """
    Return whether a directory has an output to go on with; else make it ready for a new one.

    Parameters
    ----------
    directory : Path
        Where the output goes.
    record : str
        Name of the file with which an output of this kind can be gone on with.
    force : bool, optional
        Replace an earlier output in place of going on with it.

    Raises
    ------
    PlanError
        If the directory exists and is no output of this kind.

    """
    if not force and (directory / record).is_file():
        _check_mark(directory, 'it is not gone on with')
        return True
    prepare_directory(directory, force=force)
    return False


def _check_mark(directory: Path, what_then: str) -> None:
    if not (directory / OUTPUT_MARKER).is_file():
        raise PlanError(
            f'{directory} exists and is no earlier output (it has no {OUTPUT_MARKER}); '
            f'{what_then}')


def keep_plan(source: Path, directory: Path) -> PlanCopy:
    """
    Copy a plan to the output made from it, as plan.yaml, with the files that it names.

    The copy names its own files, so that it can be run wherever the directory is moved to.

    Parameters
    ----------
    source : Path
        The plan.
    directory : Path
        The output directory.

    Raises
    ------
    OSError
        If a file cannot be read or written.

    """
    return copy_plan(source, directory / _PLAN_COPY, _FILES_BELOW)


def copy_plan(source: Path, copy: Path, files_below: str) -> PlanCopy:
    """
    Copy a plan and the files that it names, with the motion files of its parameter files.

    Parameters
    ----------
    source : Path
        The plan.
    copy : Path
        Where the copy goes.
    files_below : str
        Folder beside the copy for the files, '' for the same folder.

    Raises
    ------
    OSError
        If a file cannot be read or written.

    """
    copies = _FileCopies(
        (copy.parent / files_below).resolve(), {} if files_below else {copy.name: source})
    text, root = copies.renamed(
        source, _text_of(source), f'{files_below}/' if files_below else '')
    text += _title_of(root, source)
    write_atomically(copy, text)
    return PlanCopy(text, copies.made)


class _FileCopies:
    """
    Copies of the files that a plan names, and of the motions that its parameter files name.

    Parameters
    ----------
    folder : Path
        Where they go.
    taken : dict of str to Path
        Names that they must not have there, and what has them.

    Attributes
    ----------
    made : dict of str to Path
        The files, as found, to their copies.

    """

    def __init__(self, folder: Path, taken: dict[str, Path]) -> None:
        self.made: dict[str, Path] = {}
        self._folder = folder
        self._taken = taken

    def renamed(self, source: Path, text: str, below: str) -> tuple[str, Any]:
        """Copy the files that a YAML file names; return its text with their names, and its root."""
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        replaced: list[tuple[int, int, str]] = []
        for key, node in file_nodes(root):
            name, is_motion = str(node.value), key == MOTION_KEY
            file = motion_file(source.parent, name) if is_motion else source.parent / name
            if file.is_file():
                replaced.append((
                    node.start_mark.index, node.end_mark.index,
                    below + self._copy(file, is_motion=is_motion)))
        for start, end, name in sorted(replaced, reverse=True):
            text = f'{text[:start]}{_scalar(name)}{text[end:]}'
        return text, root

    def _copy(self, file: Path, *, is_motion: bool) -> str:
        """Copy a file, unless it is there already; return the name of the copy."""
        name = _free_name(file, self._taken)
        self._taken[name] = file
        copy = self.made[str(file)] = self._folder / name
        if copy != file.resolve():
            before = '' if is_motion else _text_of(file)
            text = before and self.renamed(file, before, '')[0]
            write_atomically(copy, file.read_bytes() if text == before else text)
        return name


def _text_of(source: Path) -> str:
    return source.read_text(encoding='utf-8-sig')


def _free_name(file: Path, taken: dict[str, Path]) -> str:
    """Return a name for the copy of a file; another file of the same name has another one."""
    name, number = file.name, 1
    while name in taken and taken[name].resolve() != file.resolve():
        number += 1
        name = f'{file.stem}_{number}{file.suffix}'
    return name


def _scalar(text: str) -> str:
    """Return a text as a YAML scalar on one line."""
    return yaml.safe_dump([text], default_flow_style=True, width=10_000).strip()[1:-1]


def _title_of(root: Any, source: Path) -> str:
    """Return the line with the title of a plan that has none, which is the name of its file."""
    if (not isinstance(root, yaml.MappingNode) or root.flow_style
            or any(key.value == 'title' for key, _ in root.value)):
        return ''
    return f'\ntitle: {_scalar(source.stem)}\n'
