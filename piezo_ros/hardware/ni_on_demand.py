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

"""Input and output timed by software, one value at a time: slow loops, and what is held."""

from typing import Any

from piezo_ros.hardware.ni_connection import NiConnection
from piezo_ros.hardware.ni_errors import translated
from piezo_ros.hardware.ni_tasks import NiChannels

__all__ = ['OnDemandTasks']


class OnDemandTasks:
    """
    Tasks without a clock, made when they are needed and kept until `end`.

    None may stand beside those of the clock: the card refuses an output that has both.

    Parameters
    ----------
    connection : NiConnection
        The way to the card.
    channels : NiChannels
        What to drive and to read.
    timeout_s : float
        How long a call waits for the card, seconds.

    """

    def __init__(
        self, connection: NiConnection, channels: NiChannels, timeout_s: float,
    ) -> None:
        self._connection = connection
        self._channels = channels
        self._timeout_s = timeout_s
        self._tasks: dict[str, Any] = {}

    def reading_v(self) -> float:
        """Return one reading of the input, volts."""
        return self._scalar('slow_input', self._channels.input)

    def held_v(self) -> float:
        """Return what the output holds, volts, as the card reads it back."""
        return self._scalar('held', self._channels.held)

    def set_output_v(self, value_v: float) -> None:
        """Set the output, volts."""
        from nidaqmx.stream_writers import AnalogSingleChannelWriter
        with translated(f'{self._connection.name}, {self._channels.output}'):
            task = self._tasks.get('slow_output')
            if task is None:
                task = self._tasks['slow_output'] = self._connection.task('slow_output')
                self._channels.add_output(task)
            AnalogSingleChannelWriter(task.out_stream, auto_start=True).write_one_sample(
                value_v, timeout=self._timeout_s)

    def end(self) -> None:
        """End the tasks; the output holds."""
        tasks, self._tasks = self._tasks, {}
        with translated(self._connection.name):
            for task in tasks.values():
                task.close()

    def _scalar(self, role: str, channel: str) -> float:
        from nidaqmx.stream_readers import AnalogSingleChannelReader
        with translated(f'{self._connection.name}, {channel}'):
            task = self._tasks.get(role)
            if task is None:
                task = self._tasks[role] = self._connection.task(role)
                self._channels.add_input(task, channel)
            return float(AnalogSingleChannelReader(task.in_stream).read_one_sample(
                timeout=self._timeout_s))
