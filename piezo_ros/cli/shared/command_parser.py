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

"""The parser of the command line: its errors say what was probably meant."""

import argparse
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NoReturn

from piezo_ros.cli.shared.given_options import ACTIONS
from piezo_ros.cli.shared.option_types import not_empty, path_type
from piezo_ros.suggestions import did_you_mean

__all__ = ['CommandParser']

_CHOICE: Final = re.compile(r"invalid choice: '([^']*)' \(choose from (.*)\)$")
_UNKNOWN: Final = re.compile(r'unrecognized arguments: .*?(--?[^\s=]+)')
# An error that completes the name of its option to a sentence.
_SENTENCE: Final = re.compile(r'argument (\S+): (?=is )')
# Of argparse only -1 and -1.5 are values, not -1e-3.
_NEGATIVE: Final = re.compile(r'-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$|-inf$|-nan$')


class CommandParser(argparse.ArgumentParser):
    """
    An `argparse.ArgumentParser` for commands, of which the parsers of subcommands are too.

    No text and no path may be empty, and what contradicts itself is refused, see
    `piezo_ros.cli.shared.given_options`.
    """

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self._negative_number_matcher = _NEGATIVE
        self._has_parsed = False
        self.register('type', None, not_empty)
        self.register('type', Path, path_type)
        for name, action in ACTIONS.items():
            self.register('action', name, action)

    def add_subparsers(self, **keywords: Any) -> Any:
        """Return what takes the parsers of subcommands."""
        action = super().add_subparsers(**keywords)
        action.type = str  # its words are those of the subcommand too
        return action

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None,
    ) -> tuple[Any, list[str]]:
        """Parse, and remember that this was the command."""
        for parser in self._commands():
            parser._has_parsed = parser is self
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """End the process with usage, message and suggestion, exit code 2."""
        message = _SENTENCE.sub(r'\1 ', message)
        asked = self._asked_for()
        choice, unknown = _CHOICE.search(message), _UNKNOWN.search(message)
        if choice:
            message += did_you_mean(choice[1], re.findall(r"[^\s',]+", choice[2]))
        elif unknown:
            takers = [
                parser.prog for parser in self._commands() if unknown[1] in parser._own_options()]
            message += (
                f'; {unknown[1]} is for {", ".join(takers)}, not for {asked.prog}' if takers
                else did_you_mean(unknown[1], sorted(set(asked._own_options()))))
        super(CommandParser, asked).error(message)

    def _asked_for(self) -> 'CommandParser':
        """Return the parser of the command that was asked for, of this one or below."""
        return next(
            (parser for parser in reversed([*self._commands()]) if parser._has_parsed), self)

    def _own_options(self) -> Iterator[str]:
        for action in self._actions:
            yield from action.option_strings

    def _commands(self) -> Iterator['CommandParser']:
        """Yield this parser and those of its subcommands."""
        yield self
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                for parser in action.choices.values():
                    yield from parser._commands()
