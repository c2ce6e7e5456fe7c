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

"""What differs between the distributions of ROS 2: Jazzy, Kilted, and what comes after them."""

import os
from importlib import import_module, metadata
from pathlib import Path
from typing import Any, Final

__all__ = ['make_events_executor', 'name_of_distribution', 'profiles_of_fastdds']

# rclpy's major version -> the distribution that has it.
_DISTRIBUTIONS: Final = {'7': 'jazzy', '9': 'kilted'}


def name_of_distribution() -> str:
    """
    Return the distribution that runs, such as 'jazzy'; 'unknown' where nothing tells.

    A sourced installation says it in ``ROS_DISTRO``; wheels say it by the version of rclpy.
    """
    sourced = os.environ.get('ROS_DISTRO')
    if sourced:
        return sourced
    try:
        version = metadata.version('ros-rclpy')
    except metadata.PackageNotFoundError:
        return 'unknown'
    return _DISTRIBUTIONS.get(version.partition('.')[0], 'unknown')


def profiles_of_fastdds(*, localhost: bool = False) -> tuple[str, Path]:
    """
    Return the variable in which Fast DDS looks for its profiles, and the file of ours.

    Jazzy has Fast DDS 2, which spells some settings otherwise. Fast DDS 3 warns of the variable of
    Fast DDS 2.

    Parameters
    ----------
    localhost : bool
        Whether this machine alone is to find the process.

    """
    if name_of_distribution() == 'jazzy':
        variable, name = 'FASTRTPS_DEFAULT_PROFILES_FILE', 'fastdds2'
    else:
        variable, name = 'FASTDDS_DEFAULT_PROFILES_FILE', 'fastdds3'
    return variable, Path(__file__).with_name(name + '_localhost' * localhost + '.xml')


def make_events_executor() -> Any:
    """
    Return an executor that wakes for events alone; idling, the others use a share of a core.

    Raises
    ------
    ImportError
        If this rclpy has none; it says since when there is one.

    """
    # Where it came with rclpy 7.1.4, in Jazzy, and where it goes once it is experimental no more.
    for home in ('rclpy.experimental', 'rclpy.executors'):
        executor = getattr(import_module(home), 'EventsExecutor', None)
        if executor is not None:
            return executor()
    raise ImportError(
        'this rclpy has no EventsExecutor; it came with rclpy 7.1.4 of Jazzy: update ROS 2 '
        f'{name_of_distribution()}')
