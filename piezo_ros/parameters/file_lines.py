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

"""Lines of YAML files, for errors about what is in them."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from piezo_ros.parameters.errors import PlanError

__all__ = ['LinedMapping', 'naming_line', 'with_line']

# A word, or what stands in quotes: a key may be misspelt into something that is no word.
_WORD: Final = re.compile(r"'[^'\s]*'|[A-Za-z_][A-Za-z0-9_]*")


class LinedMapping(dict[Any, Any]):
    """
    A mapping of a YAML file that knows the lines of its keys.

    Attributes
    ----------
    lines : dict of key to int
        Line of each key, counted from 1.

    """

    def __init__(self, values: Any = (), lines: Any = ()) -> None:
        super().__init__(values)
        self.lines: dict[Any, int] = dict(lines)

    @property
    def line(self) -> int:
        """Line of its first key, 0 where it has none."""
        return min(self.lines.values(), default=0)

    def line_named_in(self, text: str) -> int:
        """Return the line of the first of its keys, or of mappings in it, that a text names."""
        inside, line = self, self.line
        for word in (found.strip("'") for found in _WORD.findall(text)):
            if word in inside.lines:
                line = inside.lines[word]
                value = inside.get(word)
                if not isinstance(value, LinedMapping):
                    break
                inside = value
        return line


def with_line(path: Path | str, content: Any, text: str) -> str:
    """
    Return where in a YAML file an error is, to begin its message with.

    Parameters
    ----------
    path : Path or str
        The file.
    content : LinedMapping or value
        The mapping that the error is about; of another value no line is known.
    text : str
        The message, of which the first word that is a key of the mapping is the place.

    Returns
    -------
    str
        ``plan.yaml:7``, or the path alone.

    """
    line = content.line_named_in(text) if isinstance(content, LinedMapping) else 0
    return f'{path}:{line}' if line else str(path)


@contextmanager
def naming_line(where: str, path: Path | str, content: Any) -> Iterator[None]:
    """
    Let errors about a mapping of a YAML file name the line.

    Parameters
    ----------
    where : str
        What they begin with: the path, and the place in words.
    path : Path or str
        The file.
    content : LinedMapping or value
        The mapping.

    """
    try:
        yield
    except PlanError as error:
        text = str(error)
        if not text.startswith(where):
            raise
        rest = text[len(where):]
        raise PlanError(
            f'{with_line(path, content, rest)}{where[len(str(path)):]}{rest}') from None
