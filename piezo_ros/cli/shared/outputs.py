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
Files and directories that a command writes, checked before it reads, writes or deletes anything.

An option of a command that is a path is an input unless its action is one of those here: what is
checked needs no list.
"""

import argparse
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from piezo_ros.cli.shared.given_options import StoredOption
from piezo_ros.cli.shared.path_collisions import (
    Input,
    Output,
    check_inputs,
    check_named_files,
    check_outputs,
)
from piezo_ros.experiment.output_directory import check_directory
from piezo_ros.parameters.errors import PlanError

__all__ = ['OutputDirectory', 'OutputFile', 'OutputPath', 'check_written']


class OutputPath(StoredOption):
    """The action of an option with a directory that the command makes, or goes on with."""

    def outputs(self, path: Path) -> tuple[Output, ...]:
        """Return what will be written there."""
        return (Output(_name_of(self), path, is_directory=True),)

    def check(self, path: Path, *, force: bool) -> None:
        """Refuse a path that could not be written, or must not be replaced."""
        _check_link(_name_of(self), path)


class OutputDirectory(OutputPath):
    """The action of an option with a directory that replaces an earlier output by ``--force``."""

    def check(self, path: Path, *, force: bool) -> None:
        """Refuse a path that could not be written, or must not be replaced."""
        super().check(path, force=force)
        check_directory(path, force=force)


class OutputFile(OutputPath):
    """
    The action of an option with a file to write.

    Parameters
    ----------
    beside : tuple of str, optional
        Suffixes of further files of the same name that are written.
    check_name : callable, optional
        Refuses the path of a file that could not have this name.

    """

    def __init__(
        self, *arguments: Any, beside: tuple[str, ...] = (),
        check_name: Callable[[Path], None] = lambda path: None, **options: Any,
    ) -> None:
        super().__init__(*arguments, **options)
        self._beside = beside
        self._check_name = check_name

    def outputs(self, path: Path) -> tuple[Output, ...]:
        """Return what will be written there."""
        files = [path, *(path.with_suffix(suffix) for suffix in self._beside if path.name)]
        return tuple(Output(_name_of(self), file, is_directory=False) for file in files)

    def check(self, path: Path, *, force: bool) -> None:
        """Refuse a path that could not be written, or must not be replaced."""
        self._check_name(path)
        for output in self.outputs(path):
            _check_link(output.option, output.path)
            _check_file(output.option, output.path, force=force)


def check_written(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """
    Refuse a command line that would delete or overwrite what the command needs.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        The parser of the command line.
    options : argparse.Namespace
        What it found.

    Raises
    ------
    PlanError
        If an output is an input, a file that an input names, or another output, or contains one of
        them; or if it could not be written or must not be replaced.

    """
    given = [
        (action, path) for action in _actions(parser, options)
        for path in _paths(getattr(options, action.dest, None))]
    written = [(action, path) for action, path in given if isinstance(action, OutputPath)]
    if not written:
        return
    outputs = [output for action, path in written for output in action.outputs(path)]
    inputs = [
        Input(f'{_name_of(action)} {path}', path) for action, path in given
        if not isinstance(action, OutputPath)]
    check_outputs(outputs)
    check_inputs(inputs, outputs)
    for action, path in written:
        action.check(path, force=getattr(options, 'force', False))
    check_named_files(inputs, outputs)


def _actions(
    parser: argparse.ArgumentParser, options: argparse.Namespace,
) -> Iterator[argparse.Action]:
    """Yield the options and arguments of the command that is asked for."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            yield from _actions(action.choices[getattr(options, action.dest)], options)
        else:
            yield action


def _paths(value: Any) -> Iterator[Path]:
    if isinstance(value, Path):
        yield value
    elif isinstance(value, list):
        for each in value:
            yield from _paths(each)


def _name_of(action: argparse.Action) -> str:
    """Return what messages call an option or an argument."""
    if action.option_strings:
        return action.option_strings[0]
    return str(action.metavar or action.dest)


def _check_file(option: str, path: Path, *, force: bool) -> None:
    """Refuse a file that could not be written, or must not be replaced."""
    if path.is_dir():
        raise PlanError(f'{option} {path} is a directory, it must be a file')
    if not path.exists():
        _check_place(option, path)
    elif not force:
        raise PlanError(f'{path} exists; --force replaces it')


def _check_link(option: str, path: Path) -> None:
    """Refuse a link that leads nowhere: what was meant may be on a disk that is not there now."""
    if path.is_symlink() and not path.exists():
        raise PlanError(
            f'{option} {path} is a symbolic link to {os.readlink(path)}, which does not exist; '
            'remove it, or give another path')


def _check_place(option: str, path: Path) -> None:
    """Refuse a path that cannot be made; the directories above it are made where missing."""
    above = next(parent for parent in path.absolute().parents if os.path.lexists(parent))
    if not above.is_dir():
        raise PlanError(f'{option} {path}: {above} is no directory')
    if not os.access(above, os.W_OK | os.X_OK):
        raise PlanError(f'{option} {path}: the directory {above} may not be written to')
