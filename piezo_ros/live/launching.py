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

"""Hands the tables of `piezo_ros.launching` over to `launch`."""

import sys
from pathlib import Path
from typing import Any

from launch.actions import DeclareLaunchArgument, EmitEvent, GroupAction, OpaqueFunction
from launch.events import Shutdown
from launch.events.process import ProcessExited, ShutdownProcess
from launch.launch_context import LaunchContext
from launch.launch_description import LaunchDescription
from launch.logging import get_logger
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from piezo_ros.launching.arguments import (
    LAUNCH_FILES,
    check_given,
    given_arguments,
    is_launched_by,
    misspelt_configurations,
)
from piezo_ros.launching.processes import node_processes, reason_to_end

__all__ = ['describe']

PACKAGE = 'piezo_ros'
# From SIGINT to SIGTERM, where sigterm_timeout is not set. Nodes with a killed reader wait
# some seconds for its acknowledgements, which is longer than the 5 s that launch gives by itself.
_TIME_TO_END_S = '10'


def describe(launch_file: Path) -> LaunchDescription:
    """
    Return what a launch file declares and starts.

    Parameters
    ----------
    launch_file : Path
        The launch file itself, one of `LAUNCH_FILES`; config/ is beside its folder.

    """
    arguments = LAUNCH_FILES[launch_file.name]
    config = launch_file.parents[1] / 'config'

    def check(context: LaunchContext) -> None:
        # What is given to a launch file that includes this one may be for itself alone.
        if is_launched_by(sys.argv, PACKAGE, launch_file):
            check_given(launch_file, [*context.argv])
            return
        misspelt = misspelt_configurations(launch_file.name, context.launch_configurations)
        for name, meant in misspelt.items():
            get_logger(PACKAGE).warning(
                f'{launch_file.name}: {name} is no argument of it and changes nothing; did you '
                f'mean {meant!r}?')

    def start(context: LaunchContext) -> list[Any]:
        values = {name: context.launch_configurations[name] for name, *_ in arguments}
        rig = _Rig(ends_launch=values['ends'] == 'launch')
        # Each node waits for its peers before the first sample, in whatever order they come up.
        rig.nodes = [
            Node(
                package=PACKAGE, executable=process.executable, output='screen',
                namespace=process.namespace or None, remappings=list(process.remappings),
                ros_arguments=list(process.ros_arguments), on_exit=rig.one_has_ended,
                sigterm_timeout=LaunchConfiguration('sigterm_timeout', default=_TIME_TO_END_S))
            for process in node_processes(launch_file.name, values)]

        def tell(_context: LaunchContext) -> None:
            given = given_arguments(launch_file.name, values) or 'defaults alone'
            get_logger(PACKAGE).info(f'{launch_file.name} in {rig.namespace}: {given}')

        return [*rig.nodes, OpaqueFunction(function=tell)]

    # A scope of its own: else what is declared here would be the default of whatever launch file
    # is included next and has an argument of the same name.
    return LaunchDescription([GroupAction([
        OpaqueFunction(function=check),
        *(DeclareLaunchArgument(
            argument.name, description=argument.description,
            choices=argument.choices or None,
            default_value=str(config / argument.default)
            if argument.name.endswith('_file') else argument.default)
          for argument in arguments),
        OpaqueFunction(function=start)])])


class _Rig:
    """
    The processes that one launch file has started, and that end together.

    Nothing else of the launch ends with them unless that is wanted: a launch is over once nothing
    of it is left, so that a launch file that stands alone is over with its rig all the same.

    Parameters
    ----------
    ends_launch : bool
        Whether the whole launch ends with the rig.

    """

    def __init__(self, *, ends_launch: bool) -> None:
        self.nodes: list[Node] = []
        self._ends_launch = ends_launch
        self._is_ending = False

    @property
    def namespace(self) -> str:
        """Where its nodes are, once they are started."""
        namespaces = [str(node.expanded_node_namespace) for node in self.nodes]
        # Without any namespace launch_ros has a text there that says so.
        return namespaces[0] if namespaces and namespaces[0].startswith('/') else '/'

    def one_has_ended(self, event: ProcessExited, context: LaunchContext) -> Any:
        """Return what ends the others, if they shall."""
        reason = reason_to_end(event.action.node_executable, event.returncode)
        # A process that ends because it was told to, by us or the end of the launch, is no reason.
        if not reason or self._is_ending or context.is_shutdown:
            return None
        self._is_ending = True
        logger = get_logger(PACKAGE)
        what = 'the launch' if self._ends_launch else 'the other nodes of this rig'
        tell = logger.error if event.returncode else logger.info
        tell(f'{self.namespace}: {reason}; ending {what}')
        if self._ends_launch:
            return EmitEvent(event=Shutdown(reason=reason))
        return EmitEvent(event=ShutdownProcess(process_matcher=lambda action: action in self.nodes))
