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
The processes that the launch files start, and which of them end when one has ended.

The launch files only hand these over to `launch`, so that they can be checked and tried without it.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from piezo_ros.launching.arguments import PLANT_ARGUMENTS, SCAN_ARGUMENTS, value_text
from piezo_ros.model import ParameterError
from piezo_ros.parameters.bounded_yaml import yaml_content
from piezo_ros.parameters.node_parameters import LOOP_NODES, check_node_parameters
from piezo_ros.parameters.parameter_file import read_parameter_file

__all__ = ['NodeProcess', 'node_processes', 'reason_to_end']

_FILES: Final = {
    'plant': 'rig_file',
    'compensator': 'compensator_file',
    'controller': 'controller_file',
    'trajectory': 'trajectory_file',
}
_UNTIL_TOLD_S: Final = -1.0


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
    nodes = ['loop'] if composed else [node for node in LOOP_NODES if node not in left_out]
    names = [*(['recorder'] if record else []), *nodes]
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


def _left_out(text: str, *, composed: bool) -> list[str]:
    names = [name.strip() for name in text.split(',') if name.strip()]
    for name in names:
        if name not in LOOP_NODES:
            raise ParameterError(
                f'without has {name!r}, allowed are {", ".join(LOOP_NODES)}')
    if names and composed:
        raise ParameterError(
            f'without is {text!r}, it must be empty with composed: one process holds all nodes')
    return names


def _parameters(
    launch_file: str, values: Mapping[str, str], *, record: bool,
) -> dict[str, dict[str, Any]]:
    """Return the parameters of each node that go before those of its file, checked with them."""
    common = {
        name: _value(values[name])
        for name in ('sample_period_s', 'autostart', 'handshake_timeout_s') if values[name]}
    # With a recorder they stay until it has their parameters: it is what ends the launch.
    recorded = {'required_readers': 2, 'linger_s': _UNTIL_TOLD_S} if record else {}
    parameters: dict[str, dict[str, Any]] = {
        name: {**common, **recorded} for name in LOOP_NODES}
    parameters['recorder'] = {
        **common, 'bag_directory': values['bag_directory'],
        'parameters_timeout_s': _value(values['parameters_timeout_s'])}
    parameters['plant'] |= {name: _value(values[name]) for name in PLANT_ARGUMENTS}
    if launch_file == 'scan.launch.py':
        for name, node in SCAN_ARGUMENTS.items():
            parameters[node][name] = _value(values[name])
        # What the scheme auto decides by.
        for name in ('frequency_hz', 'amplitude_um'):
            parameters['controller'][f'scan_{name}'] = parameters['trajectory'][name]
    # The trajectory first: what the controller has of it is not what the user has given.
    for node, own in sorted(parameters.items(), key=lambda item: item[0] != 'trajectory'):
        in_file: dict[str, Any] = {}
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
    value = yaml_content(text)
    if isinstance(value, str):
        try:
            return float(value)  # 1e-5, which is text for YAML 1.1
        except ValueError:
            return value
    return value


def _namespace(text: str) -> str:
    return text.rstrip('/') or text[:1]


def _nodes_of(executable: str) -> tuple[str, ...]:
    return LOOP_NODES if executable == 'loop' else (executable,)


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
    return value_text(value)
