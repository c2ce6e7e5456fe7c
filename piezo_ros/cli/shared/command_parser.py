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
from collections.abc import Iterator
from typing import NoReturn

from piezo_ros.suggestions import did_you_mean

__all__ = ['CommandParser']

_CHOICE = re.compile(r"invalid choice: '([^']*)' \(choose from (.*)\)$")
_UNKNOWN = re.compile(r'unrecognized arguments: .*?(--?[^\s=]+)')


class CommandParser(argparse.ArgumentParser):
    """An `argparse.ArgumentParser` for commands, of which the parsers of subcommands are too."""

    def error(self, message: str) -> NoReturn:
        """End the process with usage, message and suggestion, exit code 2."""
        choice, unknown = _CHOICE.search(message), _UNKNOWN.search(message)
        if choice:
            message += did_you_mean(choice[1], re.findall(r"[^\s',]+", choice[2]))
        elif unknown:
            message += did_you_mean(unknown[1], sorted(set(self._options())))
        super().error(message)

    def _options(self) -> Iterator[str]:
        """Yield the options of this parser and of those of its subcommands."""
        for action in self._actions:
            yield from action.option_strings
            if isinstance(action, argparse._SubParsersAction):
                for parser in action.choices.values():
                    yield from parser._options()
