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

"""The whole loop, one process for every node; leave out what you replace by your own."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from piezo_ros.launching.node_arguments import (
    checked_parameters,
    node_namespace,
    nodes_left_out,
    ros_arguments,
)
from piezo_ros.live.launched_rig import LaunchedRig, check_names

CONFIG = Path(__file__).parents[1] / 'config'

ARGUMENTS = [
    DeclareLaunchArgument(
        'namespace', default_value='',
        description=
        'namespace of all nodes; a rig of its own in each; a relative one goes into the '
        'namespace that an enclosing launch file has pushed'),
    DeclareLaunchArgument(
        'rig_file', default_value=str(CONFIG / 'rig.yaml'),
        description='parameter file of the plant'),
    DeclareLaunchArgument(
        'compensator_file', default_value=str(CONFIG / 'compensator.yaml'),
        description='parameter file of the compensator'),
    DeclareLaunchArgument(
        'controller_file', default_value=str(CONFIG / 'controller.yaml'),
        description='parameter file of the controller'),
    DeclareLaunchArgument(
        'trajectory_file', default_value=str(CONFIG / 'trajectory.yaml'),
        description='parameter file of the trajectory'),
    DeclareLaunchArgument(
        'sample_period_s', default_value='1e-05',
        description='simulated sample period; blocks with another one end the run [s]'),
    DeclareLaunchArgument(
        'record', default_value='false', choices=['true', 'false'],
        description='start a recorder, and end with it'),
    DeclareLaunchArgument(
        'bag_directory', default_value='',
        description='directory of the bag; must not exist; empty: named after date and time'),
    DeclareLaunchArgument(
        'parameters_timeout_s', default_value='3.0',
        description='how long to wait for the parameters of the other nodes [s]'),
    DeclareLaunchArgument(
        'handshake_timeout_s', default_value='',
        description=
        'how long activation waits for the peers; it goes slower on a busy machine [s]; '
        'empty: what a parameter file says, else 10.0'),
    DeclareLaunchArgument(
        'ends', default_value='rig', choices=['rig', 'launch'],
        description=
        'what ends with the recorder, or with a node that fails: the other nodes of this '
        'rig alone, or the whole launch'),
    DeclareLaunchArgument(
        'realtime_factor', default_value='0.0',
        description='simulated seconds per wall-clock second; 0: as fast as possible'),
    DeclareLaunchArgument(
        'publish_clock', default_value='false', choices=['true', 'false'],
        description=
        'publish the simulated time on the topic clock, for one rig remapped to /clock'),
    DeclareLaunchArgument(
        'clock_topic', default_value='/clock',
        description='where publish_clock publishes; only one rig may have /clock'),
    DeclareLaunchArgument(
        'autostart', default_value='true', choices=['true', 'false'],
        description='configure and activate at start, without a lifecycle manager'),
    DeclareLaunchArgument(
        'log_level', default_value='info', choices=['debug', 'info', 'warn', 'error', 'fatal'],
        description='what the nodes log'),
    DeclareLaunchArgument(
        'without', default_value='',
        description='nodes not to start, separated by commas: your own take their place'),
]


def start(context):
    """Return what starts the nodes, readers before writers; each waits for its peers."""
    given = context.launch_configurations
    left_out = nodes_left_out(given['without'])
    files = {
        'plant': given['rig_file'], 'compensator': given['compensator_file'],
        'controller': given['controller_file'], 'trajectory': given['trajectory_file']}
    common = {
        name: given[name] for name in ('sample_period_s', 'autostart', 'handshake_timeout_s')
        if given[name]}
    # With a recorder, which reads every stream, the nodes stay until it has their parameters.
    recorded = {'required_readers': 2, 'linger_s': -1.0} if given['record'] == 'true' else {}
    loop = {**common, **recorded}
    # Refused with their names before anything is started.
    parameters = checked_parameters({
        'trajectory': loop,
        'controller': loop,
        'compensator': loop,
        'plant': {
            **loop, 'realtime_factor': given['realtime_factor'],
            'publish_clock': given['publish_clock']},
        'recorder': {
            **common, 'bag_directory': given['bag_directory'],
            'parameters_timeout_s': given['parameters_timeout_s']},
    }, files)

    def told(*nodes):
        # By -p, not by `parameters`: so a SetParameter of an enclosing launch file counts more.
        return ['--log-level', given['log_level'], *ros_arguments(nodes, parameters, files)]

    clock = [('clock', given['clock_topic'])] if parameters['plant']['publish_clock'] else []
    rig = LaunchedRig(ends_launch=given['ends'] == 'launch')
    shared = {
        'package': 'piezo_ros', 'namespace': node_namespace(given['namespace']) or None,
        'output': 'screen', 'on_exit': rig.one_has_ended,
        # Nodes with a killed reader wait some seconds for its acknowledgements, which is longer
        # than the 5 s from SIGINT to SIGTERM that launch gives by itself.
        'sigterm_timeout': LaunchConfiguration('sigterm_timeout', default='10')}
    recorder = [
        Node(executable='recorder', ros_arguments=told('recorder'), **shared),
    ] if given['record'] == 'true' else []
    nodes = {
        'compensator': Node(
            executable='compensator', ros_arguments=told('compensator'), **shared),
        'controller': Node(
            executable='controller', ros_arguments=told('controller'), **shared),
        'plant': Node(
            executable='plant', ros_arguments=told('plant'), remappings=clock, **shared),
        'trajectory': Node(
            executable='trajectory', ros_arguments=told('trajectory'), **shared),
    }
    started = [node for name, node in nodes.items() if name not in left_out]
    return rig.started([*recorder, *started], Path(__file__), ARGUMENTS)


def generate_launch_description():
    # A scope of its own: else what is declared here would be the default of whatever launch file
    # is included next and has an argument of the same name.
    return LaunchDescription([GroupAction([
        OpaqueFunction(function=check_names, args=[Path(__file__), ARGUMENTS]),
        *ARGUMENTS,
        OpaqueFunction(function=start)])])
