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

"""A timer on the steady clock that any thread may start, stop or let run at once."""

import traceback
from collections.abc import Callable
from typing import TYPE_CHECKING

from rclpy.clock import Clock, ClockType

if TYPE_CHECKING:
    from rclpy.node import Node

__all__ = ['SteadyTimer']


class SteadyTimer:
    """
    A timer of the executor, off until its rate is looked up.

    Its callback runs beside the stream loop, so that it goes on while that one waits. Everything
    here happens in the executor: a timer that another thread changes while it expires may stay off.

    Parameters
    ----------
    node : Node
        The node of the timer.
    callback : callable
        What to call.
    rate_hz : callable
        Returns how often, 0 for never; asked by `update`.

    """

    def __init__(
        self, node: 'Node', callback: Callable[[], None], rate_hz: Callable[[], float],
    ) -> None:
        self._node = node
        self._callback = callback
        self._rate_hz = rate_hz
        self._applied_hz = 0.0
        self._timer = node.create_timer(
            1.0, self._call, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._timer.cancel()

    def update(self) -> None:
        """Take over the rate, soon."""
        self._in_executor(self._apply)

    def call(self) -> None:
        """Call it once, soon."""
        self._in_executor(self._call)

    def _in_executor(self, action: Callable[[], None]) -> None:
        executor = self._node.executor
        if executor is None:
            action()
        else:
            executor.create_task(action)

    def _apply(self) -> None:
        rate_hz = self._rate_hz()
        if rate_hz == self._applied_hz:
            return
        self._applied_hz = rate_hz
        self._timer.cancel()
        if rate_hz > 0.0:
            self._timer.timer_period_ns = round(1e9 / rate_hz)
            self._timer.reset()

    def _call(self) -> None:
        try:
            self._callback()
        except Exception:  # The executor would end for it, and every service with it.
            self._node.get_logger().error(traceback.format_exc(), throttle_duration_sec=10.0)
