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

"""Hands the table of `piezo_ros.experiment.launching` over to `launch`."""

from pathlib import Path
from typing import Any

from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction
from launch.events import Shutdown
from launch.launch_context import LaunchContext
from launch.launch_description import LaunchDescription
from launch_ros.actions import Node

from piezo_ros.experiment.launching import LAUNCH_FILES, node_processes

__all__ = ['describe']

PACKAGE = 'piezo_ros'


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

    def start(context: LaunchContext) -> list[Any]:
        values = {name: context.launch_configurations[name] for name, *_ in arguments}
        # Each node waits for its peers before the first sample, in whatever order they come up.
        return [
            Node(
                package=PACKAGE, executable=process.executable, output='screen',
                ros_arguments=list(process.ros_arguments), on_exit=_on_exit(process.executable))
            for process in node_processes(launch_file.name, values)]

    return LaunchDescription([
        *(DeclareLaunchArgument(
            argument.name, description=argument.description,
            choices=argument.choices or None,
            default_value=str(config / argument.default)
            if argument.name.endswith('_file') else argument.default)
          for argument in arguments),
        OpaqueFunction(function=start)])


def _on_exit(executable: str) -> Any:
    """Return a handler that ends the launch with its recorder, or with whoever failed."""
    def ended(event: Any, _context: LaunchContext) -> Any:
        if executable == 'recorder' or event.returncode:
            how = f'ended with exit code {event.returncode}' if event.returncode else 'is done'
            return EmitEvent(event=Shutdown(reason=f'{executable} {how}'))
        return None

    return ended
