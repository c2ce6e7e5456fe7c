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

"""The simulated time of a run on the topic ``clock``, for nodes with use_sim_time."""

from rosgraph_msgs.msg import Clock

from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.process.steady_timer import SteadyTimer
from piezo_ros.runtime.streams.qos import CLOCK
from piezo_ros.runtime.streams.stream_writer import StreamWriter

__all__ = ['SimulatedClock']

_RATE_HZ = 100.0


class SimulatedClock:
    """
    Publishes k·Ts, a hundred times a second of the wall clock as long as it moves.

    Parameters
    ----------
    node : LoopNode
        The node with this time.
    readings : StreamWriter
        The readings, of which the newest has the present sample k.

    """

    def __init__(self, node: LoopNode, readings: StreamWriter) -> None:
        self._readings = readings
        self._period_s = 0.0
        self._shown = -1
        self._publisher = node.create_own_publisher(Clock, 'clock', CLOCK)
        self._runs = False
        self._timer = SteadyTimer(node, self.show, lambda: _RATE_HZ if self._runs else 0.0)

    def start(self, sample_period_s: float) -> None:
        """Begin a run, from its first sample on."""
        self._period_s = sample_period_s
        self._shown = -1
        self._runs = True
        self._timer.update()

    def stop(self) -> None:
        """Show the last sample and stand still."""
        self._runs = False
        self._timer.update()
        self._timer.call()

    def show(self) -> None:
        """Publish the present time, unless it is the same as before."""
        index = self._readings.newest_index
        if index != self._shown:
            self._shown = index
            seconds, nanoseconds = divmod(round(index * self._period_s * 1e9), 10**9)
            message = Clock()
            message.clock.sec, message.clock.nanosec = seconds, nanoseconds
            self._publisher.publish(message)
