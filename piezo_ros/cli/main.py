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

"""The command ``piezo``."""

import argparse
import sys
from collections.abc import Sequence

from piezo_ros.interruption import Interruption, remembering_interruption
from piezo_ros.matrix_threads import use_one_thread

__all__ = ['main']

EXIT_DONE, EXIT_FAILED, EXIT_USAGE, EXIT_LOSS = range(4)


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
        0 done, 1 failed, 2 usage (also a plan that cannot be run), 3 done with loss.

    """
    try:
        with remembering_interruption() as interruption:
            return _run(arguments, interruption)
    except KeyboardInterrupt:
        print('piezo: stopped by SIGINT', file=sys.stderr)
        return EXIT_FAILED


def _run(arguments: Sequence[str] | None, interruption: Interruption) -> int:
    use_one_thread()
    # Here, so that a Ctrl-C during the imports is caught as well.
    from piezo_ros.cli import (
        bag,
        calibrate,
        check,
        identify,
        replay,
        report,
        run,
        sweep,
        tune,
    )
    if interruption.came:  # an import may have caught it
        raise KeyboardInterrupt
    parser = argparse.ArgumentParser(
        prog='piezo', description='Piezo nano-positioning on ROS 2: run, analyse, report.')
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    run.add_commands(commands)
    identify.add_command(commands)
    tune.add_command(commands)
    replay.add_command(commands)
    report.add_command(commands)
    bag.add_command(commands)
    sweep.add_command(commands)
    calibrate.add_command(commands)
    check.add_command(commands)
    options = parser.parse_args(arguments)
    code = options.function(options)
    assert isinstance(code, int)
    return code


if __name__ == '__main__':
    sys.exit(main())
