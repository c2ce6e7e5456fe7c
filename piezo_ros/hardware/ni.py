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
A card of National Instruments in front of an analogue amplifier, through NI-DAQmx.

Voltages are played by the clock of the card (`ni_tasks`). Neither here nor elsewhere in the package
is a card reset: that would set the output to 0 V.
"""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.hardware.calibration import (
    Calibration,
    deviation_v,
    displacement_um,
    output_v,
)
from piezo_ros.hardware.device import (
    DeviceConstraints,
    DeviceError,
    RateRefused,
    Refused,
    Underflow,
)
from piezo_ros.hardware.limits import refuse_beyond_rails
from piezo_ros.hardware.ni_connection import NiConnection
from piezo_ros.hardware.ni_errors import translated
from piezo_ros.hardware.ni_on_demand import OnDemandTasks
from piezo_ros.hardware.ni_tasks import ClockedTasks, NiChannels
from piezo_ros.hardware.ramp import ramp_voltage
from piezo_ros.model.parameters import ParameterError, parameter

__all__ = ['NiDevice', 'NiParameters', 'attached_cards']

_MOST_SAMPLES: Final = 100_000_000
_TAIL_SAMPLES: Final = 8192  # that a stream holds its last voltage for, so that it does not run dry
_SAME_V: Final = 0.005  # what is read back may differ by so much from what was played


@dataclass(frozen=True, kw_only=True)
class NiParameters(Calibration):
    """The card, its channels and what is connected to them."""

    address: str = parameter(
        '', '', "host:port of a device server (gRPC); '': the driver of this machine")
    output_channel: str = parameter('Dev1/ao0', '', 'output to the amplifier')
    input_channel: str = parameter(
        'Dev1/ai0', '', 'input from the sensor: one channel, since a second one is converted later')
    held_channel: str = parameter(
        '', '', "input that reads what the output holds; '': the one inside the card, "
        '_ao0_vs_aognd for ao0')
    terminals: str = parameter(
        'default', '', 'terminal configuration of the input',
        choices=('default', 'differential', 'rse', 'nrse'))
    input_range_v: float = parameter(
        10.0, 'V', 'range of the input on both sides of 0 V', minimum=1e-3, maximum=1e3)
    voltage_minimum_v: float = parameter(
        -2.0, 'V', 'lowest voltage at the output', minimum=-1e3, maximum=1e3)
    voltage_maximum_v: float = parameter(
        10.0, 'V', 'highest voltage at the output', minimum=-1e3, maximum=1e3)
    buffer_samples: int = parameter(
        1_000_000, '', 'voltages and readings of a stream that wait in memory', minimum=1000,
        maximum=_MOST_SAMPLES)
    timeout_s: float = parameter(
        10.0, 's', 'how long a call waits for the card', minimum=0.01, maximum=3600.0)

    def check_together(self) -> None:
        """Refuse channels of which there is not one, or on two cards."""
        super().check_together()
        for name in ('output_channel', 'input_channel'):
            value = getattr(self, name)
            card, slash, rest = value.partition('/')
            if not (card and slash and rest) or set(value) & set(',: \t'):
                raise ParameterError(
                    f'{name} is {value!r}, it must be one channel of one card, such as Dev1/ai0: '
                    'further channels are converted later than the first')
        if self.input_channel.split('/')[0] != self.output_channel.split('/')[0]:
            raise ParameterError(
                f'output_channel is {self.output_channel!r} and input_channel '
                f'{self.input_channel!r}: they must be on one card and share its clock')
        if not self.voltage_minimum_v <= self.operating_point_v <= self.voltage_maximum_v:
            raise ParameterError(
                f'operating_point_v is {self.operating_point_v}, allowed is '
                f'{self.voltage_minimum_v} … {self.voltage_maximum_v}')


class NiDevice:
    """
    An NI-DAQmx card as a `Device`.

    Parameters
    ----------
    parameters : NiParameters
        The card and what is connected to it.

    Raises
    ------
    MissingPackage
        If nidaqmx is not installed.
    Gone, Refused
        If the server does not answer, or has no such card.

    """

    def __init__(self, parameters: NiParameters) -> None:
        self.parameters = p = parameters
        card, output = p.output_channel.split('/', 1)
        self._connection = NiConnection(p.address, card, p.timeout_s)
        self._name = self._connection.name
        with translated(self._name):
            self.constraints, lowest_v, highest_v = _constraints(self._connection.device(), p)
        self._channels = NiChannels(
            p.output_channel, p.input_channel, p.held_channel or f'{card}/_{output}_vs_aognd',
            lowest_v, highest_v, p.input_range_v, p.terminals)
        self._on_demand = OnDemandTasks(self._connection, self._channels, p.timeout_s)
        self._sample_period_s = math.nan
        self._is_open = False
        self._stream: ClockedTasks | None = None
        self._finished_at: int | None = None  # voltages of a stream that has its last one
        self._fetched = 0  # readings of the stream
        self._last_v = math.nan  # newest voltage of the stream
        self._held_before_v = math.nan  # what the output held before the stream
        self._played_v: float | None = None  # what the output holds if nothing else moved it

    def open(self, sample_period_s: float) -> float:
        """Set the sample period; the card is asked for the rate that it makes of it."""
        c = self.constraints
        if not (math.isfinite(sample_period_s) and sample_period_s > 0.0):
            raise Refused(
                f'{self._name}: sample_period_s is {sample_period_s}, it must be positive')
        if not c.lowest_rate_hz <= 1.0 / sample_period_s <= c.highest_rate_hz:
            raise RateRefused(
                f'{self._name}: sample_period_s is {sample_period_s} s, allowed is '
                f'{1.0 / c.highest_rate_hz:g} … {1.0 / c.lowest_rate_hz:g} s')
        try:
            if not self._is_open:
                self._connection.acquire()
            # Made for the rate alone; it raises if the clock makes another one.
            ClockedTasks(
                self._connection, self._channels, sample_period_s, self.parameters.timeout_s,
                samples=2).close()
        except BaseException:
            if not self._is_open:
                self._connection.close()
            raise
        self._sample_period_s = sample_period_s
        self._is_open = True
        return sample_period_s

    def hold(self) -> float:
        """Return what the card reads back of its output, or in a stream has put out last."""
        if self._stream is not None:
            newest_v = self._stream.newest_output_v()
            if newest_v is not None:
                return deviation_v(self.parameters, newest_v)
            return self._held_before_v
        self._require_idle('hold')
        held_v = deviation_v(self.parameters, self._on_demand.held_v())
        played_v = self._played_v
        # Read back, it is rounded and noisy; what was played last is exact, if it is still there.
        return played_v if played_v is not None and abs(played_v - held_v) <= _SAME_V else held_v

    def reading(self) -> float:
        """Return one reading, timed by software."""
        self._require_idle('reading')
        readings_v = np.array([self._on_demand.reading_v()])
        return float(displacement_um(self.parameters, readings_v)[0])

    def set_output(self, voltage_v: float) -> None:
        """Set the output, timed by software."""
        self._require_idle('set_output')
        block_v = self._allowed('voltage_v', [voltage_v])
        self._played_v = None
        self._on_demand.set_output_v(float(output_v(self.parameters, block_v)[0]))
        self._played_v = float(voltage_v)

    def ramp_to(self, voltage_v: float, slew_v_per_s: float) -> None:
        """Ramp by the clock of the card; a stream that runs is stopped where it is."""
        self._allowed('voltage_v', [voltage_v])
        self._end_stream()
        ramp_v = ramp_voltage(self.hold(), voltage_v, slew_v_per_s, self._sample_period_s)
        self._play(ramp_v)

    def play(self, voltage_v: ArrayLike) -> NDArray[np.float64]:
        """Play one block."""
        self._require_idle('play')
        block_v = self._allowed('voltage_v', voltage_v)
        most = self.constraints.most_samples
        if most is not None and block_v.size > most:
            raise Refused(
                f'{self._name}: a block of {block_v.size} voltages; allowed are 1 … {most}')
        return self._play(block_v)

    def start(self, prefill_v: ArrayLike) -> None:
        """Start a stream."""
        self._require_idle('start')
        block_v = self._allowed('prefill_v', prefill_v)
        room = self.parameters.buffer_samples
        if block_v.size > room:
            raise Refused(
                f'{self._name}: prefill of {block_v.size} voltages; buffer_samples allows '
                f'1 … {room}')
        self._held_before_v = self.hold()
        self._on_demand.end()
        self._played_v = None
        tasks = ClockedTasks(
            self._connection, self._channels, self._sample_period_s, self.parameters.timeout_s,
            samples=None, buffer_samples=room)
        try:
            tasks.write(output_v(self.parameters, block_v))
            tasks.start()
        except BaseException:
            tasks.close()
            raise
        self._stream, self._finished_at = tasks, None
        self._last_v = float(block_v[-1])
        self._fetched = 0

    def write(self, voltage_v: ArrayLike) -> None:
        """Append voltages."""
        stream = self._running()
        if self._finished_at is not None:
            raise Refused(f'{self._name}: a stream that is finished takes no more voltages')
        block_v = self._allowed('voltage_v', voltage_v)
        stream.write(output_v(self.parameters, block_v))
        self._last_v = float(block_v[-1])

    def read(self, samples: int) -> NDArray[np.float64]:
        """Return readings."""
        stream = self._running()
        if samples < 1:
            raise Refused(f'{self._name}: {samples} readings asked for, allowed is 1 or more')
        end = self._finished_at
        if end is not None and self._fetched + samples > end + 1:
            raise Refused(
                f'{self._name}: {samples} readings asked for, but of {end} voltages '
                f'{end + 1 - self._fetched} readings are left')
        readings_um = displacement_um(self.parameters, stream.read(samples))
        self._fetched += samples
        self._end_if_read()
        return readings_um

    def generated(self) -> int:
        """Return how many voltages have gone out."""
        count = self._running().generated()
        return count if self._finished_at is None else min(count, self._finished_at)

    def finish(self) -> None:
        """Say that the last voltage has been written; it is held, so that the end runs not dry."""
        stream = self._running()
        if self._finished_at is None:
            end = stream.written
            tail = min(_TAIL_SAMPLES, self.parameters.buffer_samples // 2)
            try:
                stream.write(output_v(self.parameters, np.full(tail, self._last_v)))
            except Underflow as error:
                # The last voltage went out before this was called: nothing is missing.
                if error.index < end:
                    raise
            self._finished_at = end
            self._end_if_read()

    def close(self) -> None:
        """Release the card; the output holds."""
        try:
            if self._is_open:
                self._end_stream()
                self._on_demand.end()
        finally:
            self._is_open = False
            self._connection.close()

    def _play(self, block_v: NDArray[np.float64]) -> NDArray[np.float64]:
        self._on_demand.end()
        self._played_v = None
        tasks = ClockedTasks(
            self._connection, self._channels, self._sample_period_s, self.parameters.timeout_s,
            samples=block_v.size)
        try:
            tasks.write(output_v(self.parameters, block_v))
            tasks.start()
            readings_v = tasks.read(block_v.size + 1)
            tasks.wait()
        finally:
            tasks.close()
        self._played_v = float(block_v[-1])
        return displacement_um(self.parameters, readings_v)

    def _end_if_read(self) -> None:
        """End a finished stream of which the last reading was fetched."""
        if self._finished_at is not None and self._fetched == self._finished_at + 1:
            self._end_stream()
            self._played_v = self._last_v

    def _end_stream(self) -> None:
        stream = self._stream
        if stream is None:
            return
        self._played_v = None
        try:
            stream.stop()
            self._played_v = self.hold()
        except DeviceError:
            pass  # then it is read back
        finally:
            self._stream = None
            stream.close()

    def _allowed(self, name: str, voltage_v: ArrayLike) -> NDArray[np.float64]:
        c = self.constraints
        return refuse_beyond_rails(
            self._name, name, voltage_v, c.lowest_voltage_v, c.highest_voltage_v)

    def _require_idle(self, what: str) -> None:
        if not self._is_open:
            raise DeviceError(f'{self._name}: it is not open; call open first')
        if self._stream is not None:
            raise Refused(f'{self._name}: {what} while a stream is running; end it first')

    def _running(self) -> ClockedTasks:
        if self._stream is None:
            raise Refused(f'{self._name}: no stream is running; call start first')
        return self._stream


def attached_cards(address: str, timeout_s: float = 10.0) -> list[str]:
    """
    Return name, product and serial number of each card with analogue output.

    Parameters
    ----------
    address : str
        '' for the driver of this machine, else host:port of a device server.
    timeout_s : float, optional
        How long a call waits, seconds.

    Raises
    ------
    MissingPackage, Gone
        As of `NiDevice`.

    """
    connection = NiConnection(address, 'cards', timeout_s)
    try:
        with translated(connection.name):
            return [
                f'{device.name}: {_identity(device)}' for device in connection.system.devices
                if list(device.ao_physical_chans)]
    finally:
        connection.close()


def _constraints(device: Any, p: NiParameters) -> tuple[DeviceConstraints, float, float]:
    """Return what the card can do, and the rails at its connector, volts."""
    name = f'{device.name}, {p.output_channel}'
    ranges_v = list(device.ao_voltage_rngs)
    if not ranges_v:
        raise Refused(f'{name}: the card has no analogue output')
    lowest_v = max(p.voltage_minimum_v, min(ranges_v))
    highest_v = min(p.voltage_maximum_v, max(ranges_v))
    if not lowest_v <= p.operating_point_v <= highest_v:
        raise Refused(
            f'{name}: operating_point_v is {p.operating_point_v} V, the card allows '
            f'{lowest_v:g} … {highest_v:g} V')
    constraints = DeviceConstraints(
        lowest_rate_hz=max(device.ai_min_rate, device.ao_min_rate),
        highest_rate_hz=min(device.ai_max_single_chan_rate, device.ao_max_rate),
        lowest_voltage_v=lowest_v - p.operating_point_v,
        highest_voltage_v=highest_v - p.operating_point_v,
        most_samples=_MOST_SAMPLES, streams=True, buffer_samples=p.buffer_samples,
        identity=_identity(device))
    return constraints, lowest_v, highest_v


def _identity(device: Any) -> str:
    return f'{device.product_type}, serial number {device.serial_num:08X}'
