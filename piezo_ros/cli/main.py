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

# PYTHON_ARGCOMPLETE_OK

"""
The command ``piezo``.

Whatever takes time is imported once Ctrl-C is remembered: Python drops a KeyboardInterrupt that it
raises where an import cleans up.
"""

import sys
from collections.abc import Sequence

from piezo_ros.interruption import remembering_interruption, stopped_by

__all__ = ['main']


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        ``sys.argv[1:]`` by default.

    Returns
    -------
    int
        One of `piezo_ros.cli.shared.exit_codes`.

    """
    try:
        with remembering_interruption() as interruption:
            from piezo_ros.cli.shared.command_line import run_command_line
            return run_command_line(sys.argv[1:] if arguments is None else arguments, interruption)
    except KeyboardInterrupt as interrupt:
        from piezo_ros.cli.shared.exit_codes import EXIT_FAILED
        print(f'piezo: {stopped_by(interrupt)}', file=sys.stderr)
        return EXIT_FAILED


if __name__ == '__main__':
    sys.exit(main())
