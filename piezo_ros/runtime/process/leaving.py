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

"""
How a node leaves the graph, and its process the machine, although the middleware may hang in it.

Fast DDS 3.2 hangs for ever, and Python with it, if a foreign endpoint comes or goes while its
participant is destroyed: it waits with an overflown deadline and keeps the lock that the other side
needs.
"""

import ctypes
import sys
import time
from collections.abc import Callable

from rclpy.node import Node

__all__ = ['destroy_after_others', 'exit_after']

_FAREWELL_S = 0.5  # longer only a node that stays, or that was killed, is in sight
_CLOCK_MONOTONIC = 1
_SIGEV_THREAD = 2


class _Notification(ctypes.Structure):
    """The ``sigevent`` of Linux: call a function with a value, in a thread of its own."""

    _fields_ = (
        ('value', ctypes.c_ssize_t),
        ('signal_number', ctypes.c_int),
        ('kind', ctypes.c_int),
        ('function', ctypes.c_void_p),
        ('attributes', ctypes.c_void_p),
        ('padding', ctypes.c_byte * 32),
    )


class _Time(ctypes.Structure):
    """The ``itimerspec``: never again, and first after so long."""

    _fields_ = tuple(
        (name, ctypes.c_long)
        for name in ('again_s', 'again_ns', 'first_s', 'first_ns'))


def exit_after(grace_s: float, code: int) -> Callable[[], None]:
    """
    End this process with an exit code, unless it has ended by itself in time.

    No thread of Python gets to run where the middleware hangs, so the C library must do it.

    Parameters
    ----------
    grace_s : float
        How long it may take to end by itself, seconds.
    code : int
        The exit code.

    Returns
    -------
    callable
        Calls that off; for a process that goes on once the middleware has let it go.

    """
    if not sys.platform.startswith('linux'):
        return lambda: None
    library = ctypes.CDLL(None)
    if not hasattr(library, 'timer_create'):  # a C library from before 2021
        library = ctypes.CDLL('librt.so.1')
    timer = ctypes.c_void_p()
    notification = _Notification(
        value=code, kind=_SIGEV_THREAD,
        function=ctypes.cast(ctypes.CDLL(None)._exit, ctypes.c_void_p))
    first = _Time(first_s=int(grace_s), first_ns=int(grace_s % 1.0 * 1e9))
    if library.timer_create(_CLOCK_MONOTONIC, ctypes.byref(notification), ctypes.byref(timer)) == 0:
        library.timer_settime(timer, 0, ctypes.byref(first), None)
        return lambda: library.timer_delete(timer)
    return lambda: None


def destroy_after_others(node: Node) -> None:
    """
    Destroy a node that stands by others, once those of its namespace have left.

    Parameters
    ----------
    node : Node
        The last of its context.

    """
    deadline = time.monotonic() + _FAREWELL_S
    while _sees_others(node) and time.monotonic() < deadline:
        time.sleep(0.01)
    node.destroy_node()


def _sees_others(node: Node) -> bool:
    namespaces = [namespace for _, namespace in node.get_node_names_and_namespaces()]
    return namespaces.count(node.get_namespace()) > 1
