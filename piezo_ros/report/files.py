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

"""Writes files atomically: a reader finds the old content or the new one, never a part."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from piezo_ros.parameters.errors import naming_file

__all__ = ['put_in_place', 'write_atomically']


@contextmanager
def put_in_place(path: Path) -> Iterator[Path]:
    """
    Have a file appear whole or not at all: what is written inside the context is put in its place.

    Parameters
    ----------
    path : Path
        The file; its directory is made when missing.

    Yields
    ------
    Path
        A file beside it to write; it is deleted where an error is raised.

    Raises
    ------
    OSError
        If the file cannot be written; it names the file, and the old file is then untouched.

    """
    unfinished = path.with_name(f'.{path.name}.{os.getpid()}.tmp')
    try:
        with naming_file(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            yield unfinished
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def write_atomically(path: Path, content: bytes | str) -> None:
    """
    Write a temporary file in the same directory and rename it to its final name.

    Parameters
    ----------
    path : Path
        The file; as for `put_in_place`.
    content : bytes or str
        What to write; text becomes UTF-8, its line ends unchanged. Bytes of a file name that are
        no text are escaped.

    Raises
    ------
    OSError
        If the directory or the file cannot be written; it names the file, and the old file is
        then untouched.

    """
    with put_in_place(path) as unfinished:
        unfinished.write_bytes(
            content.encode(errors='backslashreplace') if isinstance(content, str) else content)
