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
What a real or simulated stage is to this package: blocks of voltages out, readings in.

One sample, as everywhere in the package: at instant k the sensor is read, then the output goes to
u[k], so that y[k+1] answers u[k], and N voltages go with the N+1 readings y[0] ... y[N].

Voltages are deviations from the operating point at the input of the amplifier, readings are
displacements in micrometres, as on the topics ``voltage`` and ``displacement``. A device applies
operating point and sensor scale itself (`calibration`).
"""

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    'Device',
    'DeviceConstraints',
    'DeviceError',
    'Gone',
    'MissingPackage',
    'Overflow',
    'RateRefused',
    'Refused',
    'Reserved',
    'Underflow',
    'refuse_other_rate',
]

_RATE_TOLERANCE: Final = 1e-9  # relative: the label of a block says the sample period


class DeviceError(Exception):
    """A device cannot do what it was asked; the text names it, the value and what to do."""


class Underflow(DeviceError):
    """
    The output ran out of samples and stood still; readings from there on mean nothing.

    Attributes
    ----------
    index : int
        k of the first voltage u[k] that did not go out in time.

    """

    def __init__(self, message: str, index: int) -> None:
        super().__init__(message)
        self.index = index


class Overflow(DeviceError):
    """Readings were overwritten before they were fetched."""


class Reserved(DeviceError):
    """Another program holds the device."""


class Gone(DeviceError):
    """The device, or the server in front of it, does not answer."""


class Refused(DeviceError):
    """The device does not take a value or a command."""


class RateRefused(Refused):
    """The device cannot sample at exactly this rate."""


class MissingPackage(DeviceError):
    """The library of the vendor is not installed; the text names the extra that brings it."""


@dataclass(frozen=True)
class DeviceConstraints:
    """
    What a device can do, known before it is opened.

    Attributes
    ----------
    lowest_rate_hz, highest_rate_hz : float
        Sample rates.
    lowest_voltage_v, highest_voltage_v : float
        Rails, deviations from the operating point.
    most_samples : int or None
        Most voltages of one finite block (`Device.play`); None for no limit but memory.
    streams : bool
        Whether voltages can be written while others go out (`Device.start`).
    buffer_samples : int or None
        Most voltages that wait in a stream, and most readings; None for no limit but memory.
    identity : str
        Product and serial number.

    """

    lowest_rate_hz: float
    highest_rate_hz: float
    lowest_voltage_v: float
    highest_voltage_v: float
    most_samples: int | None
    streams: bool
    buffer_samples: int | None
    identity: str


class Device(Protocol):
    """
    A stage behind converters with a clock of their own.

    Every method may raise Gone and Reserved; voltages that are not finite or beyond the rails are
    Refused before anything moves.

    Attributes
    ----------
    constraints : DeviceConstraints
        What it can do.

    """

    @property
    def constraints(self) -> DeviceConstraints:
        """What it can do."""
        ...

    def open(self, sample_period_s: float) -> float:
        """
        Set the sample period; the output stays as it is.

        Parameters
        ----------
        sample_period_s : float
            Sample period, seconds.

        Returns
        -------
        float
            The sample period that the clock of the device has, seconds.

        Raises
        ------
        RateRefused
            If the two differ by more than 1e-9 of the period.

        """
        ...

    def hold(self) -> float:
        """Return the voltage that the output holds now, volts."""
        ...

    def reading(self) -> float:
        """Return one reading of the sensor now, micrometres."""
        ...

    def set_output(self, voltage_v: float) -> None:
        """
        Set the output at once, by software: a slow loop without a clock of the device.

        The caller keeps the step within the slew of the amplifier.
        """
        ...

    def ramp_to(self, voltage_v: float, slew_v_per_s: float) -> None:
        """
        Ramp the output by the clock of the device, from the voltage that it holds, and return.

        A stream that still runs is stopped first: the output holds what it reached, its readings
        are dropped, and the ramp begins there.

        Parameters
        ----------
        voltage_v : float
            Where to, volts.
        slew_v_per_s : float
            Largest slope, volts per second.

        """
        ...

    def play(self, voltage_v: ArrayLike) -> NDArray[np.float64]:
        """
        Play one finite block; afterwards the output holds its last voltage.

        Parameters
        ----------
        voltage_v : array_like, shape (N,)
            u[0] ... u[N-1], volts; N is 1 or more.

        Returns
        -------
        ndarray of float64, shape (N+1,)
            y[0] ... y[N], micrometres; y[k+1] answers u[k].

        """
        ...

    def start(self, prefill_v: ArrayLike) -> None:
        """
        Start a stream with its first voltages, shape (N,), volts; N is 1 or more.

        From now on voltages are to be written and readings to be fetched in time.
        """
        ...

    def write(self, voltage_v: ArrayLike) -> None:
        """
        Append voltages to the stream, shape (N,), volts; return when they are taken.

        Raises
        ------
        Underflow
            If the output has run out of samples meanwhile.
        Overflow
            If readings were lost while it waited for room.

        """
        ...

    def read(self, samples: int) -> NDArray[np.float64]:
        """
        Return the next readings of the stream, the first of all being y[0].

        Parameters
        ----------
        samples : int
            How many: 1 or more. It returns when they are there.

        Returns
        -------
        ndarray of float64, shape (samples,)
            Micrometres; none that was taken after the output had run out of samples.

        Raises
        ------
        Underflow
            If the output ran out of samples before the last of these readings.
        Overflow
            If readings were lost.

        """
        ...

    def generated(self) -> int:
        """Return how many voltages of the stream have gone out so far."""
        ...

    def finish(self) -> None:
        """
        Say that the last voltage of the stream has been written.

        Then the output may run out of samples: it holds the last one. Of N voltages in all, N+1
        readings can be read; the last of them ends the stream.
        """
        ...

    def close(self) -> None:
        """
        Release the device; the output holds what it holds. Never a reset, which may step to 0 V.

        A closed device can be opened again. Closing it twice does nothing.
        """
        ...


def refuse_other_rate(
    name: str, asked_sample_period_s: float, actual_rate_hz: float,
) -> float:
    """
    Return the sample period that a clock has, if it is the one that was asked for.

    Parameters
    ----------
    name : str
        The device, for the message.
    asked_sample_period_s : float
        What was asked for, seconds.
    actual_rate_hz : float
        Rate that the device has set, hertz.

    Raises
    ------
    RateRefused
        If they differ by more than 1e-9.

    """
    if not abs(actual_rate_hz * asked_sample_period_s - 1.0) <= _RATE_TOLERANCE:
        raise RateRefused(
            f'{name}: sample_period_s is {asked_sample_period_s!r} s; the nearest that its clock '
            f'makes is {1.0 / actual_rate_hz!r} s ({actual_rate_hz!r} Hz): take that one')
    return 1.0 / actual_rate_hz
