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

"""A stream of a device: how much of it is written, gone out and fetched."""

import numpy as np
from numpy.typing import NDArray

from piezo_ros.hardware.device import Device
from piezo_ros.nodes.hardware_parts.reading_check import checked_readings
from piezo_ros.runtime.streams.sample_queue import SampleQueue

__all__ = ['DeviceStream']

_CATCH_UP = 4  # times as many readings at once where they have piled up


class DeviceStream:
    """
    Writes as much as the buffer of a device takes, and fetches readings in time.

    Parameters
    ----------
    device : Device
        The device, open.
    room : int
        Most voltages that wait on it.
    at_once : int
        Most readings that are fetched at once.

    Attributes
    ----------
    fetched : int
        Number of readings that were fetched.
    held_v : float
        The voltage that the newest of them answers.

    """

    def __init__(self, device: Device, room: int, at_once: int) -> None:
        self.fetched = 0
        self.held_v = 0.0
        self._device = device
        self._room = room
        # Room for the next voltages must come before the buffer has run dry.
        self._at_once = min(at_once, max(1, room // 2))
        self._unanswered = SampleQueue()
        self._written = 0
        self._is_complete = False
        self._generated = 0  # when that was asked last
        self._generated_seen = -1

    @property
    def is_over(self) -> bool:
        """Whether the last reading of the stream was fetched."""
        return self._is_complete and self.fetched == self._written + 1

    def start(self, waiting: SampleQueue, count: int) -> None:
        """Start with so many of the voltages that wait."""
        voltage_v = waiting.pull(min(count, self._room))
        self._device.start(voltage_v)
        self._note(voltage_v)

    def finish(self) -> None:
        """Take note that the last voltage is on the device."""
        if not self._is_complete:
            self._device.finish()
            self._is_complete = True

    def write(self, waiting: SampleQueue) -> bool:
        """Write as many of the voltages that wait as there is room for; return whether any."""
        if not waiting:
            return False
        self._generated = self._device.generated()
        room = self._room - (self._written - self._generated)
        if room <= 0:
            return False
        voltage_v = waiting.pull(room)
        self._device.write(voltage_v)
        self._note(voltage_v)
        return True

    def _note(self, voltage_v: NDArray[np.float64]) -> None:
        self._written += voltage_v.size
        self._unanswered.extend(voltage_v)

    def fetch(self) -> NDArray[np.float64] | None:
        """
        Return the next readings, shape (N,), or None as long as it is better to wait.

        Better as long as the next voltages are still to come and the output has some to go on with:
        a device without a clock of its own would run dry by being read.
        """
        left = self._written + 1 - self.fetched
        if not self._is_complete and left <= self._at_once:
            if self._device.generated() < self._written:
                return None
            left += 1  # It has run dry, and says at which index.
        # Readings that have piled up delay the demand for voltages: they are fetched sooner.
        behind = min(self._generated - self.fetched, _CATCH_UP * self._at_once)
        count = min(left, max(self._at_once, behind))
        readings_um = checked_readings(self._device.read(count), self.fetched, count)
        answered_v = self._unanswered.pull(count if self.fetched else count - 1)
        if answered_v.size:
            self.held_v = float(answered_v[-1])
        self.fetched += count
        return readings_um

    def is_making_progress(self) -> bool:
        """Return whether voltages went out since this was asked last."""
        if self.is_over:
            return False
        seen, self._generated_seen = self._generated_seen, self._device.generated()
        return seen != self._generated_seen
