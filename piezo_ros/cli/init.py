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

"""``piezo init``: a copy of one of the examples, to run as it is and to change."""

import argparse
import shutil
from pathlib import Path
from typing import Final

from piezo_ros.cli.shared.exit_codes import EXIT_DONE
from piezo_ros.cli.shared.given_options import refuse_without_effect
from piezo_ros.cli.shared.outputs import OutputPath
from piezo_ros.experiment.output_directory import copy_plan
from piezo_ros.experiment.plan.packaged_plans import examples
from piezo_ros.parameters.errors import PlanError
from piezo_ros.suggestions import did_you_mean

__all__ = ['add_arguments']

_EXAMPLES: Final = """\
examples:
  piezo init                           which examples there are
  piezo init measured_stage            into the folder measured_stage
  piezo init demo -o my_scan
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    parser.epilog = _EXAMPLES
    parser.add_argument(
        'name', nargs='?', metavar='NAME', help='which example (default: list them)')
    parser.add_argument(
        '-o', '--output', type=Path, action=OutputPath, metavar='DIR',
        help='where to, which must not exist or be empty (default: NAME)')
    parser.set_defaults(function=_init)


def _init(options: argparse.Namespace) -> int:
    there = examples()
    if options.name is None:
        refuse_without_effect(options, ['output'], 'without NAME')
        for name, source in there.items():
            print(f'{name:16}{_title(source)}')
        return EXIT_DONE
    if options.name not in there:
        raise PlanError(
            f'there is no example {options.name!r}; there are {", ".join(there)}'
            f'{did_you_mean(options.name, there)}')
    directory = options.output or Path(options.name)
    if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
        raise PlanError(f'{directory} exists; -o DIR takes another')
    source = there[options.name]
    if source.is_dir():
        shutil.copytree(source, directory, dirs_exist_ok=True)
    else:
        directory.mkdir(parents=True, exist_ok=True)
        copy_plan(source, directory / source.name, '')
    for path in sorted(directory.iterdir()):
        print(f'{path}  {_title(path)}'.rstrip())
    print(f'next: {_next(source, directory)}')
    return EXIT_DONE


def _title(path: Path) -> str:
    """Return the first words of a file, or of the first file of a folder that has some."""
    if path.is_dir():
        path = path / 'README.md' if (path / 'README.md').is_file() else min(path.glob('*.yaml'))
    if path.suffix not in ('.yaml', '.md'):
        return ''
    lines = path.read_text(encoding='utf-8').splitlines()
    titles = [line.partition(':')[2].strip() for line in lines if line.startswith('title:')]
    first = lines[0].lstrip('# ').strip() if lines else ''
    return titles[0] if titles else first


def _next(source: Path, directory: Path) -> str:
    if source.is_dir():
        return f'cd {directory}, and the commands in README.md'
    command = 'sweep' if source.stem == 'sweep' else 'simulate'
    return f'piezo {command} {directory / source.name} -o {directory / "out"}'
