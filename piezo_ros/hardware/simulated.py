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
The simulated rig as a device: the reference of every test, and a stage to try things on.

It has no clock: time goes on as far as readings are fetched, or as voltages are written into a full
buffer. The bits are those of `Rig.run`.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.hardware.device import (
    DeviceConstraints,
    DeviceError,
    Overflow,
    Refused,
    Underflow,
    refuse_other_rate,
)
from piezo_ros.hardware.limits import refuse_beyond_rails
from piezo_ros.hardware.ramp import ramp_voltage
from piezo_ros.model.parameters import parameter
from piezo_ros.model.rig import RigParameters
from piezo_ros.model.simulated_rig import Rig

__all__ = ['SimulatedDevice', 'SimulatedDeviceParameters']

_LOWEST_RATE_HZ: Final = 1e-3
_HIGHEST_RATE_HZ: Final = 1e8
_NAME: Final = 'simulated stage'
_SETTLING_S: Final = 0.1


@dataclass(frozen=True, kw_only=True)
class SimulatedDeviceParameters(RigParameters):
    """The rig and the buffers of the converters in front of it."""

    most_samples: int = parameter(
        0, '', 'most voltages of one block; 0: any number', minimum=0, maximum=2**31)
    buffer_samples: int = parameter(
        0, '', 'most voltages that wait in a stream, and most readings; 0: any number', minimum=0,
        maximum=2**31)
    held_v: float = parameter(
        0.0, 'V', 'voltage that the output holds at first, deviation from the operating point',
        minimum=-1e3, maximum=1e3)


class SimulatedDevice:
    """
    The simulated rig as a `Device`, at rest and never driven when it is made.

    Parameters
    ----------
    parameters : SimulatedDeviceParameters, optional
        The rig; the published values without mismatch by default.
    compiled : bool, optional
        Whether the rig computes in compiled code; the bits are the same.

    Examples
    --------
    >>> device = SimulatedDevice(compiled=False)
    >>> device.open(1e-5)
    1e-05
    >>> len(device.play([0.0, 1.0, 1.0]))
    4

    """

    def __init__(
        self, parameters: SimulatedDeviceParameters | None = None, *, compiled: bool = True,
    ) -> None:
        self.parameters = parameters or SimulatedDeviceParameters()
        p = self.parameters
        self.constraints = DeviceConstraints(
            lowest_rate_hz=_LOWEST_RATE_HZ, highest_rate_hz=_HIGHEST_RATE_HZ,
            lowest_voltage_v=p.voltage_minimum_v - p.operating_point_v,
            highest_voltage_v=p.voltage_maximum_v - p.operating_point_v,
            most_samples=p.most_samples or None, streams=True,
            buffer_samples=p.buffer_samples or None,
            identity=f'{_NAME}, seed {p.seed}')
        self._compiled = compiled
        self._rig: Rig | None = None
        self._is_open = False
        self._held_v = self._allowed('held_v', np.array([p.held_v]))[0]
        self._stream: _Stream | None = None

    @property
    def rig(self) -> Rig:
        """The rig behind the device; it lives on when the device is closed, as a stage does."""
        if self._rig is None or not self._is_open:
            raise DeviceError(f'{_NAME}: it is not open; call open first')
        return self._rig

    def open(self, sample_period_s: float) -> float:
        """Set the sample period; the rig is where it was, unless the period is another one."""
        c = self.constraints
        if not (math.isfinite(sample_period_s) and sample_period_s > 0.0):
            raise Refused(f'{_NAME}: sample_period_s is {sample_period_s}, it must be positive')
        rate_hz = min(max(1.0 / sample_period_s, c.lowest_rate_hz), c.highest_rate_hz)
        refuse_other_rate(_NAME, sample_period_s, rate_hz)
        if self._rig is None or self._rig.sample_period_s != sample_period_s:
            self._rig = Rig(self.parameters, sample_period_s, compiled=self._compiled)
            if self._held_v:
                # What moved before the device was opened has long settled.
                self._rig.drive(np.full(math.ceil(_SETTLING_S / sample_period_s), self._held_v))
        self._is_open = True
        return sample_period_s

    def hold(self) -> float:
        """Return the voltage that the output holds; in a stream, the one that has gone out last."""
        _ = self.rig
        waiting_v = self._stream.waiting_v if self._stream else np.empty(0)
        return float(waiting_v[0] if waiting_v.size else self._held_v)

    def reading(self) -> float:
        """Return the reading at this instant; time stands still."""
        return self.rig.measure()

    def set_output(self, voltage_v: float) -> None:
        """Hold a voltage for one sample period."""
        self._refuse_while_streaming('set_output')
        self._drive(self._allowed('voltage_v', np.array([voltage_v])))

    def ramp_to(self, voltage_v: float, slew_v_per_s: float) -> None:
        """Ramp the output; a stream is stopped where it is."""
        rig = self.rig
        (to_v,) = self._allowed('voltage_v', np.array([voltage_v]))
        from_v = self.hold()
        self._stream = None
        self._drive(ramp_voltage(from_v, to_v, slew_v_per_s, rig.sample_period_s))

    def play(self, voltage_v: ArrayLike) -> NDArray[np.float64]:
        """Play one block."""
        self._refuse_while_streaming('play')
        block_v = self._allowed('voltage_v', voltage_v)
        most = self.constraints.most_samples
        if most is not None and block_v.size > most:
            raise Refused(
                f'{_NAME}: a block of {block_v.size} voltages; allowed are 1 … {most} '
                '(most_samples)')
        return np.concatenate([[self.rig.measure()], self._drive(block_v)])

    def start(self, prefill_v: ArrayLike) -> None:
        """Start a stream."""
        self._refuse_while_streaming('start')
        first_um = self.rig.measure()
        stream = _Stream(first_um)
        self._take(stream, self._allowed('prefill_v', prefill_v))
        self._stream = stream

    def write(self, voltage_v: ArrayLike) -> None:
        """Append voltages; where the buffer is full, time goes on until there is room."""
        stream = self._running()
        if stream.finished:
            raise Refused(f'{_NAME}: a stream that is finished takes no more voltages')
        if stream.underflow:
            raise stream.ran_out()
        self._take(stream, self._allowed('voltage_v', voltage_v))

    def read(self, samples: int) -> NDArray[np.float64]:
        """Return readings; time goes on as far as they need."""
        stream = self._running()
        if samples < 1:
            raise Refused(f'{_NAME}: {samples} readings asked for, allowed is 1 or more')
        missing = samples - stream.readings_um.size
        if missing > stream.waiting_v.size:
            if stream.finished:
                raise Refused(
                    f'{_NAME}: {samples} readings asked for, but of {stream.written} voltages '
                    f'{stream.readings_um.size + stream.waiting_v.size} readings are left')
            self._advance(stream, stream.waiting_v.size)
            stream.underflow = True
            raise stream.ran_out()
        self._advance(stream, missing)
        readings_um, stream.readings_um = np.split(stream.readings_um, [samples])
        if stream.is_at_end:
            # At the instant of this reading there was no voltage to go out.
            stream.underflow = True
            if stream.finished:
                self._stream = None
        return readings_um

    def generated(self) -> int:
        """Return how many voltages have gone out."""
        stream = self._running()
        # At the instant of the newest reading the next one goes out.
        return min(stream.written, stream.written - stream.waiting_v.size + 1)

    def finish(self) -> None:
        """Say that the last voltage of the stream has been written."""
        stream = self._running()
        stream.finished = True
        if stream.is_at_end:
            self._stream = None

    def close(self) -> None:
        """Release the device; the rig stays where it is."""
        if self._stream is not None:
            self._held_v = self.hold()
        self._stream = None
        self._is_open = False

    def _drive(self, voltage_v: NDArray[np.float64]) -> NDArray[np.float64]:
        rig = self.rig
        readings_um = rig.answer(rig.index, voltage_v)
        self._held_v = voltage_v[-1]
        return readings_um

    def _take(self, stream: '_Stream', voltage_v: NDArray[np.float64]) -> None:
        room = self.constraints.buffer_samples
        if room is not None:
            if voltage_v.size > room:
                raise Refused(
                    f'{_NAME}: {voltage_v.size} voltages at once; its buffer takes 1 … {room}')
            self._advance(stream, voltage_v.size + stream.waiting_v.size - room)
        stream.waiting_v = np.concatenate([stream.waiting_v, voltage_v])
        stream.written += voltage_v.size

    def _advance(self, stream: '_Stream', samples: int) -> None:
        """Let time go on by some samples that wait."""
        if samples <= 0:
            return
        due_v, stream.waiting_v = np.split(stream.waiting_v, [samples])
        stream.readings_um = np.concatenate([stream.readings_um, self._drive(due_v)])
        room = self.constraints.buffer_samples
        if room is not None and stream.readings_um.size > room:
            raise Overflow(
                f'{_NAME}: {stream.readings_um.size} readings wait, its buffer keeps {room}; read '
                'more often')

    def _allowed(self, name: str, voltage_v: ArrayLike) -> NDArray[np.float64]:
        c = self.constraints
        return refuse_beyond_rails(_NAME, name, voltage_v, c.lowest_voltage_v, c.highest_voltage_v)

    def _running(self) -> '_Stream':
        _ = self.rig
        if self._stream is None:
            raise Refused(f'{_NAME}: no stream is running; call start first')
        return self._stream

    def _refuse_while_streaming(self, what: str) -> None:
        _ = self.rig
        if self._stream is not None:
            raise Refused(f'{_NAME}: {what} while a stream is running; end it first')


class _Stream:
    def __init__(self, first_um: float) -> None:
        self.waiting_v = np.empty(0)
        self.readings_um = np.array([first_um])
        self.written = 0
        self.finished = False
        self.underflow = False

    @property
    def is_at_end(self) -> bool:
        """Whether the reading that answers the last voltage was fetched."""
        return not self.waiting_v.size and not self.readings_um.size

    def ran_out(self) -> Underflow:
        return Underflow(
            f'{_NAME}: the output ran out of samples at index {self.written}; write voltages '
            'sooner, or prefill more', self.written)
