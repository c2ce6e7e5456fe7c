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

"""Two rigs in one launch; in the second one the plant and one of the streams have other names."""

from launch import LaunchDescription
from launch.actions import GroupAction, IncludeLaunchDescription
from launch.substitutions import PathJoinSubstitution
from launch_ros.actions import PushROSNamespace, SetRemap
from launch_ros.substitutions import FindPackageShare

SCAN = PathJoinSubstitution([FindPackageShare('piezo_ros'), 'launch', 'scan.launch.py'])


def rig(namespace, *renamed, **arguments):
    # The group keeps namespace, names and arguments from whatever is included next.
    return GroupAction([
        PushROSNamespace(namespace), *renamed,
        IncludeLaunchDescription(
            SCAN, launch_arguments={'record': 'true', **arguments}.items())])


def generate_launch_description():
    return LaunchDescription([
        rig('one', bag_directory='one', periods='15'),
        rig('two', SetRemap('plant:__node', 'stage'), SetRemap('displacement', 'position'),
            bag_directory='two', scheme='ff', periods='1500')])
