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
A digital controller that speaks GCS 2.0, driven open loop: wave table and data recorder as a block.

The recorder keeps the voltage of the output and the position in the same row of each cycle. The row
in which the wave begins is found in the recorded voltage, whatever the delay of the generator: with
the command c[k] of the wave, the recorded voltage v[i], and r the first row of the wave::

    v[r + k] = a + b c[k],   k = 0 ... N-1        y[k] = position[r + k] - operating point

with the target that is held before the wave, and the last one of it afterwards, in place of c[k].

Targets of an open-loop axis are micrometres too: c = operating point + target scale * u.
"""

import math
import time
from dataclasses import dataclass
from typing import Final, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.hardware.device import (
    DeviceConstraints,
    DeviceError,
    RateRefused,
    Refused,
    refuse_other_rate,
)
from piezo_ros.hardware.gcs_client import IS_WAVE_RUNNING, GcsClient, recorded_table
from piezo_ros.hardware.limits import refuse_beyond_rails
from piezo_ros.hardware.ramp import ramp_voltage
from piezo_ros.model.parameters import ParameterError, ParameterSet, parameter

__all__ = ['GcsDevice', 'GcsParameters']

_CYCLE_S: Final = '0x0E000200'  # parameter: period of the servo cycle
_RECORDER_POINTS: Final = '0x16000200'  # parameter: points of the recorder, all tables together
_WAVE_POINTS: Final = '0x13000004'  # parameter: points of the wave tables
_POSITION, _VOLTAGE = 2, 7  # what the recorder can record
_MOST_CYCLES: Final = 1000  # of a sample
_MOST_DELAY_ROWS: Final = 64  # from the start of the generator to its first point
_PIECE: Final = 100  # points of one command
_MISFIT: Final = 1e-3  # of the recorded voltage against the wave, relative to its span
_MISFIT_V: Final = 1e-3  # that the decimals of the table may bring


@dataclass(frozen=True, kw_only=True)
class GcsParameters(ParameterSet):
    """The controller, its axis, and what a volt is to it."""

    address: str = parameter(
        '127.0.0.1:50000', '', 'host:port, or a serial port such as /dev/ttyUSB0')
    baud_rate: int = parameter(
        115200, 'bit/s', 'speed of a serial port', minimum=300, maximum=10_000_000)
    axis: str = parameter('1', '', 'axis of the controller')
    output_signal: int = parameter(
        1, '', 'output channel of the recorded voltage', minimum=1, maximum=64)
    generator: int = parameter(1, '', 'wave generator of the axis', minimum=1, maximum=64)
    wave_table: int = parameter(1, '', 'wave table that blocks are put in', minimum=1, maximum=256)
    target_scale_um_per_v: float = parameter(
        1.2, 'um/V', 'open-loop target for each volt of deviation', minimum=1e-6, maximum=1e6)
    operating_point_v: float = parameter(
        5.0, 'V', 'voltage at zero deviation, on the scale of the rails', minimum=-1e3,
        maximum=1e3)
    operating_point_um: float = parameter(
        6.0, 'um', 'open-loop target, and position, at zero deviation', minimum=-1e4, maximum=1e4)
    voltage_minimum_v: float = parameter(
        -2.0, 'V', 'lowest voltage', minimum=-1e3, maximum=1e3)
    voltage_maximum_v: float = parameter(
        10.0, 'V', 'highest voltage', minimum=-1e3, maximum=1e3)
    timeout_s: float = parameter(
        10.0, 's', 'how long a reply may take', minimum=0.01, maximum=3600.0)

    def check_together(self) -> None:
        """Refuse an address that is none, and an operating point beyond the limits."""
        port = self.address.rpartition(':')[2]
        if not self.address.startswith('/') and not (
                ':' in self.address and port.isascii() and port.isdigit() and int(port) < 65536):
            raise ParameterError(
                f'address is {self.address!r}, it must be host:port or a serial port such as '
                '/dev/ttyUSB0')
        if not self.axis.isalnum():
            raise ParameterError(f'axis is {self.axis!r}, it must be letters and digits')
        if not self.voltage_minimum_v <= self.operating_point_v <= self.voltage_maximum_v:
            raise ParameterError(
                f'operating_point_v is {self.operating_point_v}, allowed is '
                f'{self.voltage_minimum_v} … {self.voltage_maximum_v}')


class GcsDevice:
    """
    A GCS 2.0 controller as a `Device`: blocks, no streams.

    Parameters
    ----------
    parameters : GcsParameters
        The controller and its axis.

    Raises
    ------
    Gone
        If it does not answer.
    Refused
        If it has no such axis.

    """

    def __init__(self, parameters: GcsParameters) -> None:
        self.parameters = p = parameters
        self._client: GcsClient | None = None
        client = self._connected()
        self._name = client.name
        identity = client.ask('*IDN?')
        axes = client.ask('SAI?').split()
        if p.axis not in axes:
            raise Refused(
                f'{self._name}: axis is {p.axis!r}, the controller has {", ".join(axes)}')
        self._cycle_s = client.value(f'SPA? 1 {_CYCLE_S}')
        # Two tables are used; where the recorder shares its memory, each has its part.
        tables = max(2, int(client.value('TNR?')))
        most = min(
            int(client.value(f'SPA? 1 {_RECORDER_POINTS}')) // tables - _MOST_DELAY_ROWS - 1,
            int(client.value(f'SPA? 1 {_WAVE_POINTS}')))
        self.constraints = DeviceConstraints(
            lowest_rate_hz=1.0 / (self._cycle_s * _MOST_CYCLES),
            highest_rate_hz=1.0 / self._cycle_s,
            lowest_voltage_v=p.voltage_minimum_v - p.operating_point_v,
            highest_voltage_v=p.voltage_maximum_v - p.operating_point_v,
            most_samples=most, streams=False, buffer_samples=None,
            identity=', '.join(filter(None, (part.strip() for part in identity.split(',')))))
        self._sample_period_s = math.nan
        self._cycles = 0  # of a sample; 0: not open

    def open(self, sample_period_s: float) -> float:
        """Set the sample period, a whole number of servo cycles."""
        if not (math.isfinite(sample_period_s) and sample_period_s > 0.0):
            raise Refused(
                f'{self._name}: sample_period_s is {sample_period_s}, it must be positive')
        cycles = round(sample_period_s / self._cycle_s)
        if not 1 <= cycles <= _MOST_CYCLES:
            raise RateRefused(
                f'{self._name}: sample_period_s is {sample_period_s} s, allowed is '
                f'{self._cycle_s:g} … {self._cycle_s * _MOST_CYCLES:g} s in steps of '
                f'{self._cycle_s:g} s')
        refuse_other_rate(self._name, sample_period_s, 1.0 / (cycles * self._cycle_s))
        client = self._connected()
        if client.value(f'SVO? {self.parameters.axis}'):
            raise Refused(
                f'{self._name}: the servo of axis {self.parameters.axis} is on; switch it off '
                '(SVO), with the stage where it may be: open loop is what is driven here')
        # Without a generator number: some controllers take that for all of them only.
        client.command(f'WTR 0 {cycles} 0')
        client.command(f'RTR {cycles}')
        self._sample_period_s, self._cycles = sample_period_s, cycles
        return sample_period_s

    def hold(self) -> float:
        """Return the open-loop target, as a deviation in volts."""
        target_um = self._opened().value(f'SVA? {self.parameters.axis}')
        return (target_um - self.parameters.operating_point_um) / (
            self.parameters.target_scale_um_per_v)

    def reading(self) -> float:
        """Return the position."""
        position_um = self._opened().value(f'POS? {self.parameters.axis}')
        return position_um - self.parameters.operating_point_um

    def set_output(self, voltage_v: float) -> None:
        """Set the open-loop target."""
        (target_um,) = self._targets_um('voltage_v', [voltage_v])
        self._opened().command(f'SVA {self.parameters.axis} {float(target_um)!r}')

    def ramp_to(self, voltage_v: float, slew_v_per_s: float) -> None:
        """Ramp, in as many blocks as it takes; the output holds between them."""
        self._targets_um('voltage_v', [voltage_v])
        ramp_v = ramp_voltage(self.hold(), voltage_v, slew_v_per_s, self._sample_period_s)
        most = self.constraints.most_samples or ramp_v.size
        for first in range(0, ramp_v.size, most):
            self.play(ramp_v[first:first + most])

    def play(self, voltage_v: ArrayLike) -> NDArray[np.float64]:
        """Play one block: wave table out, recorder back."""
        client = self._opened()
        targets_um = self._targets_um('voltage_v', voltage_v)
        most = self.constraints.most_samples
        if most is not None and targets_um.size > most:
            raise Refused(
                f'{self._name}: a block of {targets_um.size} voltages; allowed are 1 … {most}')
        held_um = client.value(f'SVA? {self.parameters.axis}')
        self._upload(client, targets_um)
        p = self.parameters
        client.command(f'WSL {p.generator} {p.wave_table}')
        client.command(f'WGC {p.generator} 1')
        client.command(f'DRC 1 {p.axis} {_POSITION} 2 {p.output_signal} {_VOLTAGE}')
        try:
            client.command(f'WGO {p.generator} 1')
            rows = targets_um.size + 1 + _MOST_DELAY_ROWS
            self._wait(client, rows)
        except BaseException:
            client.stop()
            raise
        _, table = recorded_table(client.ask(f'DRR? 1 {rows} 1 2'))
        first = _first_row(self._name, held_um, targets_um, table[:, 1])
        return table[first:first + targets_um.size + 1, 0] - p.operating_point_um

    def start(self, prefill_v: ArrayLike) -> None:
        """Refuse: one wave table is one block."""
        self._refuse_stream()

    def write(self, voltage_v: ArrayLike) -> None:
        """Refuse."""
        self._refuse_stream()

    def read(self, samples: int) -> NDArray[np.float64]:
        """Refuse."""
        self._refuse_stream()

    def generated(self) -> int:
        """Refuse."""
        self._refuse_stream()

    def finish(self) -> None:
        """Refuse."""
        self._refuse_stream()

    def close(self) -> None:
        """Close the connection; the controller holds its target."""
        client, self._client, self._cycles = self._client, None, 0
        if client is not None:
            client.close()

    def _connected(self) -> GcsClient:
        if self._client is None:
            p = self.parameters
            self._client = GcsClient(p.address, p.baud_rate, p.timeout_s)
        return self._client

    def _opened(self) -> GcsClient:
        if not self._cycles or self._client is None:
            raise DeviceError(f'{self._name}: it is not open; call open first')
        return self._client

    def _targets_um(self, name: str, voltage_v: ArrayLike) -> NDArray[np.float64]:
        c, p = self.constraints, self.parameters
        block_v = refuse_beyond_rails(
            self._name, name, voltage_v, c.lowest_voltage_v, c.highest_voltage_v)
        return p.operating_point_um + p.target_scale_um_per_v * block_v

    def _upload(self, client: GcsClient, targets_um: NDArray[np.float64]) -> None:
        for first in range(0, targets_um.size, _PIECE):
            piece = targets_um[first:first + _PIECE].tolist()
            # X begins the table anew, & appends to it.
            client.command(' '.join([
                'WAV', str(self.parameters.wave_table), '&' if first else 'X', 'PNT', '1',
                str(len(piece)), *map(repr, piece)]))

    def _wait(self, client: GcsClient, rows: int) -> None:
        """Wait until the wave has run and the recorder has its rows."""
        deadline_s = time.monotonic() + rows * self._sample_period_s + self.parameters.timeout_s
        while True:
            running = int(client.ask_byte(IS_WAVE_RUNNING).strip() or '0', 16)
            if not running and client.value('DRL? 1') >= rows:
                return
            if time.monotonic() > deadline_s:
                raise DeviceError(
                    f'{self._name}: the wave did not run, or was not recorded, within '
                    f'{self.parameters.timeout_s} s after its end')
            time.sleep(0.002)

    def _refuse_stream(self) -> NoReturn:
        raise Refused(
            f'{self._name}: it plays blocks of 1 … {self.constraints.most_samples} voltages, '
            'there is no stream')


def _first_row(
    name: str, held_um: float, targets_um: NDArray[np.float64], recorded_v: NDArray[np.float64],
) -> int:
    """
    Return the row in which the recorded voltage begins to follow the wave.

    Raises
    ------
    DeviceError
        If it follows the wave nowhere: then samples are missing.

    """
    misfits_v = []
    for row in range(_MOST_DELAY_ROWS + 1):
        expected_um = np.concatenate([
            np.full(row, held_um), targets_um,
            np.full(recorded_v.size - row - targets_um.size, targets_um[-1])])
        shape = expected_um - expected_um.mean()
        power = float(shape @ shape)
        change_v = recorded_v - recorded_v.mean()
        if power:
            change_v = change_v - float(shape @ change_v) / power * shape
        misfits_v.append(float(np.abs(change_v).max()))
    first = int(np.argmin(misfits_v))
    allowed_v = max(_MISFIT * float(np.ptp(recorded_v)), _MISFIT_V)
    if not misfits_v[first] <= allowed_v:
        raise DeviceError(
            f'{name}: the recorded voltage is not the wave that was uploaded (it differs by '
            f'{misfits_v[first]:.3g} V, allowed is {allowed_v:.3g} V); is the amplifier at a '
            'limit, or the recorder set to another channel?')
    return first
