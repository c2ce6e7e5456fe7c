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
An input task and an output task on one clock, that of the input.

At tick k of ``ai/SampleClock`` the input converts, then the output goes to u[k]. So the reading of
tick 0 is y[0], that of tick k+1 answers u[k], and N voltages need N+1 ticks. Without the clock of
the input the output does not move.
"""

from collections import deque
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.hardware.device import DeviceError, Overflow, Underflow, refuse_other_rate
from piezo_ros.hardware.ni_connection import NiConnection
from piezo_ros.hardware.ni_errors import NO_ROOM, NOT_YET, code_of, is_underflow, translated

__all__ = ['ClockedTasks', 'NiChannels']

_PIECE: Final = 50_000  # samples of one call: a message of gRPC is 4 MiB at most
_LEAST_FINITE: Final = 2  # samples of a finite task


@dataclass(frozen=True)
class NiChannels:
    """One output, one input, and their ranges in volts."""

    output: str
    input: str
    held: str  # reads the output back
    lowest_v: float
    highest_v: float
    input_range_v: float
    terminals: str

    @property
    def card(self) -> str:
        """Name of the card."""
        return self.output.split('/')[0]

    def add_output(self, task: Any) -> None:
        """Add the output to a task."""
        task.ao_channels.add_ao_voltage_chan(
            self.output, min_val=self.lowest_v, max_val=self.highest_v)

    def add_input(self, task: Any, channel: str) -> None:
        """Add the input, or what reads the output back, to a task."""
        from nidaqmx.constants import TerminalConfiguration
        terminals = {
            'default': TerminalConfiguration.DEFAULT, 'differential': TerminalConfiguration.DIFF,
            'rse': TerminalConfiguration.RSE, 'nrse': TerminalConfiguration.NRSE}
        task.ai_channels.add_ai_voltage_chan(
            channel, min_val=-self.input_range_v, max_val=self.input_range_v,
            terminal_config=terminals[self.terminals if channel == self.input else 'default'])


class ClockedTasks:
    """
    Input and output, ready for their first voltages; of `samples`, or of any number.

    Parameters
    ----------
    connection : NiConnection
        The way to the card.
    channels : NiChannels
        What to drive and to read.
    sample_period_s : float
        Sample period, seconds.
    timeout_s : float
        How long a call waits for the card, seconds.
    samples : int or None
        Voltages of a finite block, None for a stream.
    buffer_samples : int
        Buffers of a stream.

    """

    def __init__(
        self, connection: NiConnection, channels: NiChannels, sample_period_s: float,
        timeout_s: float, *, samples: int | None, buffer_samples: int = 0,
    ) -> None:
        from nidaqmx.constants import AcquisitionType, RegenerationMode
        from nidaqmx.stream_readers import AnalogSingleChannelReader
        from nidaqmx.stream_writers import AnalogSingleChannelWriter
        self.name = f'{connection.name}, {channels.output} and {channels.input}'
        self.written = 0
        self._fetched = 0
        self._ready_v = np.empty(0)
        # Index of the first and voltages, of what was written and may still be at the output.
        self._sent: deque[tuple[int, NDArray[np.float64]]] = deque()
        self._fault: Underflow | None = None
        # A slow clock takes its time for the first reading.
        self._timeout_s = timeout_s + 2.0 * sample_period_s
        self._rate_hz = 1.0 / sample_period_s
        self._is_finite = samples is not None
        self._tasks: list[Any] = []
        mode = AcquisitionType.FINITE if self._is_finite else AcquisitionType.CONTINUOUS
        ticks = samples + 1 if samples is not None else buffer_samples
        outputs = max(samples, _LEAST_FINITE) if samples is not None else buffer_samples
        self._padding = outputs - samples if samples is not None else 0
        try:
            with translated(self.name):
                self._input = self._made(connection, 'input')
                channels.add_input(self._input, channels.input)
                self._input.timing.cfg_samp_clk_timing(
                    self._rate_hz, sample_mode=mode, samps_per_chan=max(ticks, _LEAST_FINITE))
                refuse_other_rate(
                    self.name, sample_period_s, float(self._input.timing.samp_clk_rate))
                self._output = self._made(connection, 'output')
                channels.add_output(self._output)
                self._output.timing.cfg_samp_clk_timing(
                    self._rate_hz, source=f'/{channels.card}/ai/SampleClock', sample_mode=mode,
                    samps_per_chan=outputs)
                self._output.out_stream.regen_mode = RegenerationMode.DONT_ALLOW_REGENERATION
                self._output.out_stream.output_buf_size = outputs
                self._input.in_stream.input_buf_size = max(ticks, _LEAST_FINITE)
        except BaseException:
            self.close()
            raise
        self._writer = AnalogSingleChannelWriter(self._output.out_stream, auto_start=False)
        self._reader = AnalogSingleChannelReader(self._input.in_stream)
        # One channel each, as made above: to ask the card for it takes a call.
        self._writer.verify_array_shape = self._reader.verify_array_shape = False

    def write(self, output_v: NDArray[np.float64]) -> None:
        """Write voltages at the connector, shape (N,); wait for room."""
        # A finite output of one sample is made of two equal ones.
        padded_v = np.concatenate([output_v, np.full(self._padding, output_v[-1])])
        for first in range(0, padded_v.size, _PIECE):
            self._write_piece(padded_v[first:first + _PIECE])
        self.written -= self._padding

    def start(self) -> None:
        """Start: the output first, which waits for the clock of the input."""
        with translated(self.name):
            self._output.start()
            self._input.start()

    def read(self, samples: int) -> NDArray[np.float64]:
        """
        Return the next readings, shape (N,), volts, and look after the output.

        Raises
        ------
        Underflow
            If the output had stopped before the last of them; those before can be read still.

        """
        while self._ready_v.size < samples and self._fault is None:
            self._fetch(samples - self._ready_v.size)
        if self._fault is not None and self._ready_v.size < samples:
            raise self._fault
        readings_v, self._ready_v = np.split(self._ready_v, [samples])
        return readings_v

    def generated(self) -> int:
        """Return how many voltages have gone out."""
        with translated(self.name):
            count = int(self._output.out_stream.total_samp_per_chan_generated)
        while self._sent and self._sent[0][0] + self._sent[0][1].size < count:
            self._sent.popleft()
        return min(count, self.written)

    def newest_output_v(self) -> float | None:
        """Return the voltage that has gone out last, None before the first."""
        count = self.generated()
        if not count:
            return None
        first, block_v = self._sent[0]
        return float(block_v[count - 1 - first])

    def wait(self) -> None:
        """Wait until a finite output is done, and check that each of its samples went out."""
        with translated(self.name, self.written):
            if not self._padding:
                self._output.wait_until_done(self._timeout_s)
        count = self.generated()
        if count != self.written:
            raise Underflow(
                f'{self.name}: {count} of {self.written} voltages went out', count)

    def stop(self) -> None:
        """Stop the clock, and with it the output, which holds."""
        with translated(self.name):
            self._input.stop()

    def close(self) -> None:
        """Stop and release; the output holds. The input goes first, and with it the clock."""
        import nidaqmx
        first: Exception | None = None
        for task in self._tasks:
            try:
                task.close()
            except nidaqmx.errors.Error as error:
                first = first or error
        self._tasks = []
        # After a fault the card may not even take this; what matters was told before.
        if first is not None and code_of(first) is None:
            with translated(self.name):
                raise first

    def _made(self, connection: NiConnection, role: str) -> Any:
        task = connection.task(role)
        self._tasks.append(task)
        return task

    def _write_piece(self, piece_v: NDArray[np.float64]) -> None:
        import nidaqmx
        while piece_v.size:
            try:
                taken = int(self._writer.write_many_sample(
                    np.ascontiguousarray(piece_v), timeout=self._timeout_s))
            except nidaqmx.errors.DaqError as error:
                taken = int(getattr(error, 'samps_per_chan_written', 0) or 0)
                if code_of(error) != NO_ROOM:
                    count = self.generated() if is_underflow(error) else 0
                    with translated(self.name, count):
                        raise
                if not taken:
                    raise Overflow(
                        f'{self.name}: no room for voltages within {self._timeout_s:g} s; fetch '
                        'readings, or write fewer at once') from error
            except nidaqmx.errors.Error:
                with translated(self.name):
                    raise
            self._sent.append((self.written, piece_v[:taken]))
            self.written += taken
            piece_v = piece_v[taken:]

    def _fetch(self, samples: int) -> None:
        """Fetch some readings, or what there is of them when time is over."""
        import nidaqmx
        piece_v = np.empty(min(_PIECE, samples))
        try:
            got = int(self._reader.read_many_sample(
                piece_v, number_of_samples_per_channel=piece_v.size, timeout=self._timeout_s))
        except nidaqmx.errors.Error as error:
            if code_of(error) != NOT_YET:
                with translated(self.name):
                    raise
            # What came in time is whole samples of the one channel.
            got = int(getattr(error, 'samps_per_chan_read', 0) or 0)
            if not got:
                raise DeviceError(
                    f'{self.name}: no reading within {self._timeout_s:g} s; its clock stands '
                    'still') from error
        self._fetched += got
        invalid = self._invalid_readings()
        self._ready_v = np.concatenate([self._ready_v, piece_v[:max(0, got - invalid)]])

    def _invalid_readings(self) -> int:
        """Return how many of the newest readings answer no voltage: they do not show it."""
        import nidaqmx
        stopped = False
        try:
            stopped = bool(self._output.is_task_done()) and not self._is_finite
        except nidaqmx.errors.Error as error:
            if not is_underflow(error):
                with translated(self.name):
                    raise
            stopped = True
        # The newest reading, y[n-1], answers u[n-2].
        answered = self._fetched - 1
        if not stopped and answered <= 0:
            return 0
        count = self.generated()
        if count < answered:
            self._fault = Underflow(
                f'{self.name}: the output ran out of samples at index {count}; write voltages '
                'sooner, or prefill more', count)
        return max(0, answered - count)
