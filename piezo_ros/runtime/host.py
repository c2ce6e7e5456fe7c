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

"""The process around one or several stages: signals, executor thread, stream loop, exit code."""

import gc
import os
import signal
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Any

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.signals import SignalHandlerOptions

from piezo_ros.runtime.node.stage import Stage
from piezo_ros.runtime.process.distribution import make_events_executor
from piezo_ros.runtime.process.leaving import exit_after
from piezo_ros.runtime.process.middleware import set_middleware_defaults
from piezo_ros.runtime.process.parent import PARENT_VARIABLE
from piezo_ros.runtime.process.running_time import RunningTime
from piezo_ros.runtime.streams.bursts import NAP_S

__all__ = ['host']

_HOUSEKEEPING_S = 0.05
_SPIN_S = 0.5  # between two looks whether the process ends
_TURNS = 64  # of the stages in which others wait, between two looks at all the rest
_TURNS_ALONE = 16  # the same of one such stage alone in its process
_LOOKS_ALONE = 64  # in each of these for a message, yielding in between
_NAPS = 4  # turns where blocks are on their way; a node without one sleeps in between
_YIELD_S = 0.02  # how long an empty loop only yields before it sleeps
_SHORT_SLEEP_S = 0.001
_LONGEST_SLEEP_S = 0.01
_SHARE_SLEPT = 0.2  # of the time without input, at once, by nodes that no peer waits for
# How long the readers have for the last messages: one may be held up, or dead, which becomes
# known of a killed process only after 20 s. A launch file gives a process 5 s to end after Ctrl-C.
_ACKNOWLEDGE_S = 20.0
_ACKNOWLEDGE_IN_HASTE_S = 4.0
_DISCOVER_S = 1.0  # how long a supervisor has to discover a process that it ends so soon
_RAISE_AGAIN_S = 0.2
_CLOSE_S = 1.0  # how long a service that is being answered may take to its end
_LEAVE_S = 4.0  # how long the middleware may take to let the process go
_FLOW = ('controller', 'compensator', 'plant')


class _StartInterrupted(BaseException):
    """
    The process was asked to end while a stage was getting ready.

    No `Exception`, so that code on the way that catches these does not take it for its own.
    """


class _Stop:
    """Remembers that the process was asked to end."""

    def __init__(self) -> None:
        self.signal_number = 0
        self.is_wanted = False  # that no run begins
        self._interrupted = False  # a start has been
        self.wake = threading.Event()
        self.stages: list[Stage] = []

    def __call__(self, signal_number: int, _frame: FrameType | None) -> None:
        self.signal_number = signal_number
        for stage in self.stages:
            stage.stop_requested = True
            stage.give_up_activation()
        if any(stage.starting for stage in self.stages):
            # Once more: raised within a callback of the compiler, it gets lost.
            signal.setitimer(signal.ITIMER_REAL, _RAISE_AGAIN_S)
            self._interrupted = True
            raise _StartInterrupted

    def tell_unraisable(self, unraisable: Any) -> None:
        """Tell of what was raised where no code can catch it; a compiler cut off says nothing."""
        if not self._interrupted:
            sys.__unraisablehook__(unraisable)

    def again(self, _signal_number: int, frame: FrameType | None) -> None:
        """Do as if the signal came once more."""
        self(self.signal_number, frame)


def host(make_stages: Callable[[], Sequence[Stage]]) -> int:
    """
    Run stages until their runs are over or the process is asked to end.

    Parameters
    ----------
    make_stages : callable
        Makes the stages once rclpy is there, in the order of bring-up (readers first).

    Returns
    -------
    int
        Exit code: 0 for a run that ended well or was stopped from outside, 1 for a fault
        and for a run that could not begin.

    """
    stop = _Stop()
    signal.signal(signal.SIGINT, stop)
    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGALRM, stop.again)
    sys.unraisablehook = stop.tell_unraisable
    set_middleware_defaults()
    # Of a client that this process has not discovered yet; it hears nothing and asks again.
    warnings.filterwarnings('ignore', 'failed to send response', RuntimeWarning)
    try:
        rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        # No such parameter file, or arguments that ROS does not understand.
        print(error, file=sys.stderr)
        return 1
    try:
        return _serve(make_stages, stop)
    finally:
        # The nodes leave the graph here and now, not in whatever order Python clears its modules.
        stop.stages = []
        gc.collect()
        rclpy.try_shutdown()


def _serve(make_stages: Callable[[], Sequence[Stage]], stop: _Stop) -> int:
    executor = make_events_executor()
    try:
        stages = list(make_stages())
    except (ParameterException, ValueError) as error:
        # Names the parameter, its value and the range, or the file.
        print(error, file=sys.stderr)
        return 1
    stop.stages = stages
    for stage in stages:
        stage.wake = stop.wake.set
    for stage in stages:
        executor.add_node(stage)
    closing = threading.Event()

    def serve_services() -> None:
        while not closing.is_set():
            try:
                executor.spin_once(_SPIN_S)
            except Exception:  # Whatever rclpy raises, the services go on.
                stages[0].get_logger().error(traceback.format_exc(), throttle_duration_sec=10.0)
                closing.wait(_HOUSEKEEPING_S)

    thread = threading.Thread(target=serve_services, name='executor', daemon=True)
    thread.start()
    for stage in stages:
        stage.transitions.start()
    code = 1
    try:
        started = _run(stages, stop)
        for stage in stages:
            _end(stage, stop)
        failed = not started or any(stage.failed for stage in stages)
        _say_farewell(stages, stop, failed=failed)
        code = 1 if failed else 0
    finally:
        exit_after(_LEAVE_S, code)
        closing.set()
        executor.wake()
        _take_down(stages, executor, thread)
    return code


def _run(stages: Sequence[Stage], stop: _Stop) -> bool:
    """Bring the stages up and serve them to their end; return whether they began or need not."""
    try:
        if not _bring_up(stages, stop):
            return stop.is_wanted
        _stream_loop(stages, stop)
    except _StartInterrupted:
        pass
    return True


def _say_farewell(stages: Sequence[Stage], stop: _Stop, *, failed: bool) -> None:
    """Wait until the readers have the last messages, of which one may be dead or held up."""
    waited = RunningTime()
    if PARENT_VARIABLE in os.environ:
        for stage in stages:
            stage.await_supervisor(lambda: waited.elapsed_s() < _DISCOVER_S)

    def has_time() -> bool:
        in_haste = failed or stop.signal_number
        return waited.elapsed_s() < (_ACKNOWLEDGE_IN_HASTE_S if in_haste else _ACKNOWLEDGE_S)

    for stage in stages:
        stage.await_acknowledgements(has_time)


def _end(stage: Stage, stop: _Stop) -> None:
    """End the run of a stage, if there is one, and say why the process ends."""
    if stop.signal_number:
        why = signal.Signals(stop.signal_number).name
        if not stage.running:
            stage.get_logger().info(f'ends because of {why}; no run was going on')
    else:
        why = 'another stage of this process ended'
    stage.give_up_activation()
    stage.stop(why)


def _take_down(stages: Sequence[Stage], executor: Any, thread: threading.Thread) -> None:
    """Let the executor's thread come to its end, and then the nodes."""
    deadline = time.monotonic() + _CLOSE_S
    while thread.is_alive() and time.monotonic() < deadline:
        # A service that came last waits for the stream loop, which is over.
        for stage in stages:
            stage.serve_request()
        thread.join(0.01)
    while not all(stage.transitions.close() for stage in stages):
        for stage in stages:
            stage.serve_request()
        if time.monotonic() > deadline:
            break
    # Before the nodes go: it has callbacks with the middleware on what they own.
    executor.shutdown(_CLOSE_S)
    for stage in stages:
        stage.destroy_node()


def _bring_up(stages: Sequence[Stage], stop: _Stop) -> bool:
    """Configure and activate the stages that start by themselves."""
    own = [stage for stage in stages if stage.starts_itself]
    for transition in ('trigger_configure', 'trigger_activate'):
        for stage in own:
            if stop.signal_number or not _trigger(stage, transition):
                stop.is_wanted = bool(stop.signal_number) or stage.was_given_up
                return False
    return True


def _trigger(stage: Stage, transition: str) -> bool:
    """Lead a stage through a transition, which a manager may do at the same time."""
    while not stage.transitions.lock.acquire(timeout=_SHORT_SLEEP_S):
        stage.serve_request()
    try:
        return bool(getattr(stage, transition)() == TransitionCallbackReturn.SUCCESS)
    except _rclpy.RCLError as error:
        # A manager has led the stage elsewhere.
        stage.get_logger().error(f'{transition}: {error}')
        return False
    finally:
        stage.transitions.lock.release()


def _stream_loop(stages: Sequence[Stage], stop: _Stop) -> None:
    # In the direction of flow, so that each finds what the one before has just sent.
    urgent = sorted((stage for stage in stages if stage.urgent), key=_place_in_flow)
    others = [stage for stage in stages if not stage.urgent]
    # Blocks without feedback are soon used up.
    least_sleep_s = _SHORT_SLEEP_S if all(stage.in_bursts for stage in others) else NAP_S
    next_housekeeping = idle_since = time.monotonic()
    while not stop.signal_number:
        for stage in stages:
            stage.serve_request()
        waited_for = [stage for stage in urgent if stage.running]
        following = [stage for stage in others if stage.running]
        in_blocks = all(stage.in_blocks for stage in waited_for)
        if in_blocks:
            # The naps between the turns would keep the others waiting.
            progress = _turns(waited_for, stop, 1 if following else _NAPS, _nap)
        elif len(waited_for) == 1:
            progress = _turns(waited_for, stop, _TURNS_ALONE, looks=_LOOKS_ALONE)
        else:
            progress = _turns(waited_for, stop, _TURNS)
        progress = _turns(following, stop) or progress
        now = time.monotonic()
        idle_s = now - idle_since
        if progress:
            idle_since = now
        elif waited_for and idle_s < _YIELD_S:
            if in_blocks:
                _nap()
        elif waited_for:
            time.sleep(_SHORT_SLEEP_S)
        elif following:
            # A node that was asked for nothing for so long has time; others need the processor.
            time.sleep(min(max(least_sleep_s, _SHARE_SLEPT * idle_s), _LONGEST_SLEEP_S))
        else:
            stop.wake.wait(_HOUSEKEEPING_S)
            stop.wake.clear()
        if now >= next_housekeeping:
            next_housekeeping = now + _HOUSEKEEPING_S
            for stage in stages:
                stage.housekeeping(now)
            if _all_over(stages, now - idle_since):
                return


def _nap() -> None:
    time.sleep(NAP_S)


def _turns(
    stages: Sequence[Stage], stop: _Stop, number: int = 1,
    pause: Callable[[], None] = os.sched_yield, looks: int = 1,
) -> bool:
    """
    Let running stages do what they can; return whether there was anything.

    Parameters
    ----------
    stages : sequence of Stage
        The nodes to serve, in this order.
    stop : _Stop
        Ends it.
    number : int
        How many turns each has.
    pause : callable
        What to do between two turns if no node had anything to do.
    looks : int
        How often each looks for its input in one turn. A turn without any is the last then.

    """
    if not stages:
        return False
    progress = False
    for turn in range(1, number + 1):
        idle = True
        for stage in stages:
            # Stages end within a turn; and one that shall stop must not see its peers do so first.
            if stage.running and not stop.signal_number:
                quick = stage.quick  # which is called faster than an attribute
                try:
                    if quick(looks):
                        idle = False
                except Exception as error:  # The run ends in order and the voltage at zero.
                    stage.break_off(error)
        if not idle:
            progress = True
        elif looks > 1:
            break
        elif turn < number:
            pause()
    return progress


def _place_in_flow(stage: Stage) -> int:
    return _FLOW.index(stage.role) if stage.role in _FLOW else len(_FLOW)


def _all_over(stages: Sequence[Stage], idle_s: float) -> bool:
    """Return whether every run is over and has been for as long as the process shall stay."""
    if all(stage.shut_down for stage in stages):
        return True
    # A manager that has brought a node up by its services also tells it when to go.
    if not all(stage.starts_itself and stage.over and not stage.running for stage in stages):
        return False
    if any(stage.failed for stage in stages):
        return True
    lingers_s = [stage.settings.linger_s for stage in stages]
    return min(lingers_s) >= 0.0 and idle_s >= max(lingers_s)
