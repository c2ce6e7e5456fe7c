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

"""What a node shows of itself beside its streams: monitor topics and diagnostics."""

import math
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.publisher import Publisher
from std_msgs.msg import Float64, Float64MultiArray

from piezo_ros.runtime.node.hooks import NodeHooks
from piezo_ros.runtime.process.steady_timer import SteadyTimer
from piezo_ros.runtime.streams.qos import DIAGNOSTICS, NEWEST

__all__ = ['Diagnostics', 'Monitor', 'newest_topic']

_DIAGNOSTICS_S = 1.0
_EARLY_S = 0.1  # that the timer may be
_REPEAT_S = 1.0  # a sample that stays the newest: best effort loses some, and some come late


def newest_topic(stream: str) -> str:
    """Return the topic of the newest sample of a stream with its index."""
    return f'newest/{stream}'


class Monitor:
    """
    The newest sample of each output on ``monitor/<stream>``, for tools that plot or echo.

    On ``newest/<stream>`` it is a block of one sample, for programs that want its index too. Best
    effort and at a rate of the wall clock: looking never slows a run. While there is no reader, it
    looks for one once a second.

    Parameters
    ----------
    node : NodeHooks
        The node with the outputs to show.

    """

    def __init__(self, node: NodeHooks) -> None:
        self._node = node
        self._publishers: dict[str, tuple[Publisher, Publisher]] = {}
        self._has_readers = False
        self._shown: dict[str, tuple[int, float]] = {}  # samples sent by then, and when
        self._timer = SteadyTimer(node, self.show, self._present_hz)
        self._rate_hz = 0.0
        self._most_hz = 0.0  # what the moment allows

    def create_endpoints(self) -> None:
        """Create the publishers of each output; they go when the node is cleaned up."""
        create = self._node.create_own_publisher
        self._publishers = {
            stream: (
                create(Float64, f'monitor/{stream}', NEWEST),
                create(Float64MultiArray, newest_topic(stream), NEWEST))
            for stream in self._node.writers}

    def start(self) -> None:
        """Show what a run sends from now on."""
        self._shown.clear()
        self._allow(math.inf)
        self._timer.call()

    def rest(self) -> None:
        """Show the end of a run, and from now on only repeat it."""
        if self._rate_hz:
            self._timer.call()
        self._allow(min(self._most_hz, 1.0 / _REPEAT_S))

    def stop(self) -> None:
        """Show nothing from now on."""
        self._allow(0.0)

    def use_rate(self, rate_hz: float) -> None:
        """Show so often while a run goes on; 0 for never."""
        self._rate_hz = rate_hz
        self._timer.update()

    def _allow(self, most_hz: float) -> None:
        self._most_hz = most_hz
        self._timer.update()

    def _present_hz(self) -> float:
        most_hz = self._most_hz if self._has_readers else min(self._most_hz, 1.0 / _REPEAT_S)
        return min(self._rate_hz, most_hz)

    def show(self) -> None:
        """Publish what has come since the last time, and now and then what is still the newest."""
        now_s = time.monotonic()
        had_readers, self._has_readers = self._has_readers, False
        for stream, (number, block) in self._publishers.items():
            writer = self._node.writers.get(stream)
            if writer is None:
                continue
            readers, block_readers = (
                number.get_subscription_count(), block.get_subscription_count())
            if not (readers or block_readers):
                continue
            self._has_readers = True
            sent, at_s = self._shown.get(stream, (0, now_s))
            if writer.sent and (writer.sent != sent or now_s - at_s >= _REPEAT_S - _EARLY_S):
                self._shown[stream] = writer.sent, now_s
                number.publish(Float64(data=writer.newest))
                if block_readers:
                    # One copy, so that index and sample belong together while the loop goes on.
                    block.publish(bytes(writer.message))
        if self._has_readers != had_readers:
            self._timer.update()


class Diagnostics:
    """
    The health of a node on ``/diagnostics``, once a second.

    Parameters
    ----------
    node : NodeHooks
        The node to report on.

    """

    def __init__(self, node: NodeHooks) -> None:
        self._node = node
        self._name = node.get_fully_qualified_name()
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', DIAGNOSTICS)
        self._before: dict[str, int] = {}
        self._at_s = time.monotonic()
        SteadyTimer(node, self.show, lambda: 1.0 / _DIAGNOSTICS_S).update()

    def show(self) -> None:
        """Publish the present health."""
        node, state = self._node, self._node.run_state
        counts = node.counts()
        now_s = time.monotonic()
        before, self._before = self._before, counts
        elapsed_s, self._at_s = now_s - self._at_s, now_s
        new = {name: count - before.get(name, 0) for name, count in counts.items()}
        values = {
            'state': state.activity, 'run': state.number,
            'rate_hz': round(max(new['samples'], 0) / elapsed_s, 1), **counts}
        troubles = [
            f'{name.replace("_", " ")}: {counts[name]}' for name in node.troubles
            if new.get(name, 0) > 0]
        waiting = [
            f'waiting for a reader of {writer.publisher.topic_name}'
            for writer in node.writers.values() if writer.is_waiting]
        level, message = DiagnosticStatus.OK, state.activity
        if state.has_failed:
            level, message = DiagnosticStatus.ERROR, f'{state.activity}: {state.reason}'
        elif troubles or waiting:
            level, message = DiagnosticStatus.WARN, '; '.join([*waiting, *troubles])
        array = DiagnosticArray(status=[DiagnosticStatus(
            level=level, name=self._name, message=message, hardware_id=node.get_namespace(),
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()])])
        array.header.stamp = node.get_clock().now().to_msg()
        self._publisher.publish(array)
