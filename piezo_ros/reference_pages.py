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

"""
The pages of the documentation that are printed from the code: parameters and launch arguments.

    python -m piezo_ros.reference_pages docs
"""

import dataclasses
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

from piezo_ros.launching.arguments import LaunchArgument, declared_arguments
from piezo_ros.model.parameters import CHANGES, Constraint, constraint_of
from piezo_ros.parameters.node_parameters import (
    NODE_PARAMETERS,
    ONLOOKER_PARAMETERS,
    PROGRAM_PARAMETERS,
    LoopNodeParameters,
)

__all__ = ['PAGES', 'launch_page', 'parameter_page']

_CHANGE_WORDS: Final = {
    'running': 'running', 'activation': 'inactive', 'configuration': 'unconfigured',
    'start': 'read-only'}
_PRINTED: Final = (
    'Printed from the code by `make docs`; changes belong there.')
_LAUNCH_FILES: Final = Path(__file__).resolve().parents[1] / 'launch'
_TYPES: Final = {bool: 'bool', int: 'int', float: 'double', str: 'string', tuple: 'double[]'}


def parameter_page() -> str:
    """Return the page of every parameter of every node, as Markdown."""
    lines = [
        '# Parameters', '', _PRINTED, '',
        '`ros2 param describe` tells the same of a running node. A value that is out of range, or',
        'that does not go together with the others, is refused with the reason; of several values',
        'in one atomic call all are taken or none. When a node takes a new value:', '',
        *(f'* {_CHANGE_WORDS[change]}: {text}' for change, text in CHANGES.items()), '',
        'Beside these every node has the standard `qos_overrides.<topic>.<publisher or',
        'subscription>.<policy>` of its topics, which are read-only, and `use_sim_time`.', '',
        '## Every node', '', *_parameter_table([LoopNodeParameters])]
    for node, sets in NODE_PARAMETERS.items():
        own = [each for each in sets if not issubclass(each, LoopNodeParameters)]
        lines += ['', f'## {node}', '', *_parameter_table(own)]
        if other := [
                f'`{field.name}` {_default(field.default)}' for each in sets
                if issubclass(each, LoopNodeParameters) for field in dataclasses.fields(each)
                if field.default != getattr(LoopNodeParameters, field.name)]:
            lines += ['', f'Of what every node has, it has by default {", ".join(other)}.']
    for program, sets in PROGRAM_PARAMETERS.items():
        own = [each for each in sets if not issubclass(each, LoopNodeParameters)]
        lines += [
            '', f'## {program}', '',
            'The node `plant` of a real stage, see [hardware.md](hardware.md).', '',
            *_parameter_table(own)]
    for node, sets in ONLOOKER_PARAMETERS.items():
        lines += [
            '', f'## {node}', '', 'It looks on, is not managed, and has these alone.', '',
            *_parameter_table(sets)]
    return '\n'.join([*lines, ''])


def launch_page() -> str:
    """Return the page of every launch file's arguments, as Markdown."""
    lines = [
        '# Launch files', '', _PRINTED, '',
        'Written to be read, and to be copied into a package of your own:',
        '[rig.launch.py](../launch/rig.launch.py), [loop.launch.py](../launch/loop.launch.py),',
        '[scan.launch.py](../launch/scan.launch.py).', '',
        '`ros2 launch piezo_ros FILE --show-args` tells the same. Each takes all nodes into one',
        '`namespace`. They end as soon as the recorder has closed its bag, or one of them has',
        'failed, which the log says; the launch is over when nothing of it is left.',
        'The nodes find each other themselves: none sends before its peers are there, so the order',
        'in which they start does not matter. With `autostart:=false` they stay unconfigured, for',
        'a lifecycle manager or `ros2 lifecycle set`.',
        'Parameter files are by default those in `config/`.',
        'An argument that the file does not declare is refused on the command line; launch itself',
        'ignores it. Where the file is included, the log warns of names that are nearly its own.',
        '', *_INCLUDED]
    for file in sorted(_LAUNCH_FILES.glob('*.launch.py')):
        lines += ['', f'## {file.name}', '', *_launch_table(declared_arguments(file))]
    return '\n'.join([*lines, ''])


_INCLUDED: Final = """\
## Include a rig in your own launch file

[examples/two_rigs.launch.py](examples/two_rigs.launch.py) has two rigs, the second one with other
names for its plant and one of its streams:

    GroupAction([
        PushROSNamespace('two'),
        SetRemap('plant:__node', 'stage'),
        SetRemap('displacement', 'position'),
        IncludeLaunchDescription(
            PathJoinSubstitution([FindPackageShare('piezo_ros'), 'launch', 'scan.launch.py']),
            launch_arguments={'record': 'true', 'bag_directory': 'two'}.items())])

* A rig that ends, well or not, ends its own nodes and nothing else. With `ends:=launch` it ends the
  whole launch.
* Put each include into a `GroupAction`. An argument that an include gives is set for all that
  follows in the same scope: without the group the next include has it too, where it does not give
  another. The log says for each rig what was not the default. What an included file only declares
  does not get out of it.
* `namespace` goes into what `PushROSNamespace` has pushed, unless it begins with a slash.
* `SetRemap` gives streams other names, in all nodes of the group, so that they still meet.
  `SetRemap('plant:__node', 'stage')` gives a node another name, under `composed` too; rules for it
  alone then name it by the new one: `SetRemap('stage:status', 'stage_status')`.
* `SetParameter` counts for every node of the group that has such a parameter, and more than
  arguments and files. A name that none of these nodes has is refused as misspelt: set it in a group
  that leaves the rig out.
* From SIGINT to SIGTERM a node has 10 s, or what `sigterm_timeout` says.
""".splitlines()

PAGES: Final = {'parameters.md': parameter_page, 'launch.md': launch_page}


def _parameter_table(sets: Iterable[Any]) -> list[str]:
    lines = [
        '| parameter | type | default | range | taken | meaning |', '|---|---|---|---|---|---|']
    for parameter_set in sets:
        for field in dataclasses.fields(parameter_set):
            constraint = constraint_of(field)
            lines.append(_row([
                f'`{field.name}`', _TYPES[type(field.default)], _default(field.default),
                _range(constraint), _CHANGE_WORDS[constraint.change], _meaning(constraint)]))
    return lines


def _launch_table(arguments: Iterable[LaunchArgument]) -> list[str]:
    lines = ['| argument | default | choices | meaning |', '|---|---|---|---|']
    for argument in arguments:
        lines.append(_row([
            f'`{argument.name}`', _default(argument.default),
            ', '.join(f'`{choice}`' for choice in argument.choices), argument.description]))
    return lines


def _row(cells: Sequence[str]) -> str:
    return '| ' + ' | '.join(cell.replace('|', '\\|') for cell in cells) + ' |'


def _default(value: Any) -> str:
    if isinstance(value, tuple):
        return '`[' + ', '.join(map(str, value)) + ']`'
    if isinstance(value, bool):
        return f'`{str(value).lower()}`'
    return f'`{value}`' if value != '' else 'empty'


def _range(constraint: Constraint) -> str:
    if constraint.choices:
        return ', '.join(f'`{choice}`' for choice in constraint.choices)
    low, high = constraint.minimum, constraint.maximum
    if low is None and high is None:
        return ''
    return f'{_bound(low)} … {_bound(high)}'.strip()


def _bound(value: float | None) -> str:
    if value is None:
        return ''
    return '2^53' if value == 2**53 else f'{value:g}'


def _meaning(constraint: Constraint) -> str:
    unit = f' [{constraint.unit}]' if constraint.unit else ''
    return constraint.description + unit


def main(arguments: Sequence[str]) -> int:
    """Write every page into the folder that is named."""
    (folder,) = arguments
    for name, page in PAGES.items():
        (Path(folder) / name).write_text(page(), encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
