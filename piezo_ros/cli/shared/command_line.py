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

"""The command line of ``piezo``: its commands, and how each of them ends."""

import argparse
import errno
import importlib
import io
import os
import shutil
import sys
import textwrap
from collections.abc import Sequence
from typing import Final

from piezo_ros.cli.shared.command_parser import CommandParser
from piezo_ros.cli.shared.exit_codes import EXIT_FAILED, EXIT_USAGE
from piezo_ros.crash_report import report_crashes
from piezo_ros.interruption import Interruption
from piezo_ros.matrix_threads import use_one_thread
from piezo_ros.parameters.errors import PlanError, failure_text
from piezo_ros.parameters.given_paths import check_paths
from piezo_ros.resource_limits import COMMAND_BYTES, GRAPH_BYTES, memory_problem

__all__ = ['COMMANDS', 'argument_parser', 'run_command_line']

_NO_ROOM: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)

# Where a shell asks for what may follow: eval "$(register-python-argcomplete piezo)"
_COMPLETION: Final = '_ARGCOMPLETE'

# Each with its line in `piezo --help`. The module of this name in `cli` describes its arguments
# (add_arguments) and does it; only the one that is asked for is imported.
COMMANDS: Final = {
    'init': 'copy one of the examples, to begin with',
    'run': 'start the node graph, record, analyse, report',
    'simulate': 'the same plan offline: no ROS, same numbers, same bags',
    'identify': 'hysteresis, dynamics, uncertainty or creep from bags',
    'tune': 'PI gains for a model',
    'plan': 'a scan at the limits of the amplifier, for the nodes to play',
    'learn': 'improve such a scan by runs of the stage',
    'replay': 'what a recorded run would have been',
    'report': 'score bags and write the report',
    'image': 'what a scanned image shows of two recorded axes',
    'bag': 'info, salvage, import, export, motion',
    'sweep': 'thousands of simulated runs over drawn parameters',
    'calibrate': "fit the simulated rig's mismatches to Table 4 (how config/rig.yaml was made)",
    'check': 'a node or device against its contract; a plan against its rig',
    'device': 'what is attached; output wired to input; scale of the sensor',
}


def run_command_line(arguments: Sequence[str], interruption: Interruption) -> int:
    """
    Do what a command line asks for.

    Parameters
    ----------
    arguments : sequence of str
        What follows the name of the program.
    interruption : Interruption
        The handler of stop signals in force.

    Returns
    -------
    int
        One of `piezo_ros.cli.shared.exit_codes`.

    """
    report_crashes()
    _write_any_text()
    try:
        code = _run(arguments, interruption)
        sys.stdout.flush()
        return code
    except PlanError as error:
        print(_wrapped(f'piezo: {error}'), file=sys.stderr)
        return EXIT_USAGE
    except BrokenPipeError:
        # The reader of the output has gone: `piezo bag info BAG | head -1`. Python flushes at exit.
        _discard_output()
    except MemoryError as error:
        print(f'piezo: {failure_text(error)}', file=sys.stderr)
    except OSError as error:
        if error.filename is None and error.errno in _NO_ROOM:
            error.filename = 'standard output'  # every other file is named where it is written
        print(f'piezo: {failure_text(error)}', file=sys.stderr)
        _discard_output()
    return EXIT_FAILED


def _wrapped(message: str) -> str:
    """Break the lines of a long message on a terminal; elsewhere it stays one line."""
    if not sys.stderr.isatty():
        return message
    return textwrap.fill(
        message, shutil.get_terminal_size().columns, subsequent_indent='  ',
        break_long_words=False, break_on_hyphens=False)


def _discard_output() -> None:
    """Drop what cannot be written to the output, which would be tried again at the exit."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _write_any_text() -> None:
    """Escape what the locale has no character for, such as the µ of a table."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors='backslashreplace')


def _run(arguments: Sequence[str], interruption: Interruption) -> int:
    use_one_thread()
    parser = argument_parser(arguments)
    if _COMPLETION in os.environ:
        from argcomplete import autocomplete
        autocomplete(parser)
    interruption.raise_what_came()  # an import may have caught it
    options = parser.parse_args(arguments)
    from piezo_ros.cli.shared.outputs import check_written  # as much as a command, --help has none
    check_paths(vars(options).values())
    check_written(parser, options)
    code = options.function(options)
    assert isinstance(code, int)
    return code


class _Version(argparse.Action):
    """Print the version of the installed package; looked for only where it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        """Print it and leave."""
        from piezo_ros.parameters.provenance import software_versions
        versions = software_versions()
        print(f'piezo_ros {versions["piezo_ros"] or "(not installed, from its sources)"}')
        parser.exit()


def argument_parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    """Return a parser that knows the options of the command that is among some arguments."""
    parser = CommandParser(
        prog='piezo', description='Piezo nano-positioning on ROS 2: run, analyse, report.')
    parser.add_argument(
        '--version', action=_Version, nargs=0, help='the version of this package')
    commands = parser.add_subparsers(dest='command_name', required=True, metavar='COMMAND')
    if _COMPLETION in os.environ:
        arguments = os.environ.get('COMP_LINE', '').split()
    asked_for = next((word for word in arguments if word in COMMANDS), None)
    for name, help_line in COMMANDS.items():
        command = commands.add_parser(
            name, help=help_line, formatter_class=argparse.RawDescriptionHelpFormatter)
        if name == asked_for:
            problem = memory_problem(GRAPH_BYTES if name == 'run' else COMMAND_BYTES)
            if problem:
                raise MemoryError(problem)
            importlib.import_module(f'piezo_ros.cli.{name}').add_arguments(command)
    return parser
