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
What the launch files start, and what ends with what.

Their arguments, the node executables that follow from them, and whose end ends the others. The
launch files themselves only hand this over to `launch`, so that it can be checked, documented
and tried without it.
"""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import yaml

from piezo_ros.experiment.node_parameters import NODE_PARAMETERS, check_node_parameters
from piezo_ros.experiment.parameter_file import read_parameter_file
from piezo_ros.model import ParameterError
from piezo_ros.model.parameters import constraint_of

__all__ = [
    'LAUNCH_FILES',
    'LaunchArgument',
    'NodeProcess',
    'given_arguments',
    'node_processes',
    'reason_to_end',
]

STAGES: Final = ('compensator', 'controller', 'plant', 'trajectory')
_SCAN_PARAMETERS: Final = {
    'scheme': 'controller',
    'waveform': 'trajectory',
    'amplitude_um': 'trajectory',
    'frequency_hz': 'trajectory',
    'harmonics': 'trajectory',
    'periods': 'trajectory',
    'ramp_periods': 'trajectory',
}
_FILES: Final = {
    'plant': 'rig_file',
    'compensator': 'compensator_file',
    'controller': 'controller_file',
    'trajectory': 'trajectory_file',
}
_PLANT_PARAMETERS: Final = ('realtime_factor', 'publish_clock')
_TRUE_FALSE: Final = ('true', 'false')
_UNTIL_TOLD_S: Final = -1.0


class LaunchArgument(NamedTuple):
    """One argument of a launch file, as ``ros2 launch … --show-args`` shows it."""

    name: str
    default: str
    description: str
    choices: tuple[str, ...] = ()


class NodeProcess(NamedTuple):
    """
    One process to start.

    Attributes
    ----------
    executable : str
        What is started.
    namespace : str
        As for a node of `launch_ros`: a relative one goes into the namespace that an enclosing
        launch file has pushed, an absolute one stands for itself, and '' is what was pushed.
    remappings : tuple of pairs of str
        Old and new name. Those of an enclosing launch file come first, and the first one counts.
    ros_arguments : tuple of str
        What follows ``--ros-args`` besides.

    """

    executable: str
    namespace: str
    remappings: tuple[tuple[str, str], ...]
    ros_arguments: tuple[str, ...]

    @property
    def command_line(self) -> tuple[str, ...]:
        """What follows the executable where it is started without an enclosing launch file."""
        words = ['--ros-args', *self.ros_arguments]
        if self.namespace:
            words += ['-r', f'__ns:=/{self.namespace.lstrip("/")}']
        for old, new in self.remappings:
            words += ['-r', f'{old}:={new}']
        return tuple(words)


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
                default, description = _text(field.default), constraint.description + unit
                if else_of_file:
                    default, description = '', (
                        f'{description}; empty: what a parameter file says, else {default}')
                return LaunchArgument(name, default, description, choices)
    raise LookupError(f'{node} has no parameter {name}')


def _text(value: Any) -> str:
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
    *(_of_parameter('plant', name) for name in _PLANT_PARAMETERS),
    LaunchArgument(
        'clock_topic', '/clock', 'where publish_clock publishes; only one rig may have /clock'),
    _of_parameter('plant', 'autostart'),
    LaunchArgument(
        'log_level', 'info', 'what the nodes log', ('debug', 'info', 'warn', 'error', 'fatal')),
)
_WITHOUT: Final = LaunchArgument(
    'without', '', 'nodes not to start, separated by commas: your own take their place')
_SCAN: Final = tuple(_of_parameter(node, name) for name, node in _SCAN_PARAMETERS.items())
_COMPOSED: Final = LaunchArgument(
    'composed', 'false', 'the four stages in one process, compiled', _TRUE_FALSE)

# Launch file -> its arguments. The parameter files are looked for in config/ by default.
LAUNCH_FILES: Final[Mapping[str, tuple[LaunchArgument, ...]]] = {
    'rig.launch.py': (*_COMMON, _WITHOUT),
    'loop.launch.py': _COMMON,
    'scan.launch.py': (*_SCAN, _COMPOSED, *_COMMON, _WITHOUT),
}


def node_processes(launch_file: str, values: Mapping[str, str]) -> list[NodeProcess]:
    """
    Return the processes that a launch file starts, readers before writers.

    Parameters
    ----------
    launch_file : str
        One of `LAUNCH_FILES`.
    values : mapping of str to str
        What its arguments are; every one of them.

    Returns
    -------
    list of NodeProcess
        The recorder first, if there is one.

    Raises
    ------
    ParameterError
        If an argument has a value that its parameter does not take, or `without` names no node;
        the text names the argument, the value and what is allowed.
    PlanError
        If a parameter file cannot be read.

    """
    composed = launch_file == 'loop.launch.py' or values.get('composed') == 'true'
    record = values['record'] == 'true'
    left_out = _left_out(values.get('without', ''), composed=composed)
    parameters = _parameters(launch_file, values, record=record)
    stages = [stage for stage in STAGES if stage not in left_out]
    names = [*(['recorder'] if record else []), *(['loop'] if composed else stages)]
    return [
        NodeProcess(
            name, _namespace(values['namespace']), _remappings(name, values, parameters),
            _ros_arguments(name, values, parameters))
        for name in names]


def reason_to_end(executable: str, exit_code: int) -> str:
    """
    Return why the other processes of a rig end now that one of them has, '' where they go on.

    Parameters
    ----------
    executable : str
        The process that has ended.
    exit_code : int
        How; a negative one is the signal that has killed it.

    """
    if exit_code < 0:
        return f'{executable} was killed by signal {-exit_code}'
    if exit_code:
        return f'{executable} failed with exit code {exit_code}'
    return f'{executable} is done' if executable == 'recorder' else ''


def given_arguments(launch_file: str, values: Mapping[str, str]) -> str:
    """Return what was given other than by default, for the log: it tells whose values one got."""
    return ', '.join(
        f'{argument.name}:={values[argument.name]}' for argument in LAUNCH_FILES[launch_file]
        if not argument.name.endswith('_file') and values[argument.name] != argument.default)


def _left_out(text: str, *, composed: bool) -> list[str]:
    names = [name.strip() for name in text.split(',') if name.strip()]
    for name in names:
        if name not in STAGES:
            raise ParameterError(
                f'without has {name!r}, allowed are {", ".join(STAGES)}')
    if names and composed:
        raise ParameterError(
            f'without is {text!r}, it must be empty with composed: one process holds all stages')
    return names


def _parameters(
    launch_file: str, values: Mapping[str, str], *, record: bool,
) -> dict[str, dict[str, Any]]:
    """Return the parameters of each node that go before those of its file, checked with them."""
    common = {
        name: _value(values[name])
        for name in ('sample_period_s', 'autostart', 'handshake_timeout_s') if values[name]}
    # With a recorder they stay until it has their parameters: it is what ends the launch.
    stage = {'required_readers': 2, 'linger_s': _UNTIL_TOLD_S} if record else {}
    parameters: dict[str, dict[str, Any]] = {
        name: {**common, **stage} for name in STAGES}
    parameters['recorder'] = {
        **common, 'bag_directory': values['bag_directory'],
        'parameters_timeout_s': _value(values['parameters_timeout_s'])}
    parameters['plant'] |= {name: _value(values[name]) for name in _PLANT_PARAMETERS}
    if launch_file == 'scan.launch.py':
        for name, node in _SCAN_PARAMETERS.items():
            parameters[node][name] = _value(values[name])
        # What the scheme auto decides by.
        for name in ('frequency_hz', 'amplitude_um'):
            parameters['controller'][f'scan_{name}'] = parameters['trajectory'][name]
    # The trajectory first: what the controller has of it is not what the user has given.
    for node, own in sorted(parameters.items(), key=lambda item: item[0] != 'trajectory'):
        in_file = {}
        if node in _FILES:
            in_file = read_parameter_file(_file(node, values), [node]).get(node, {})
        complete = check_node_parameters(node, {**in_file, **own})
        # As they are declared, 3 periods as 3.0: of two values for one parameter ROS takes the
        # integer, also where the other is that of a SetParameter.
        own.update((name, complete[name]) for name in own)
    return parameters


def _file(node: str, values: Mapping[str, str]) -> Path:
    return Path(values[_FILES[node]])


def _value(text: str) -> Any:
    """Return a value as `ros2 run … -p name:=text` would take it."""
    value = yaml.safe_load(text)
    if isinstance(value, str):
        try:
            return float(value)  # 1e-5, which is text for YAML 1.1
        except ValueError:
            return value
    return value


def _namespace(text: str) -> str:
    return text.rstrip('/') or text[:1]


def _nodes_of(executable: str) -> tuple[str, ...]:
    return STAGES if executable == 'loop' else (executable,)


def _remappings(
    executable: str, values: Mapping[str, str], parameters: Mapping[str, Mapping[str, Any]],
) -> tuple[tuple[str, str], ...]:
    if 'plant' in _nodes_of(executable) and parameters['plant']['publish_clock']:
        return (('clock', values['clock_topic']),)
    return ()


def _ros_arguments(
    executable: str, values: Mapping[str, str], parameters: Mapping[str, Mapping[str, Any]],
) -> tuple[str, ...]:
    nodes = _nodes_of(executable)
    words = ['--log-level', values['log_level']]
    for node in nodes:
        if node in _FILES:
            words += ['--params-file', str(_file(node, values))]
    # Without the name of a node, which would not be found in a namespace: no two nodes of a process
    # have parameters of one name that differ here.
    own = {name: value for node in nodes for name, value in parameters[node].items()}
    for name, value in own.items():
        if value != '':
            words += ['-p', f'{name}:={_typed(value)}']
    return tuple(words)


def _typed(value: Any) -> str:
    """Return a value as YAML 1.1, which takes 1e-05 for text."""
    if isinstance(value, float):
        text = repr(value)
        return text if '.' in text else text.replace('e', '.0e') if 'e' in text else text
    return _text(value)
