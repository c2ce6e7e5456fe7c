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

"""What the actions of ``piezo bag`` share: errors, losses, the file to write."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from piezo_ros.bag import BagError
from piezo_ros.cli.shared.exit_codes import EXIT_DONE, EXIT_FAILED, EXIT_LOSS
from piezo_ros.cli.shared.outputs import OutputFile

__all__ = ['add_output', 'guarded']


def add_output(
    action: argparse.ArgumentParser, check_name: Callable[[Path], None] = lambda path: None,
) -> None:
    """Add the options of a file to write, of which the name is checked."""
    action.add_argument(
        '-o', '--output', type=Path, action=OutputFile, check_name=check_name, required=True,
        metavar='FILE')
    action.add_argument('--force', action='store_true', help='replace the file')


def guarded(
    action: Callable[[argparse.Namespace], tuple[str, ...]], options: argparse.Namespace,
) -> int:
    """Do an action, which returns sentences of what is lost; return the exit code."""
    try:
        lost = action(options)
    except BagError as error:
        print(f'piezo: {error}', file=sys.stderr)
        return EXIT_FAILED
    for loss in lost:
        print(f'piezo: {loss}', file=sys.stderr)
    return EXIT_LOSS if lost else EXIT_DONE
