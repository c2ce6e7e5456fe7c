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

"""The process around one or several nodes: signals, executor thread, stream loop, exit code."""

import gc
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from types import FrameType
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.lifecycle import TransitionCallbackReturn

from piezo_ros.runtime.node.handshake import await_acknowledgements
from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.node.rclpy_node.guard import spin_guarded
from piezo_ros.runtime.process.leaving import exit_after
from piezo_ros.runtime.process.middleware import initialise_rclpy
from piezo_ros.runtime.process.parameter_check import check_given_parameters
from piezo_ros.runtime.process.parent import PARENT_VARIABLE
from piezo_ros.runtime.process.ros_distribution import make_events_executor
from piezo_ros.runtime.process.running_time import RunningTime
from piezo_ros.runtime.process.stop_request import StopRequest
from piezo_ros.runtime.stream_loop import serve_streams

__all__ = ['host']

_SHORT_SLEEP_S = 0.001
# How long the readers have for the last messages: one may be delayed, or dead, which becomes
# known of a killed process only after 20 s.
_ACKNOWLEDGE_S = 20.0
_ACKNOWLEDGE_IN_HASTE_S = 4.0
# The launch files give a process 10 s of the wall clock to end after Ctrl-C, however busy it is.
_ACKNOWLEDGE_AFTER_SIGNAL_S = 6.0
_DISCOVER_S = 1.0  # how long a supervisor has to discover a process that it ends so soon
_RAISE_AGAIN_S = 0.2
_CLOSE_S = 1.0  # how long a service that is being answered may take to its end
_LEAVE_S = 4.0  # how long the middleware may take to let the process go


class _StartInterrupted(BaseException):
    """
    The process was asked to end while a node was getting ready.

    No `Exception`, so that code on the way that catches these does not take it for its own.
    """


class _NodeStop(StopRequest):
    """Tells the nodes of the process that it was asked to end, and interrupts their start."""

    def __init__(self) -> None:
        super().__init__()
        self.nodes: list[LoopNode] = []
        self._has_interrupted = False

    def listen(self) -> None:
        """Take the signals, and interrupt once more where an interruption got lost."""
        super().listen()
        signal.signal(signal.SIGALRM, lambda _number, frame: self(self.signal_number, frame))
        sys.unraisablehook = self._tell_unraisable

    def __call__(self, signal_number: int, frame: FrameType | None) -> None:
        super().__call__(signal_number, frame)
        for node in self.nodes:
            node.stop_requested = True
            node.given_up = True
        if any(node.is_starting for node in self.nodes):
            # Once more: raised within a callback of the compiler, it gets lost.
            signal.setitimer(signal.ITIMER_REAL, _RAISE_AGAIN_S)
            self._has_interrupted = True
            raise _StartInterrupted

    def raise_no_more(self) -> None:
        """Take back an alarm under way: Python gives it back its default, which is to kill."""
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, signal.SIG_IGN)

    def _tell_unraisable(self, unraisable: Any) -> None:
        """Tell of what was raised where no code can catch it; a compiler cut off says nothing."""
        if not self._has_interrupted:
            sys.__unraisablehook__(unraisable)


def host(make_nodes: Callable[[], Sequence[LoopNode]]) -> int:
    """
    Run nodes until their runs are over or the process is asked to end.

    Parameters
    ----------
    make_nodes : callable
        Makes the nodes once rclpy is there, in the order of bring-up (readers first).

    Returns
    -------
    int
        Exit code: 0 for a run that ended well or was stopped from outside, 1 for a fault
        and for a run that could not begin.

    """
    stop = _NodeStop()
    stop.listen()
    # Of a client that this process has not discovered yet; it hears nothing and asks again.
    warnings.filterwarnings('ignore', 'failed to send response', RuntimeWarning)
    try:
        initialise_rclpy(sys.argv)
    except (RuntimeError, ValueError) as error:
        # No such parameter file, or arguments or an environment that ROS cannot use.
        print(error, file=sys.stderr)
        return 1
    try:
        return _serve(make_nodes, stop)
    finally:
        # The nodes leave the graph here and now, not in whatever order Python clears its modules.
        stop.nodes = []
        gc.collect()
        rclpy.try_shutdown()


def _serve(make_nodes: Callable[[], Sequence[LoopNode]], stop: _NodeStop) -> int:
    executor = make_events_executor()
    try:
        nodes = list(make_nodes())
        check_given_parameters({node.role: node for node in nodes}, sys.argv)
    except (ParameterException, ValueError, _rclpy.RCLError, NameValidationException) as error:
        # Names the parameter, its value and the range, or the file; or a name that ROS refuses.
        print(error, file=sys.stderr)
        return 1
    stop.nodes = nodes
    wake = threading.Event()
    for node in nodes:
        node.wake = wake.set
    for node in nodes:
        executor.add_node(node)
    closing = threading.Event()

    thread = threading.Thread(
        target=spin_guarded, args=(executor, nodes[0], closing.is_set), name='executor',
        daemon=True)
    thread.start()
    for node in nodes:
        node.transitions.start()
    code = 1
    try:
        started = _run(nodes, stop, wake)
        stop.raise_no_more()
        for node in nodes:
            _end(node, stop)
        failed = not started or any(node.run_state.has_failed for node in nodes)
        _say_farewell(nodes, stop, failed=failed)
        code = 1 if failed else 0
    finally:
        exit_after(_LEAVE_S, code)
        closing.set()
        executor.wake()
        _take_down(nodes, executor, thread)
    return code


def _run(nodes: Sequence[LoopNode], stop: StopRequest, wake: threading.Event) -> bool:
    """Bring the nodes up and serve them to their end; return whether they began or need not."""
    try:
        idle = _bring_up(nodes, stop)
        if idle is not None:
            return bool(stop.signal_number) or idle.was_given_up
        serve_streams(nodes, stop, wake)
    except _StartInterrupted:
        pass
    except BaseException as error:
        with ExitStack() as endings:  # of each node, whatever becomes of that of another
            for node in nodes:
                if node.running:
                    endings.callback(node.run.break_off, error)
        raise
    return True


def _say_farewell(nodes: Sequence[LoopNode], stop: StopRequest, *, failed: bool) -> None:
    """Wait until the readers have the last messages, of which one may be dead or delayed."""
    waited = RunningTime()
    if PARENT_VARIABLE in os.environ:
        for node in nodes:
            node.status.await_reader(lambda: waited.elapsed_s() < _DISCOVER_S)

    for node in nodes:
        await_acknowledgements(
            node.publishers_of_run, lambda: _has_time(waited, stop, failed=failed))


def _has_time(waited: RunningTime, stop: StopRequest, *, failed: bool) -> bool:
    """Return whether the readers may still take what was sent to them."""
    elapsed_s = waited.elapsed_s()
    if not stop.signal_number:
        return elapsed_s < (_ACKNOWLEDGE_IN_HASTE_S if failed else _ACKNOWLEDGE_S)
    return (
        not stop.is_last_call and elapsed_s < _ACKNOWLEDGE_IN_HASTE_S
        and waited.awake_s < _ACKNOWLEDGE_AFTER_SIGNAL_S)


def _end(node: LoopNode, stop: StopRequest) -> None:
    """End the run of a node, if there is one, and say why the process ends."""
    if stop.signal_number:
        why = signal.Signals(stop.signal_number).name
        if not node.running:
            node.get_logger().info(f'ends because of {why}; no run was going on')
    else:
        why = 'another node of this process ended'
    node.given_up = True
    node.stop(why)


def _take_down(nodes: Sequence[LoopNode], executor: Any, thread: threading.Thread) -> None:
    """Let the executor's thread come to its end, and then the nodes."""
    deadline = time.monotonic() + _CLOSE_S
    while thread.is_alive() and time.monotonic() < deadline:
        # A service that came last waits for the stream loop, which is over.
        for node in nodes:
            node.serve_request()
        thread.join(0.01)
    while not all(node.transitions.close() for node in nodes):
        for node in nodes:
            node.serve_request()
        if time.monotonic() > deadline:
            break
    # Before the nodes go: it has callbacks with the middleware on what they own.
    executor.shutdown(_CLOSE_S)
    for node in nodes:
        node.destroy_node()


def _bring_up(nodes: Sequence[LoopNode], stop: StopRequest) -> LoopNode | None:
    """Configure and activate the nodes that start by themselves; return the first that fails."""
    own = [node for node in nodes if node.starts_itself]
    for transition in ('trigger_configure', 'trigger_activate'):
        for node in own:
            if stop.signal_number or not _trigger(node, transition):
                return node
    return None


def _trigger(node: LoopNode, transition: str) -> bool:
    """Lead a node through a transition, which a manager may do at the same time."""
    while not node.transitions.lock.acquire(timeout=_SHORT_SLEEP_S):
        node.serve_request()
    try:
        return bool(getattr(node, transition)() == TransitionCallbackReturn.SUCCESS)
    except _rclpy.RCLError as error:
        # A manager has led the node elsewhere.
        node.get_logger().error(f'{transition}: {error}')
        return False
    finally:
        node.transitions.lock.release()
