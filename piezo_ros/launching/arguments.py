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

"""The arguments of the launch files, most of them parameters of the nodes."""

import dataclasses
import itertools
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final, NamedTuple

from piezo_ros.model.parameters import constraint_of
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.node_parameters import NODE_PARAMETERS
from piezo_ros.suggestions import did_you_mean

__all__ = [
    'LAUNCH_FILES',
    'PLANT_ARGUMENTS',
    'SCAN_ARGUMENTS',
    'LaunchArgument',
    'check_given',
    'given_arguments',
    'is_launched_by',
    'misspelt_configurations',
    'value_text',
]

# Arguments of scan.launch.py that are parameters -> the node that has them.
SCAN_ARGUMENTS: Final = {
    'scheme': 'controller',
    'waveform': 'trajectory',
    'amplitude_um': 'trajectory',
    'frequency_hz': 'trajectory',
    'harmonics': 'trajectory',
    'periods': 'trajectory',
    'ramp_periods': 'trajectory',
    'offset_um': 'trajectory',
    'turn_fraction': 'trajectory',
}
# Arguments of every launch file that are parameters of the plant.
PLANT_ARGUMENTS: Final = ('realtime_factor', 'publish_clock')
_TRUE_FALSE: Final = ('true', 'false')

# What launch itself takes from a command line, for every launch file.
_OF_LAUNCH: Final = (
    'emulate_tty', 'launch-prefix', 'launch-prefix-filter', 'sigkill_timeout', 'sigterm_timeout')
_ASSIGNS: Final = ':='
# How near to an argument a name must be to be meant for it (difflib's ratio).
_NEAR: Final = 0.85


class LaunchArgument(NamedTuple):
    """One argument of a launch file, as ``ros2 launch … --show-args`` shows it."""

    name: str
    default: str
    description: str
    choices: tuple[str, ...] = ()


def _of_parameter(node: str, name: str, *, else_of_file: bool = False) -> LaunchArgument:
    """
    Return the argument that sets a parameter.

    Parameters
    ----------
    node : str
        A node that has the parameter.
    name : str
        Name of parameter and argument.
    else_of_file : bool
        Whether the parameter is by default what the parameter file of the node says; else it is
        what the node has by itself, whatever the file says.

    """
    for parameter_set in NODE_PARAMETERS[node]:
        for field in dataclasses.fields(parameter_set):
            if field.name == name:
                constraint = constraint_of(field)
                unit = f' [{constraint.unit}]' if constraint.unit else ''
                choices = constraint.choices or (
                    _TRUE_FALSE if isinstance(field.default, bool) else ())
                default, description = value_text(field.default), constraint.description + unit
                if else_of_file:
                    default, description = '', (
                        f'{description}; empty: what a parameter file says, else {default}')
                return LaunchArgument(name, default, description, choices)
    raise LookupError(f'{node} has no parameter {name}')


def value_text(value: Any) -> str:
    """Return a value as it is written on a command line."""
    return str(value).lower() if isinstance(value, bool) else str(value)


_COMMON: Final = (
    LaunchArgument(
        'namespace', '', 'namespace of all nodes; a rig of its own in each; a relative one goes '
        'into the namespace that an enclosing launch file has pushed'),
    LaunchArgument('rig_file', 'rig.yaml', 'parameter file of the plant'),
    LaunchArgument('compensator_file', 'compensator.yaml', 'parameter file of the compensator'),
    LaunchArgument('controller_file', 'controller.yaml', 'parameter file of the controller'),
    LaunchArgument('trajectory_file', 'trajectory.yaml', 'parameter file of the trajectory'),
    _of_parameter('plant', 'sample_period_s'),
    LaunchArgument('record', 'false', 'start a recorder, and end with it', _TRUE_FALSE),
    _of_parameter('recorder', 'bag_directory'),
    _of_parameter('recorder', 'parameters_timeout_s'),
    _of_parameter('plant', 'handshake_timeout_s', else_of_file=True),
    LaunchArgument(
        'ends', 'rig', 'what ends with the recorder, or with a node that fails: the other nodes of '
        'this rig alone, or the whole launch', ('rig', 'launch')),
    *(_of_parameter('plant', name) for name in PLANT_ARGUMENTS),
    LaunchArgument(
        'clock_topic', '/clock', 'where publish_clock publishes; only one rig may have /clock'),
    _of_parameter('plant', 'autostart'),
    LaunchArgument(
        'log_level', 'info', 'what the nodes log', ('debug', 'info', 'warn', 'error', 'fatal')),
)
_WITHOUT: Final = LaunchArgument(
    'without', '', 'nodes not to start, separated by commas: your own take their place')
_SCAN: Final = tuple(_of_parameter(node, name) for name, node in SCAN_ARGUMENTS.items())
_COMPOSED: Final = LaunchArgument(
    'composed', 'false', 'the four nodes of the loop in one process, compiled', _TRUE_FALSE)

# Launch file -> its arguments. The parameter files are looked for in config/ by default.
LAUNCH_FILES: Final[Mapping[str, tuple[LaunchArgument, ...]]] = {
    'rig.launch.py': (*_COMMON, _WITHOUT),
    'loop.launch.py': _COMMON,
    'scan.launch.py': (*_SCAN, _COMPOSED, *_COMMON, _WITHOUT),
}


def given_arguments(launch_file: str, values: Mapping[str, str]) -> str:
    """Return what was given other than by default, for the log: the defaults go without saying."""
    return ', '.join(
        f'{argument.name}:={values[argument.name]}' for argument in LAUNCH_FILES[launch_file]
        if not argument.name.endswith('_file') and values[argument.name] != argument.default)


def is_launched_by(command_line: Sequence[str], package: str, launch_file: Path) -> bool:
    """
    Return whether a command line launches a launch file itself, not another one that includes it.

    Parameters
    ----------
    command_line : sequence of str
        That of ``ros2 launch``.
    package : str
        The package that installs the launch file.
    launch_file : Path
        The launch file.

    """
    for before, word in itertools.pairwise(command_line):
        if _ASSIGNS in word:
            continue
        # By package and name; else by path, of whichever copy or link.
        if (before, word) == (package, launch_file.name):
            return True
        if Path(word).name == launch_file.name and Path(word).exists():
            return Path(word).samefile(launch_file)
    return False


def check_given(launch_file: Path, words: Sequence[str]) -> None:
    """
    Refuse arguments that a launch file does not declare: launch itself ignores them.

    Parameters
    ----------
    launch_file : Path
        One of `LAUNCH_FILES`.
    words : sequence of str
        What was given on the command line, as ``name:=value``.

    Raises
    ------
    PlanError
        If a name is none of the launch file's.

    """
    allowed = [argument.name for argument in LAUNCH_FILES[launch_file.name]]
    for word in words:
        name, assigns, _ = word.partition(_ASSIGNS)
        if assigns and name not in (*allowed, *_OF_LAUNCH):
            raise PlanError(
                f'{launch_file}: unknown argument {word}; allowed are {", ".join(allowed)}'
                f'{did_you_mean(name, allowed)}')


def misspelt_configurations(launch_file: str, names: Iterable[str]) -> dict[str, str]:
    """
    Return launch configurations that are probably misspelt arguments of an included launch file.

    What an include gives it cannot be told from what the launch files around it have for
    themselves, so that a name counts only if it is very near to an argument that is not set.

    Parameters
    ----------
    launch_file : str
        One of `LAUNCH_FILES`.
    names : iterable of str
        The configurations that are set where it is included.

    Returns
    -------
    dict of str to str
        Name to the argument that was probably meant.

    Examples
    --------
    >>> misspelt_configurations('scan.launch.py', ['frequncy_hz', 'scheme', 'rig_name'])
    {'frequncy_hz': 'frequency_hz'}

    """
    given = [*names]
    arguments = [argument.name for argument in LAUNCH_FILES[launch_file]]
    missing = [name for name in arguments if name not in given]
    return {
        name: nearest[0] for name in given if name not in arguments
        and (nearest := get_close_matches(name, missing, n=1, cutoff=_NEAR))}
