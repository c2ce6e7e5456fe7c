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

"""What the launch files start, without `launch`: stand-ins take the place of its classes."""

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import NamedTuple

from piezo_ros.launching.arguments import declared_arguments

__all__ = ['FOLDER', 'LAUNCH_FILES', 'default_values', 'started_by']

FOLDER = Path(__file__).resolve().parents[2] / 'launch'
LAUNCH_FILES = {path.name: declared_arguments(path) for path in sorted(FOLDER.glob('*.launch.py'))}
_OURS = 'piezo_ros.live.launched_rig'
_IMPORTED = {
    'launch': ['LaunchDescription'],
    'launch.actions': ['DeclareLaunchArgument', 'EmitEvent', 'GroupAction', 'OpaqueFunction'],
    'launch.events': ['Shutdown'],
    'launch.events.process': ['ProcessExited', 'ShutdownProcess'],
    'launch.launch_context': ['LaunchContext'],
    'launch.logging': ['get_logger'],
    'launch.substitutions': ['LaunchConfiguration'],
    'launch.utilities': ['perform_substitutions'],
    'launch_ros': [],
    'launch_ros.actions': ['Node'],
}


class _StandIn(SimpleNamespace):
    """Any class of `launch`: it keeps what it was made with."""

    def __init__(self, *values, **given):
        super().__init__(values=values, **given)


class StartedProcess(NamedTuple):
    """What a launch file tells `launch_ros` of one process."""

    executable: str
    namespace: str
    remappings: tuple
    ros_arguments: tuple

    @property
    def command_line(self):
        """What follows the executable where no other launch file encloses it."""
        words = ['--ros-args', *self.ros_arguments]
        if self.namespace:
            words += ['-r', f'__ns:=/{self.namespace.lstrip("/")}']
        for old, new in self.remappings:
            words += ['-r', f'{old}:={new}']
        return tuple(words)


def default_values(launch_file):
    """Return all arguments of a launch file as `launch` hands them over where none is given."""
    return {
        argument.name: str(FOLDER.parent / 'config' / argument.default)
        if argument.name.endswith('_file') else argument.default
        for argument in LAUNCH_FILES[launch_file]}


def started_by(launch_file, **given):
    """Return the processes that a launch file starts, in their order."""
    defaults = default_values(launch_file)
    assert given.keys() <= defaults.keys()
    modules = {name: ModuleType(name) for name in _IMPORTED}
    for name, classes in _IMPORTED.items():
        for each in classes:
            setattr(modules[name], each, type(each, (_StandIn,), {}))
    # Only these go again: of what else is imported meanwhile there must be one copy.
    before = {name: sys.modules.pop(name, None) for name in (*modules, _OURS)}
    sys.modules.update(modules)
    try:
        file = runpy.run_path(str(FOLDER / launch_file))
        actions = file['start'](SimpleNamespace(launch_configurations={**defaults, **given}))
    finally:
        for name, module in before.items():
            sys.modules.pop(name, None)
            if module is not None:
                sys.modules[name] = module
    return [
        StartedProcess(
            action.executable, action.namespace or '', tuple(getattr(action, 'remappings', ())),
            tuple(action.ros_arguments))
        for action in actions if isinstance(action, modules['launch_ros.actions'].Node)]
