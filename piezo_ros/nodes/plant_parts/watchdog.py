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

"""The watchdog of the plant: a voltage that stays away ends the run."""

from piezo_ros.runtime.process.running_time import RunningTime, busy_words
from piezo_ros.runtime.streams.fault import StreamFault
from piezo_ros.runtime.streams.stream_reader import StreamReader

__all__ = ['Watchdog']


class Watchdog:
    """
    Measures how long no voltage has come, of a run that has begun.

    A killed peer leaves discovery only later.

    Parameters
    ----------
    voltage : StreamReader
        The voltage.

    """

    def __init__(self, voltage: StreamReader) -> None:
        self._voltage = voltage
        self._received = -1
        self._silent: RunningTime | None = None  # since the newest voltage

    def check(self, limit_s: float, *, is_waiting: bool) -> None:
        """
        Check that a voltage has come lately.

        Parameters
        ----------
        limit_s : float
            How long it may stay away.
        is_waiting : bool
            Whether one waits that has not been answered yet.

        Raises
        ------
        StreamFault
            If it has stayed away for longer.

        """
        voltage = self._voltage
        if voltage.received != self._received or is_waiting:
            self._received = voltage.received
            if self._received:
                self._silent = RunningTime()
        elif self._silent is not None and self._silent.elapsed_s() > limit_s:
            raise StreamFault(
                f'no voltage for {limit_s:g} s after sample {voltage.next_index - 1} '
                f'(watchdog_s){busy_words()}')
