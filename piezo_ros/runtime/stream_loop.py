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

"""The stream loop: serves the running nodes of a process in the direction of flow."""

import os
import threading
import time
from collections.abc import Callable, Sequence

from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.process.stop_request import StopRequest
from piezo_ros.runtime.streams.bursts import NAP_S

__all__ = ['serve_streams']

_HOUSEKEEPING_S = 0.05
_TURNS = 64  # of the nodes that peers wait for, between two looks at all the rest
_TURNS_ALONE = 16  # the same of one such node alone in its process
_LOOKS_ALONE = 64  # in each of these for a message, yielding in between
_NAPS = 4  # turns where blocks are on their way; a node without one sleeps in between
_YIELD_S = 0.02  # how long an empty loop only yields before it sleeps
_SHORT_SLEEP_S = 0.001
_LONGEST_SLEEP_S = 0.01
_SHARE_SLEPT = 0.2  # of the time without input, at once, by nodes that no peer waits for
_SHARE_SLEPT_IN_LOOP = 0.02  # the same by nodes of the loop: a pause gets longer by no more
_FLOW = ('controller', 'compensator', 'plant')


def serve_streams(nodes: Sequence[LoopNode], stop: StopRequest, wake: threading.Event) -> None:
    """
    Serve the streams of some nodes until their runs are over or the process is asked to end.

    Parameters
    ----------
    nodes : sequence of LoopNode
        The nodes, of which some may be running and others begin later.
    stop : StopRequest
        Ends it.
    wake : threading.Event
        Is set when a request of another thread waits while no node is running.

    """
    # In the direction of flow, so that each finds what the one before has just sent.
    urgent = sorted((node for node in nodes if node.urgent), key=_place_in_flow)
    others = [node for node in nodes if not node.urgent]
    # Blocks without feedback are soon used up.
    least_sleep_s = _SHORT_SLEEP_S if all(node.in_bursts for node in others) else NAP_S
    next_housekeeping = idle_since = time.monotonic()
    while not stop.signal_number:
        for node in nodes:
            node.serve_request()
        waited_for = [node for node in urgent if node.running]
        following = [node for node in others if node.running]
        in_blocks = all(node.in_blocks for node in waited_for)
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
            # What has not come for a second may be long in coming: the loop stands still.
            _sleep(_SHARE_SLEPT_IN_LOOP * idle_s, _SHORT_SLEEP_S)
        elif following:
            # A node that was asked for nothing for so long has time; others need the processor.
            _sleep(_SHARE_SLEPT * idle_s, least_sleep_s)
        else:
            wake.wait(_HOUSEKEEPING_S)
            wake.clear()
        if now >= next_housekeeping:
            next_housekeeping = now + _HOUSEKEEPING_S
            for node in nodes:
                try:
                    node.run.housekeeping(now)
                except Exception as error:  # The voltage ends at zero here, too.
                    node.run.break_off(error)
            if _all_over(nodes, now - idle_since):
                return


def _sleep(wanted_s: float, least_s: float) -> None:
    time.sleep(min(max(least_s, wanted_s), _LONGEST_SLEEP_S))


def _nap() -> None:
    time.sleep(NAP_S)


def _turns(
    nodes: Sequence[LoopNode], stop: StopRequest, number: int = 1,
    pause: Callable[[], None] = os.sched_yield, looks: int = 1,
) -> bool:
    """
    Let running nodes do what they can; return whether there was anything.

    Parameters
    ----------
    nodes : sequence of LoopNode
        The nodes to serve, in this order.
    stop : StopRequest
        Ends it.
    number : int
        How many turns each has.
    pause : callable
        What to do between two turns if no node had anything to do.
    looks : int
        How often each looks for its input in one turn. A turn without any is the last then.

    """
    if not nodes:
        return False
    progress = False
    for turn in range(1, number + 1):
        idle = True
        for node in nodes:
            # Nodes end within a turn; and one that shall stop must not see its peers do so first.
            if node.running and not stop.signal_number:
                quick = node.quick  # which is called faster than an attribute
                try:
                    if quick(looks):
                        idle = False
                except Exception as error:  # The run ends in order and the voltage at zero.
                    node.run.break_off(error)
        if not idle:
            progress = True
        elif looks > 1:
            break
        elif turn < number:
            pause()
    return progress


def _place_in_flow(node: LoopNode) -> int:
    return _FLOW.index(node.role) if node.role in _FLOW else len(_FLOW)


def _all_over(nodes: Sequence[LoopNode], idle_s: float) -> bool:
    """Return whether every run is over and has been for as long as the process shall stay."""
    if all(node.is_shut_down for node in nodes):
        return True
    # A manager that has brought a node up by its services also tells it when to go.
    if not all(
        node.starts_itself and node.run_state.is_over and not node.running for node in nodes
    ):
        return False
    if any(node.run_state.has_failed for node in nodes):
        return True
    lingers_s = [node.settings.linger_s for node in nodes]
    return min(lingers_s) >= 0.0 and idle_s >= max(lingers_s)
