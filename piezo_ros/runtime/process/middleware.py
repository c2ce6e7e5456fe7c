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

"""Settings of the middleware that must stand before rclpy is initialised."""

import os

from piezo_ros.runtime.process.distribution import name_of_distribution, profiles_of_fastdds

__all__ = ['set_middleware_defaults']


def set_middleware_defaults() -> None:
    """Set what the user has not set: see fastdds3.xml; other middlewares ignore it."""
    # Shared-memory segments of killed processes make endpoints match without data.
    os.environ.setdefault('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')
    variable, profiles = profiles_of_fastdds()
    os.environ.setdefault(variable, str(profiles))
    # An installation sets it, wheels do not; it goes into bags.
    os.environ.setdefault('ROS_DISTRO', name_of_distribution())
