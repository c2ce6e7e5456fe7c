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
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.hardware.device import Device, DeviceError, Underflow

__all__ = ['DeviceFinding', 'check_device']

_REST: Final = 40  # samples before an impulse in which a wrong device may answer it already
_AROUND: Final = 400  # samples before an impulse, and behind it, that are compared
_MOST_SHIFT: Final = 30
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
    released: Callable[[], AbstractContextManager[None]] = nullcontext,
) -> Iterator[DeviceFinding]:
    """
    Check a device that nothing else uses; whatever happens, its output is left at rest.

    Parameters
    ----------
    device : Device
        The device, not open yet. Its output is driven.
    sample_period_s : float
        Sample period, seconds.
    amplitude_v : float
        How far from zero deviation the output is driven, volts.
    released : callable, optional
        Returns the context of what a stop signal may cut off; no ramp to rest is within.

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
        yield from _checks(device, sample_period_s, amplitude_v, released)
    except DeviceError as error:
        before = f'; before that {_named(error.__context__)}' if error.__context__ else ''
        yield DeviceFinding(
            'it does what the protocol asks for', False, f'{_named(error)}{before}')
    finally:
        device.close()
    device.close()
    yield DeviceFinding('it can be closed twice', True, '')


def _checks(
    device: Device, sample_period_s: float, amplitude_v: float,
    released: Callable[[], AbstractContextManager[None]],
) -> Iterator[DeviceFinding]:
    period_s = device.open(sample_period_s)
    try:
        with released():
            yield DeviceFinding(
                'it opens at the sample period', abs(period_s / sample_period_s - 1.0) <= 1e-9,
                f'{period_s!r} s')
            yield from _driven(device, amplitude_v)
    finally:
        device.ramp_to(0.0, _SLEW * amplitude_v)


def _driven(device: Device, amplitude_v: float) -> Iterator[DeviceFinding]:
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


def _named(error: BaseException) -> str:
    return f'{type(error).__name__}: {error}'


def _alignment(device: Device, amplitude_v: float) -> Iterator[DeviceFinding]:
    """Check that an impulse is answered equally late whatever the block around it."""
    most = device.constraints.most_samples or max(_BLOCKS)
    answers: dict[str, NDArray[np.float64]] = {}
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
        if size > 2 * _AROUND and readings_um.size == size + 1:
            answers[f'a block of {size}'] = _around(readings_um, size // 2)
    yield _equally_late('an impulse is answered equally late in every block', answers)


def _around(readings_um: NDArray[np.float64], at: int) -> NDArray[np.float64]:
    """Return the readings around an impulse, which is at `_AROUND`."""
    return readings_um[at - _AROUND:at + _AROUND]


def _equally_late(what: str, answers: dict[str, NDArray[np.float64]]) -> DeviceFinding:
    """Compare the answers to one impulse, which a slow or noisy stage spreads over samples."""
    if len(answers) < 2:
        return DeviceFinding(what, None, 'its blocks are too short for that')
    centred = {
        name: answer - answer[:_AROUND - _REST].mean() for name, answer in answers.items()}
    noise_um = max(float(answer[:_AROUND - _REST].std()) for answer in centred.values())
    reference_name, reference_um = next(iter(centred.items()))
    # What is left of an answer where it is taken for that of one sample before.
    change_um = _rms(np.diff(reference_um[_AROUND:]))
    if not change_um > _SIGMAS / 2.0 * noise_um:
        return DeviceFinding(
            what, None, f'a sample more or less changes the answer by {change_um:.2g} um rms, '
            f'which the noise of {noise_um:.2g} um hides; take a larger amplitude')
    late = [
        f'{name} comes {shift} samples after {reference_name}' for name, answer_um in
        centred.items() if (shift := _shift(reference_um, answer_um, noise_um))]
    mean_um = np.mean(list(centred.values()), axis=0)
    threshold_um = max(_SIGMAS / 2.0 * noise_um, _OF_PEAK * float(np.abs(mean_um).max()))
    first = int(np.flatnonzero(np.abs(mean_um) > threshold_um)[0]) - _AROUND
    detail = '; '.join(late) or f'it shows after {first} samples'
    return DeviceFinding(what, not late and first >= 1, detail)


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _shift(
    reference: NDArray[np.float64], other: NDArray[np.float64], noise_um: float,
) -> int:
    """Return how many samples one answer is behind another, 0 where noise explains the rest."""
    inner = slice(_MOST_SHIFT, -_MOST_SHIFT)
    if _rms((other - reference)[inner]) <= _SIGMAS / 2.0 * noise_um:
        return 0
    left = {
        shift: _rms((np.roll(other, -shift) - reference)[inner])
        for shift in range(-_MOST_SHIFT, _MOST_SHIFT + 1)}
    best = min(left, key=left.__getitem__)
    # Two answers of a stage with hysteresis differ a little wherever they are put.
    return best if left[best] < left[0] / 2.0 else 0


def _streams(device: Device, amplitude_v: float) -> Iterator[DeviceFinding]:
    size, first = 1000, 300
    voltage_v = np.zeros(size)
    voltage_v[size // 2] = amplitude_v
    block_um = np.asarray(device.play(voltage_v))
    device.play(np.zeros(_REST))
    device.start(voltage_v[:first])
    device.write(voltage_v[first:])
    device.finish()
    parts = [device.read(count) for count in (1, 7, 492, 500, 1)]
    readings_um = np.concatenate(parts)
    yield DeviceFinding(
        f'a stream of {size} voltages has {size + 1} readings',
        [part.size for part in parts] == [1, 7, 492, 500, 1], f'{readings_um.size}')
    if block_um.size == readings_um.size == size + 1:
        yield _equally_late('an impulse is answered as late in a stream as in a block', {
            'the block': _around(block_um, size // 2),
            'the stream': _around(readings_um, size // 2)})
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
