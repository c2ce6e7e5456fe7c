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

"""Initialises rclpy, with the settings of the middleware that must stand before."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import rclpy
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions

from piezo_ros.runtime.process.ros_distribution import name_of_distribution, profiles_of_fastdds
from piezo_ros.runtime.process.ros_environment import check_ros_environment, checked_arguments

__all__ = ['initialise_rclpy', 'set_middleware_defaults', 'without_shared_memory']

_TRANSPORTS = 'FASTDDS_BUILTIN_TRANSPORTS'
_UDP = 'UDPv4'
_RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
_LOCALHOST_ONLY = 'ROS_LOCALHOST_ONLY'  # the older word for it, which overrules the range


def set_middleware_defaults() -> None:
    """Set what the user has not set: see fastdds3.xml; other middlewares ignore it."""
    # Shared-memory segments of killed processes make endpoints match without data.
    by_udp = os.environ.setdefault(_TRANSPORTS, _UDP) == _UDP
    variable, profiles = profiles_of_fastdds(localhost=by_udp and _stays_on_this_machine())
    os.environ.setdefault(variable, str(profiles))
    # An installation sets it, wheels do not; it goes into bags.
    os.environ.setdefault('ROS_DISTRO', name_of_distribution())


def _stays_on_this_machine() -> bool:
    """Return whether only this machine is to find the process, and no peers are named to it."""
    asked = os.environ.get(_RANGE) == 'LOCALHOST' or os.environ.get(_LOCALHOST_ONLY) == '1'
    return asked and not any(
        os.environ.get(peers) for peers in ('ROS_STATIC_PEERS', 'ROS_DISCOVERY_SERVER'))


@contextmanager
def without_shared_memory() -> Iterator[None]:
    """Let Fast DDS do without shared memory in the contexts of rclpy that are initialised here."""
    set_middleware_defaults()
    variable, profiles = profiles_of_fastdds(localhost=True)
    given = {name: os.environ.get(name) for name in (_RANGE, _LOCALHOST_ONLY)}
    if (_stays_on_this_machine() and os.environ.get(variable) == str(profiles)
            and 'fastrtps' in rclpy.get_rmw_implementation_identifier()):
        # The profile says where the process is found; the middleware shall make no transports.
        os.environ.pop(_LOCALHOST_ONLY, None)
        os.environ[_RANGE] = 'SYSTEM_DEFAULT'
    try:
        yield
    finally:
        for name, value in given.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


def initialise_rclpy(arguments: Sequence[str] = (), context: Context | None = None) -> None:
    """
    Initialise rclpy without its own handlers of signals.

    Parameters
    ----------
    arguments : sequence of str, optional
        The command line, from which it takes what follows ``--ros-args``.
    context : Context, optional
        What to initialise, the default context by default.

    Raises
    ------
    PlanError
        If a variable of the environment or the namespace is nothing that ROS can use.
    RuntimeError
        If rclpy refuses the arguments: there is no such parameter file, for instance.

    """
    check_ros_environment()
    with without_shared_memory():
        rclpy.init(
            args=checked_arguments(arguments), context=context,
            signal_handler_options=SignalHandlerOptions.NO)
