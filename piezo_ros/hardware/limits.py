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
What a block of voltages must keep to before it goes out: pure functions of the block.

With the voltage u[-1] that the output holds before it, all of them voltages at the input of an
amplifier of gain A in front of a load of capacitance C (large signal, about 1.7 times the value of
the data sheet)::

    slew              max |u[k] - u[k-1]| / Ts
    peak current      C A max |u[k] - u[k-1]| / Ts
    average current   C A max over k of  sum max(+-(u[i] - u[i-1]), 0) / (n Ts),   i = k-n+1 ... k

The average is that of the current which the amplifier sources, or sinks if that is more, over a
window of n Ts seconds. Before the block nothing flows: a block shorter than the window has a
smaller average than a scan that goes on like it. An amplifier gives more than its average for some
milliseconds only, so the window is not to be much longer than a few periods of a scan.

A continuous sine of peak-to-peak voltage U asks for the peak pi f C A U and the average f C A U, a
triangle for the peak 2 f C A U.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.hardware.device import Refused
from piezo_ros.model.effects.operating_point import check_operating_point
from piezo_ros.model.parameters import ParameterSet, parameter

__all__ = [
    'BlockFigure',
    'DriveLimits',
    'average_current',
    'block_figures',
    'peak_current',
    'rails',
    'refuse_beyond_limits',
    'refuse_beyond_rails',
    'slew',
    'travel',
]


@dataclass(frozen=True, kw_only=True)
class DriveLimits(ParameterSet):
    """What amplifier and stage allow."""

    operating_point_v: float = parameter(
        5.0, 'V', 'amplifier input at zero deviation', minimum=-1e3, maximum=1e3)
    operating_point_um: float = parameter(
        6.0, 'um', 'displacement at zero deviation', minimum=-1e4, maximum=1e4)
    voltage_minimum_v: float = parameter(
        -2.0, 'V', 'lowest amplifier input', minimum=-1e3, maximum=1e3)
    voltage_maximum_v: float = parameter(
        10.0, 'V', 'highest amplifier input', minimum=-1e3, maximum=1e3)
    travel_um: float = parameter(
        12.0, 'um', 'travel of the stage, from 0', minimum=1e-3, maximum=1e5)
    gain_um_per_v: float = parameter(
        0.0, 'um/V', 'displacement for each volt at the amplifier input, largest slope, for the '
        'check of the travel; 0: not checked', minimum=0.0, maximum=1e5)
    slew_limit_v_per_s: float = parameter(
        0.0, 'V/s', 'largest slope of the amplifier input; 0: not checked', minimum=0.0,
        maximum=1e9)
    load_capacitance_f: float = parameter(
        0.0, 'F', 'large-signal capacitance of the actuator; 0: unknown, no current is checked',
        minimum=0.0, maximum=1.0)
    amplifier_gain: float = parameter(
        10.0, 'V/V', 'voltage gain of the amplifier', minimum=1e-3, maximum=1e4)
    peak_current_a: float = parameter(
        0.12, 'A', 'peak current of the amplifier', minimum=1e-9, maximum=1e3)
    average_current_a: float = parameter(
        0.06, 'A', 'average current of the amplifier', minimum=1e-9, maximum=1e3)
    average_current_window_s: float = parameter(
        0.02, 's', 'time that the average current is taken over', minimum=1e-6, maximum=1e3)

    def check_together(self) -> None:
        """Refuse an operating point outside the rails or the travel."""
        check_operating_point(self)


@dataclass(frozen=True)
class BlockFigure:
    """
    One figure of a block and what it may be.

    Attributes
    ----------
    name, unit : str
        What it is, and its unit.
    value : float
        The value that is nearest to the limit or farthest beyond it.
    lowest, highest : float
        The allowed range.
    sample : int
        k of that value; for an average, of the end of its window.

    """

    name: str
    unit: str
    value: float
    lowest: float
    highest: float
    sample: int

    @property
    def is_allowed(self) -> bool:
        """Whether it is within its range; NaN is not."""
        return self.lowest <= self.value <= self.highest

    @property
    def range_text(self) -> str:
        """The allowed range in words."""
        if self.lowest == 0.0:
            return f'at most {self.highest:g} {self.unit}'
        return f'{self.lowest:g} … {self.highest:g} {self.unit}'


def rails(voltage_v: NDArray[np.float64], limits: DriveLimits) -> BlockFigure:
    """Return the most extreme voltage at the amplifier input, of a block of shape (N,)."""
    point_v = limits.operating_point_v
    return _worst(
        'amplifier input', 'V', voltage_v + point_v, limits.voltage_minimum_v,
        limits.voltage_maximum_v)


def travel(voltage_v: NDArray[np.float64], limits: DriveLimits) -> BlockFigure:
    """Return the most extreme displacement that the gain predicts, of a block of shape (N,)."""
    return _worst(
        'displacement', 'um', limits.operating_point_um + limits.gain_um_per_v * voltage_v, 0.0,
        limits.travel_um)


def slew(
    voltage_v: NDArray[np.float64], held_v: float, sample_period_s: float, limit_v_per_s: float,
) -> BlockFigure:
    """Return the largest slope of a block of shape (N,), the step from what is held included."""
    return _largest(
        'slew', 'V/s', np.abs(_steps(voltage_v, held_v)) / sample_period_s, limit_v_per_s)


def peak_current(
    voltage_v: NDArray[np.float64], held_v: float, sample_period_s: float, limits: DriveLimits,
) -> BlockFigure:
    """Return the peak current of a block of shape (N,), amperes."""
    charge_c = _charge(voltage_v, held_v, limits)
    return _largest(
        'peak current', 'A', np.abs(charge_c) / sample_period_s, limits.peak_current_a)


def average_current(
    voltage_v: NDArray[np.float64], held_v: float, sample_period_s: float, limits: DriveLimits,
) -> BlockFigure:
    """Return the largest sliding average of the current of a block of shape (N,), amperes."""
    charge_c = _charge(voltage_v, held_v, limits)
    window = max(1, round(limits.average_current_window_s / sample_period_s))
    current_a = np.maximum(
        *(_sliding_sum(np.maximum(sign * charge_c, 0.0), window) for sign in (1.0, -1.0))
    ) / (window * sample_period_s)
    return _largest('average current', 'A', current_a, limits.average_current_a)


def block_figures(
    voltage_v: ArrayLike, held_v: float, sample_period_s: float, limits: DriveLimits,
) -> list[BlockFigure]:
    """
    Return every figure of a block that the limits know a limit of.

    Parameters
    ----------
    voltage_v : array_like, shape (N,)
        The block, deviations from the operating point, volts.
    held_v : float
        The voltage that the output holds before it, volts.
    sample_period_s : float
        Sample period, seconds.
    limits : DriveLimits
        What amplifier and stage allow.

    Raises
    ------
    Refused
        If a voltage is not finite, or the block is empty.

    """
    block_v = refuse_beyond_rails('output', 'voltage_v', voltage_v, -math.inf, math.inf)
    if not math.isfinite(held_v):
        raise Refused(f'output: held_v is {held_v}, it must be finite')
    return [*_figures(block_v, held_v, sample_period_s, limits)]


def refuse_beyond_limits(
    voltage_v: ArrayLike, held_v: float, sample_period_s: float, limits: DriveLimits,
) -> None:
    """
    Refuse a block that amplifier or stage cannot take; parameters as of `block_figures`.

    Raises
    ------
    Refused
        Names every figure that is beyond its limit, its sample, value and allowed range.

    Examples
    --------
    >>> refuse_beyond_limits([0.0, 0.3], 0.0, 1e-3, DriveLimits(slew_limit_v_per_s=100.0))
    Traceback (most recent call last):
    piezo_ros.hardware.device.Refused: sample 1: slew is 300 V/s, allowed is at most 100 V/s

    """
    beyond = [
        f'sample {figure.sample}: {figure.name} is {figure.value:.4g} {figure.unit}, allowed is '
        f'{figure.range_text}'
        for figure in block_figures(voltage_v, held_v, sample_period_s, limits)
        if not figure.is_allowed]
    if beyond:
        raise Refused('; '.join(beyond))


def refuse_beyond_rails(
    device: str, name: str, voltage_v: ArrayLike, lowest_v: float, highest_v: float,
) -> NDArray[np.float64]:
    """
    Return a block as an array, shape (N,), if every voltage of it is finite and within the rails.

    Parameters
    ----------
    device, name : str
        The device and what the caller calls the block, for the message.
    voltage_v : array_like, shape (N,)
        The block, volts; N is 1 or more.
    lowest_v, highest_v : float
        Rails, volts.

    Raises
    ------
    Refused
        Names the first sample that is not allowed, its value and the range.

    """
    block_v = np.ascontiguousarray(voltage_v, dtype=np.float64)
    if block_v.ndim != 1 or not block_v.size:
        raise Refused(
            f'{device}: {name} has shape {block_v.shape}, it must be one-dimensional and not empty')
    # NaN is on neither side.
    allowed = np.isfinite(block_v) & (block_v >= lowest_v) & (block_v <= highest_v)
    if not allowed.all():
        first = int(np.argmin(allowed))
        span = f'{lowest_v:g} … {highest_v:g} V' if math.isfinite(highest_v) else 'any finite value'
        raise Refused(f'{device}: {name}[{first}] is {block_v[first]} V, allowed is {span}')
    return block_v


def _figures(
    block_v: NDArray[np.float64], held_v: float, sample_period_s: float, limits: DriveLimits,
) -> Iterator[BlockFigure]:
    yield rails(block_v, limits)
    if limits.gain_um_per_v:
        yield travel(block_v, limits)
    if limits.slew_limit_v_per_s:
        yield slew(block_v, held_v, sample_period_s, limits.slew_limit_v_per_s)
    if limits.load_capacitance_f:
        yield peak_current(block_v, held_v, sample_period_s, limits)
        yield average_current(block_v, held_v, sample_period_s, limits)


def _steps(voltage_v: NDArray[np.float64], held_v: float) -> NDArray[np.float64]:
    return np.diff(voltage_v, prepend=held_v)


def _charge(
    voltage_v: NDArray[np.float64], held_v: float, limits: DriveLimits,
) -> NDArray[np.float64]:
    """Return the charge that each step brings to the load, coulombs."""
    return limits.load_capacitance_f * limits.amplifier_gain * _steps(voltage_v, held_v)


def _sliding_sum(values: NDArray[np.float64], window: int) -> NDArray[np.float64]:
    """Return the sum of each value and those before it in the window."""
    total = np.cumsum(values)
    total[window:] -= total[:-window].copy()
    return total


def _largest(
    name: str, unit: str, values: NDArray[np.float64], highest: float,
) -> BlockFigure:
    sample = int(np.argmax(values))
    # The limit itself is allowed, whatever rounding makes of it.
    allowed = highest * (1.0 + 1e-9)
    value = float(values[sample])
    return BlockFigure(name, unit, min(value, highest) if value <= allowed else value, 0.0,
                       highest, sample)


def _worst(
    name: str, unit: str, values: NDArray[np.float64], lowest: float, highest: float,
) -> BlockFigure:
    """Return the value that is nearest to the ends of the range, or farthest beyond them."""
    sample = int(np.argmax(np.abs(values - 0.5 * (lowest + highest))))
    return BlockFigure(name, unit, float(values[sample]), lowest, highest, sample)
