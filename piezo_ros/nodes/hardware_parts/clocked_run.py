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
A run that the clock of a device plays.

The voltages are collected first: the whole run where the device takes it, so that it cannot run
dry, else as many as shall wait at the start; the rest is written while it plays. The ramp to rest
and a hold there are part of what is played, so that the output never stops at the last voltage.

The device answers u[0] … u[n-1] with y[0] … y[n]. y[0] was sent before, as the opening reading.
"""

import numpy as np
from numpy.typing import NDArray

from piezo_ros.nodes.hardware_parts.device_stream import DeviceStream
from piezo_ros.nodes.hardware_parts.reading_check import checked_readings
from piezo_ros.nodes.hardware_parts.stage_output import StageOutput
from piezo_ros.parameters.hardware_parameters import HardwareParameters
from piezo_ros.runtime.streams.fault import StreamFault
from piezo_ros.runtime.streams.sample_queue import SampleQueue

__all__ = ['ClockedRun']


class ClockedRun:
    """
    Takes voltages, plays them, and hands out the readings.

    Parameters
    ----------
    output : StageOutput
        The output, at rest.
    hardware : HardwareParameters
        How much to prefill and to fetch.
    sample_period_s : float
        Sample period, seconds.
    opening_um : float
        The reading that opened the run.

    Attributes
    ----------
    is_over : bool
        Whether everything has been played and the output is at rest.
    mode : str
        How it is played, in words, '' before it is.
    opening_difference_um : float or None
        First reading of the clocked run less the one that opened it, None before it plays.

    """

    overruns = 0

    def __init__(
        self, output: StageOutput, hardware: HardwareParameters, sample_period_s: float,
        opening_um: float,
    ) -> None:
        self.is_over = False
        self.mode = ''
        self.opening_difference_um: float | None = None
        self._output = output
        self._opening_um = opening_um
        constraints = output.opened.constraints
        room = constraints.buffer_samples or hardware.buffer_samples
        self._most_of_block = constraints.most_samples
        self._stream = DeviceStream(
            output.opened, room, hardware.samples_at_once(sample_period_s)
        ) if constraints.streams else None
        self._goal = min(hardware.prefill_samples or room, room)
        self._waiting = SampleQueue()  # voltages that are not on the device yet
        self._accepted = 0
        self._last_v = 0.0  # of them
        self._run_samples: int | None = None  # once the end has come

    @property
    def why_waiting(self) -> str:
        """What keeps the voltages that have come from being played, '' where nothing does."""
        if self.mode or self._run_samples is not None:
            return ''
        return (
            f'; {len(self._waiting)} voltages wait for the rest of the run or for prefill_samples: '
            'lookahead_samples of the controller must be larger than what shall wait, and no '
            'controller with feedback may wait for a reading')

    def accept(self, voltage_v: NDArray[np.float64]) -> None:
        """
        Take the next voltages.

        Raises
        ------
        Refused
            If one is beyond a limit; the text names sample, value and range.

        """
        self._output.limits.check(voltage_v)
        self._accepted += voltage_v.size
        self._last_v = float(voltage_v[-1])
        self._waiting.extend(voltage_v)

    def end(self) -> None:
        """Take note that no voltage is to come, and append the way to rest."""
        self._run_samples = self._accepted
        if self._accepted:
            self._waiting.extend(self._output.way_to_rest(self._last_v))

    def is_making_progress(self) -> bool:
        """Return whether voltages went out since this was asked last."""
        return bool(self.mode and self._stream and self._stream.is_making_progress())

    def advance(self) -> NDArray[np.float64] | None:
        """
        Do what can be done now.

        Returns
        -------
        ndarray of float64, shape (N,), or None
            Readings that follow those before, possibly none; None where nothing could be done.

        Raises
        ------
        DeviceError
            If the device fails; Underflow names the index.
        StreamFault
            If a device that does not stream is given more than one block of it.

        """
        if self._run_samples == 0:
            self.is_over = True
            return np.empty(0)
        if self._stream is None:
            return self._play_block()
        progress = bool(self.mode) and self._stream.write(self._waiting)
        if not self.mode and not self._start(self._stream):
            return None
        if self._run_samples is not None and not self._waiting:
            self._stream.finish()
        first = self._stream.fetched
        readings_um = self._stream.fetch()
        if readings_um is None:
            return np.empty(0) if progress else None
        self._output.held_v = self._stream.held_v
        self.is_over = self._stream.is_over
        return self._answers(readings_um, first)

    def _start(self, stream: DeviceStream) -> bool:
        """Start as soon as enough voltages wait; return whether that is so."""
        has_ended = self._run_samples is not None
        if not has_ended and len(self._waiting) < self._goal:
            return False
        stream.start(self._waiting, len(self._waiting) if has_ended else self._goal)
        self.mode = 'whole run prefilled' if has_ended and not self._waiting else 'streamed'
        return True

    def _play_block(self) -> NDArray[np.float64] | None:
        """Play the whole run at once, on a device that does not stream; return its readings."""
        most, count = self._most_of_block, len(self._waiting)
        if most is not None and count > most:
            raise StreamFault(
                f'{self._output.identity} does not stream and plays 1 … {most} samples; the run '
                f'has {self._accepted} so far, and its ramp to rest follows')
        if self._run_samples is None:
            return None
        self.mode = 'one block'
        readings_um = checked_readings(
            self._output.opened.play(self._waiting.pull(count)), 0, count + 1)
        self._output.held_v = 0.0
        self.is_over = True
        return self._answers(readings_um, 0)

    def _answers(self, readings_um: NDArray[np.float64], first: int) -> NDArray[np.float64]:
        """Return the readings that answer the run: not the first of all, not the way to rest."""
        if self._run_samples is not None:
            readings_um = readings_um[:max(self._run_samples + 1 - first, 0)]
        if first == 0 and readings_um.size:
            self.opening_difference_um = float(readings_um[0]) - self._opening_um
            return readings_um[1:]
        return readings_um
