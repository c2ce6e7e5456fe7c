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

"""What a command reads against what it writes: no output may be an input, or another output."""

import itertools
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from piezo_ros.parameters.errors import PlanError

__all__ = ['Input', 'Output', 'check_inputs', 'check_named_files', 'check_outputs']

_OF_BAGS: Final = ('metadata.yaml', '*.mcap', '*.mcap.zstd')


class Input(NamedTuple):
    """
    A path that a command reads.

    Attributes
    ----------
    name : str
        What messages call it: the option or the argument, and the path.
    path : Path
        A file, or a directory of which everything is read.

    """

    name: str
    path: Path


class Output(NamedTuple):
    """
    A path that a command writes.

    Attributes
    ----------
    option : str
        The option that names it.
    path : Path
        The path.
    is_directory : bool
        Whether it is a directory, of which everything may be replaced.

    """

    option: str
    path: Path
    is_directory: bool


def check_outputs(outputs: Sequence[Output]) -> None:
    """
    Refuse outputs of which one would replace another.

    Parameters
    ----------
    outputs : sequence of Output
        All outputs of a command.

    Raises
    ------
    PlanError
        If two are one path, or one lies in the other.

    """
    for first, second in itertools.combinations(outputs, 2):
        if _is_same(_real(first.path), _real(second.path)):
            if first.option == second.option:
                raise PlanError(
                    f'{first.option} {first.path}: another file of this name is written too; give '
                    f'it another suffix than {second.path.suffix}')
            raise PlanError(
                f'{first.option} and {second.option} both are {first.path}; give one of them '
                'another path')
        for inner, outer in ((first, second), (second, first)):
            if _lies_in(_real(inner.path), _real(outer.path)):
                raise PlanError(
                    f'{inner.option} {inner.path} lies in {outer.option} {outer.path}; give one of '
                    'them another path')


def check_inputs(inputs: Sequence[Input], outputs: Sequence[Output]) -> None:
    """
    Refuse outputs that would replace what is read.

    Parameters
    ----------
    inputs : sequence of Input
        Files and directories; those that do not exist do not matter.
    outputs : sequence of Output
        All outputs of the command.

    Raises
    ------
    PlanError
        If an input is an output or lies in one, or is a directory of which an output is a part.

    """
    there = [output for output in outputs if os.path.lexists(output.path)]  # to be replaced
    for each in inputs if there else ():
        places = [*_places_of_all(each.path)]
        for output in there:
            _check_places(each.name, places, output)


def _check_places(name: str, places: Sequence[Path], output: Output) -> None:
    option, path = output.option, output.path
    # A link to a directory stays when the directory is emptied.
    replaced = [_real(path)] if output.is_directory else [*_places(path)]
    for place in places:
        if any(_is_same(place, each) for each in replaced):
            raise PlanError(
                f'{name} is what {option} {path} would replace; give {option} another path')
        if output.is_directory and _lies_in(place, _real(path)):
            raise PlanError(
                f'{name} lies in the output directory {path} ({option}), which would replace it; '
                f'give {option} another path')


def check_named_files(inputs: Sequence[Input], outputs: Sequence[Output]) -> None:
    """
    Refuse outputs that would replace what the inputs name: files of plans, motions, points.

    Parameters
    ----------
    inputs, outputs : sequence
        As for `check_inputs`.

    Raises
    ------
    PlanError
        As from `check_inputs`.

    """
    if not any(os.path.lexists(output.path) for output in outputs):
        return
    from piezo_ros.experiment.named_files import named_files
    check_inputs([
        Input(f'{file}, which {each.name} names,', file)
        for each in inputs for file in named_files(each.path)], outputs)


def _places_of_all(path: Path) -> Iterator[Path]:
    """Yield the places of a path; of a directory also those of the bag or the bags in it."""
    yield from _places(path)
    for pattern in _OF_BAGS:
        for file in path.glob(pattern):
            yield from _places(file)
    collection = path / 'bags'
    if collection.is_dir():
        yield from _places(collection)
    for folder, folders, files in os.walk(collection):
        for name in (*folders, *files):
            if os.path.islink(os.path.join(folder, name)):
                yield from _places(Path(folder, name))


def _places(path: Path) -> Iterator[Path]:
    """Yield where a path leads to, and the links on the way there."""
    unfollowed, followed = [path.absolute()], set()
    while unfollowed:
        whole = unfollowed.pop()
        for part in (whole, *whole.parents):
            if part not in followed and part.is_symlink():
                followed.add(part)
                yield _real(part.parent) / part.name
                unfollowed.append(part.parent / os.readlink(part))
    yield _real(path)


def _real(path: Path) -> Path:
    """Return a path without links; a circle of them, of which `Path.resolve` raises, stays."""
    return Path(os.path.realpath(path))


def _lies_in(inner: Path, outer: Path) -> bool:
    return any(_is_same(parent, outer) for parent in inner.parents)


def _is_same(first: Path, second: Path) -> bool:
    """Return whether two paths are one; some file systems do not tell capitals from others."""
    if first == second:
        return True
    if str(first).casefold() != str(second).casefold():
        return False
    try:
        return first.samefile(second)
    except OSError:
        return False
