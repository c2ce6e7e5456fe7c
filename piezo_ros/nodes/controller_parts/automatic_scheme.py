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

"""What the scheme auto of the controller stands for, from its configuration to its cleanup."""

from rclpy.node import Node
from rclpy.parameter import Parameter

from piezo_ros.control.controller_step import AUTO, ControllerParameters

__all__ = ['AutomaticScheme']


class AutomaticScheme:
    """
    Writes the scheme that auto stands for into the parameter, so that bags tell of it too.

    Parameters
    ----------
    node : Node
        The controller.

    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._chosen = ''

    def resolve(self, law: ControllerParameters) -> ControllerParameters:
        """Return a law with the scheme that auto stands for; with its own where it has one."""
        if law.scheme != AUTO:
            return law
        self._chosen = law.concrete_scheme
        resolved = law.replaced(scheme=self._chosen)
        self._node.set_parameters([Parameter('scheme', value=self._chosen)])
        self._node.get_logger().info(
            f'scheme auto is {self._chosen}: the scan has {law.scan_frequency_hz:g} Hz, '
            f'feedback is acceptable below {law.feedback_acceptable_below_hz:g} Hz')
        return resolved

    def forget(self) -> None:
        """Set the parameter back to auto, unless the user has set another scheme."""
        if self._chosen == self._node.get_parameter('scheme').value:
            self._node.set_parameters([Parameter('scheme', value=AUTO)])
        self._chosen = ''
