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
Checks a device against the protocol: alignment, ramps, limits, errors.

It drives the output, with the amplitude that it is given.
"""

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.hardware.device import Device, DeviceError, Underflow

__all__ = ['DeviceFinding', 'check_device']

_REST: Final = 40  # readings, and as many before them for the noise
_BLOCKS: Final = (1, 2, 3, 64, 999, 1000, 1001)
_HELD_TOLERANCE: Final = 0.01  # of the amplitude, for a resolution and its noise
_OF_PEAK: Final = 0.05  # what counts as an answer
_SIGMAS: Final = 8.0
_SLEW: Final = 1e4  # amplitudes per second, of a ramp


class DeviceFinding(NamedTuple):
    """One thing that was checked."""

    what: str
    right: bool | None  # None: could not be checked
    detail: str


def check_device(
    device: Device, sample_period_s: float, amplitude_v: float,
) -> Iterator[DeviceFinding]:
    """
    Check a device that nothing else uses.

    Parameters
    ----------
    device : Device
        The device, not open yet. Its output is driven.
    sample_period_s : float
        Sample period, seconds.
    amplitude_v : float
        How far from zero deviation the output is driven, volts.

    Yields
    ------
    DeviceFinding
        Each thing once it was checked. After one that leaves no way to go on there are no more.

    """
    c = device.constraints
    yield DeviceFinding(
        'its constraints are ranges and name it',
        bool(c.identity) and 0.0 < c.lowest_rate_hz <= c.highest_rate_hz
        and c.lowest_voltage_v <= 0.0 <= c.highest_voltage_v, str(c))
    yield _refuses('a rate above its highest', device, lambda: device.open(0.1 / c.highest_rate_hz))
    try:
        yield from _checks(device, sample_period_s, amplitude_v)
    except DeviceError as error:
        yield DeviceFinding('it does what the protocol asks for', False, _named(error))
    finally:
        device.close()
    device.close()
    yield DeviceFinding('it can be closed twice', True, '')


def _checks(
    device: Device, sample_period_s: float, amplitude_v: float,
) -> Iterator[DeviceFinding]:
    period_s = device.open(sample_period_s)
    yield DeviceFinding(
        'it opens at the sample period', abs(period_s / sample_period_s - 1.0) <= 1e-9,
        f'{period_s!r} s')
    yield DeviceFinding('it knows what it holds', math.isfinite(device.hold()), '')
    device.ramp_to(0.0, _SLEW * amplitude_v)
    yield _holds(device, 0.0, amplitude_v, 'a ramp to rest')
    device.ramp_to(amplitude_v, _SLEW * amplitude_v)
    yield _holds(device, amplitude_v, amplitude_v, 'a ramp to the amplitude')
    device.ramp_to(0.0, _SLEW * amplitude_v)
    yield DeviceFinding('it reads at rest', math.isfinite(device.reading()), '')
    yield from _limits(device, amplitude_v)
    yield from _alignment(device, amplitude_v)
    if device.constraints.streams:
        yield from _streams(device, amplitude_v)
    device.ramp_to(0.0, _SLEW * amplitude_v)


def _holds(
    device: Device, voltage_v: float, amplitude_v: float, after: str,
) -> DeviceFinding:
    held_v = device.hold()
    return DeviceFinding(
        f'it holds {voltage_v:g} V after {after}',
        abs(held_v - voltage_v) <= _HELD_TOLERANCE * amplitude_v, f'{held_v:g} V')


def _limits(device: Device, amplitude_v: float) -> Iterator[DeviceFinding]:
    c = device.constraints
    beyond_v = c.highest_voltage_v + max(1.0, abs(c.highest_voltage_v))
    for what, voltage_v in (
        ('a voltage that is no number', math.nan), ('an infinite voltage', math.inf),
        ('a voltage above the rails', beyond_v),
    ):
        yield _refuses(what, device, partial(device.play, [0.0, voltage_v]))
    yield _holds(device, 0.0, amplitude_v, 'what it has refused')
    yield _refuses('an empty block', device, lambda: device.play([]))
    yield _refuses('reading a stream that was not started', device, lambda: device.read(1))
    if c.most_samples is not None and c.most_samples < 10**7:
        too_long = np.zeros(c.most_samples + 1)
        yield _refuses('a block that is too long', device, lambda: device.play(too_long))


def _refuses(what: str, device: Device, action: Callable[[], object]) -> DeviceFinding:
    try:
        action()
    except DeviceError as error:
        return DeviceFinding(f'it refuses {what}', True, _named(error))
    except Exception as error:  # what should have been a DeviceError
        return DeviceFinding(
            f'it refuses {what}', False, f'{_named(error)}; it must be a DeviceError')
    return DeviceFinding(f'it refuses {what}', False, 'it took it')


def _named(error: Exception) -> str:
    return f'{type(error).__name__}: {error}'


def _alignment(device: Device, amplitude_v: float) -> Iterator[DeviceFinding]:
    """Check that an impulse is answered equally late whatever the block around it."""
    most = device.constraints.most_samples or max(_BLOCKS)
    delays: dict[int, int | None] = {}
    for size in _BLOCKS:
        if size > most:
            continue
        voltage_v = np.zeros(size)
        voltage_v[size // 2] = amplitude_v
        readings_um = np.asarray(device.play(voltage_v))
        yield DeviceFinding(
            f'{size} voltages have {size + 1} readings',
            readings_um.shape == (size + 1,) and bool(np.isfinite(readings_um).all()),
            f'shape {readings_um.shape}')
        device.play(np.zeros(min(_REST, most)))
        if size > 4 * _REST:
            delays[size] = _delay(readings_um, size // 2)
    yield _equal_delays('an impulse is answered equally late in every block', delays)


def _delay(readings_um: NDArray[np.float64], at: int) -> int | None:
    """Return after how many samples an impulse is answered, None if the noise hides that."""
    # Not up to the impulse, which a wrong device may answer before.
    rest_um = readings_um[max(0, at - 2 * _REST):max(1, at - _REST)]
    noise_um = float(rest_um.std())
    answer_um = np.abs(readings_um - rest_um.mean())
    threshold_um = max(_SIGMAS * noise_um, _OF_PEAK * float(answer_um[at:].max()))
    above = np.flatnonzero(answer_um > threshold_um)
    return int(above[0]) - at if above.size else None


def _equal_delays(what: str, delays: dict[int, int | None]) -> DeviceFinding:
    known = {size: delay for size, delay in delays.items() if delay is not None}
    detail = ', '.join(f'{delay} samples of {size}' for size, delay in known.items())
    if not known:
        return DeviceFinding(what, None, 'no answer above the noise; take a larger amplitude')
    values = known.values()
    return DeviceFinding(what, min(values) >= 1 and max(values) == min(values), detail)


def _streams(device: Device, amplitude_v: float) -> Iterator[DeviceFinding]:
    size, first = 1000, 300
    voltage_v = np.zeros(size)
    voltage_v[size // 2] = amplitude_v
    block = _delay(np.asarray(device.play(voltage_v)), size // 2)
    device.play(np.zeros(_REST))
    device.start(voltage_v[:first])
    device.write(voltage_v[first:])
    device.finish()
    parts = [device.read(count) for count in (1, 7, 492, 500, 1)]
    readings_um = np.concatenate(parts)
    yield DeviceFinding(
        f'a stream of {size} voltages has {size + 1} readings',
        [part.size for part in parts] == [1, 7, 492, 500, 1], f'{readings_um.size}')
    yield _equal_delays('an impulse is answered as late in a stream as in a block', {
        size: block, size + 1: _delay(readings_um, size // 2)})
    device.start(np.full(size, amplitude_v))
    device.ramp_to(0.0, _SLEW * amplitude_v)
    yield _holds(device, 0.0, amplitude_v, 'a ramp that stops a stream')
    device.start(np.zeros(10))
    try:
        device.read(100)
    except Underflow as error:
        yield DeviceFinding(
            'a stream that runs dry is an Underflow with its index', error.index == 10,
            f'index {error.index}, 10 were written')
    else:
        yield DeviceFinding(
            'a stream that runs dry is an Underflow with its index', False, 'it gave readings')
    device.ramp_to(0.0, _SLEW * amplitude_v)
    yield _holds(device, 0.0, amplitude_v, 'an underflow')
