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

"""The page of the command `piezo`: the help of every subcommand, as the terminal shows it."""

import argparse
import os
from collections.abc import Iterator
from pathlib import Path

from piezo_ros.cli.shared.command_line import COMMANDS, argument_parser

PAGE = Path('generated', 'command-line.rst')
COLUMNS = 80


def parsers_below(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """Yield a parser, or in its place those of its subcommands."""
    inner = [
        action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    if not inner:
        yield parser
    for action in inner:
        for subparser in {id(each): each for each in action.choices.values()}.values():
            yield from parsers_below(subparser)


def page() -> str:
    """Return the page as reStructuredText."""
    lines = [
        'Command line', '============', '', 'Every command tells the same with ``--help``.', '']
    for command, summary in COMMANDS.items():
        whole = argument_parser([command])
        (of_command,) = [
            parser for action in whole._actions
            if isinstance(action, argparse._SubParsersAction)
            for name, parser in action.choices.items() if name == command]
        title = f'piezo {command}'
        lines += [title, '-' * len(title), '', summary[0].upper() + summary[1:] + '.', '']
        parsers = [*parsers_below(of_command)]
        for parser in parsers:
            if len(parsers) > 1:
                lines += [parser.prog, '~' * len(parser.prog), '']
            lines += ['.. code-block:: text', '']
            lines += [f'   {line}'.rstrip() for line in parser.format_help().splitlines()] + ['']
    return '\n'.join(lines)


def write_page(app, config):
    """Write the page before Sphinx looks for its documents."""
    before = os.environ.get('COLUMNS')
    os.environ['COLUMNS'] = str(COLUMNS)
    try:
        text = page()
    finally:
        if before is None:
            del os.environ['COLUMNS']
        else:
            os.environ['COLUMNS'] = before
    path = Path(app.srcdir) / PAGE
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text(encoding='utf-8') != text:
        path.write_text(text, encoding='utf-8')


def setup(app):
    """Connect to Sphinx."""
    app.connect('config-inited', write_page)
    return {'parallel_read_safe': True}
