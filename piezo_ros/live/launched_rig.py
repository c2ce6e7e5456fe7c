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

"""What the launch files have in common: names that are misspelt, and a rig that ends together."""

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction
from launch.events import Shutdown
from launch.events.process import ProcessExited, ShutdownProcess
from launch.launch_context import LaunchContext
from launch.logging import get_logger
from launch.utilities import perform_substitutions
from launch_ros.actions import Node

from piezo_ros.launching.arguments import (
    check_given,
    given_arguments,
    is_launched_by,
    misspelt_configurations,
)
from piezo_ros.launching.node_arguments import reason_to_end

__all__ = ['LaunchedRig', 'check_names']

PACKAGE = 'piezo_ros'


def check_names(
    context: LaunchContext, launch_file: Path, declared: Sequence[DeclareLaunchArgument],
) -> None:
    """
    Refuse arguments on the command line that a launch file does not declare; launch ignores them.

    Where another file includes it, what is given may be for that one: the log warns of names that
    are nearly those of this file.

    Parameters
    ----------
    context : LaunchContext
        From `launch`.
    launch_file : Path
        The launch file.
    declared : sequence of DeclareLaunchArgument
        What it declares.

    Raises
    ------
    PlanError
        If a name is none of the launch file's.

    """
    names = [argument.name for argument in declared]
    if is_launched_by(sys.argv, PACKAGE, launch_file):
        check_given(launch_file, names, [*context.argv])
        return
    misspelt = misspelt_configurations(names, context.launch_configurations)
    for name, meant in misspelt.items():
        get_logger(PACKAGE).warning(
            f'{launch_file.name}: {name} is no argument of it and changes nothing; did you '
            f'mean {meant!r}?')


class LaunchedRig:
    """
    The processes that one launch file starts, and that end together.

    Nothing else of the launch ends with them unless that is wanted: a launch is over once nothing
    of it is left, so that a launch file that stands alone is over with its rig all the same.

    Parameters
    ----------
    ends_launch : bool
        Whether the whole launch ends with the rig.

    """

    def __init__(self, *, ends_launch: bool) -> None:
        self._nodes: list[Node] = []
        self._ends_launch = ends_launch
        self._is_ending = False

    def started(
        self, nodes: Iterable[Node], launch_file: Path,
        declared: Sequence[DeclareLaunchArgument],
    ) -> list[Any]:
        """
        Return the actions that start the rig, and tell in the log what it was given.

        Parameters
        ----------
        nodes : iterable of Node
            Its processes, each with `one_has_ended` for its ``on_exit``.
        launch_file : Path
            The launch file that starts them.
        declared : sequence of DeclareLaunchArgument
            The arguments that it declares.

        """
        self._nodes = [*nodes]

        def tell(context: LaunchContext) -> None:
            defaults = {
                argument.name: perform_substitutions(context, argument.default_value)
                for argument in declared}
            given = given_arguments(defaults, context.launch_configurations)
            get_logger(PACKAGE).info(
                f'{launch_file.name} in {self._namespace}: {given or "defaults alone"}')

        return [*self._nodes, OpaqueFunction(function=tell)]

    @property
    def _namespace(self) -> str:
        """Where its nodes are, once they are started."""
        namespaces = [str(node.expanded_node_namespace) for node in self._nodes]
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
        tell(f'{self._namespace}: {reason}; ending {what}')
        if self._ends_launch:
            return EmitEvent(event=Shutdown(reason=reason))
        return EmitEvent(
            event=ShutdownProcess(process_matcher=lambda action: action in self._nodes))
