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

"""The process of the node that offers the streams as stamped messages."""

import sys
from typing import Any

import rclpy
from rclpy.exceptions import ParameterException

from piezo_ros.nodes.stamped import Stamped
from piezo_ros.runtime.node.rclpy_node.guard import explain, spin_guarded
from piezo_ros.runtime.process.leaving import exit_after
from piezo_ros.runtime.process.middleware import initialise_rclpy
from piezo_ros.runtime.process.parameter_check import check_given_parameters
from piezo_ros.runtime.process.ros_distribution import make_events_executor, name_of_distribution
from piezo_ros.runtime.process.stop_request import StopRequest

__all__ = ['main']

_LEAVE_S = 4.0


def _create_node(message_type: Any) -> Stamped | None:
    try:
        node = Stamped(message_type)
        check_given_parameters({'stamped': node}, sys.argv)
        return node
    except (ParameterException, RuntimeError, TypeError, ValueError) as error:
        # Names the parameter, its value and the range, or what of an overridden QoS is nonsense.
        print(f'stamped cannot start: {explain(error)}', file=sys.stderr)
        return None


def main() -> int:
    """Offer the streams until the process is asked to end; return its exit code."""
    stop = StopRequest()
    stop.listen()
    try:
        from sensor_msgs.msg import JointState
    except ImportError as error:
        print(
            f'stamped needs the ROS package sensor_msgs ({error}): install '
            f'ros-{name_of_distribution()}-sensor-msgs, or ros-sensor-msgs where ROS comes from '
            'PyPI; nothing else needs it', file=sys.stderr)
        return 1
    try:
        initialise_rclpy(sys.argv)
    except (RuntimeError, ValueError) as error:
        # No such parameter file, or arguments or an environment that ROS cannot use.
        print(error, file=sys.stderr)
        return 1
    code = 1
    executor = make_events_executor()
    try:
        node = _create_node(JointState)
        if node is not None:
            executor.add_node(node)
            spin_guarded(executor, node, lambda: bool(stop.signal_number))
            code = 0
    finally:
        exit_after(_LEAVE_S, code)
        executor.shutdown()
        rclpy.try_shutdown()
    return code
