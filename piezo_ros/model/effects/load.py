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
What driving the stage hard does: the average current of the amplifier, and self-heating.

An amplifier gives its peak current for some milliseconds only. With the leaky mean m of the slope
of its output, of the time constant T_a, a slope s is allowed as far as m keeps its limit L::

    m <- m + (Ts/T_a)(|s| - m),   |s| <= m + (T_a/Ts)(L - m)

so that a slope up to L is allowed for ever, and s > L for about T_a ln(s/(s - L)) from rest.

A stage warms by its losses, and its gain grows with its temperature. With the speed v of the
displacement, the leaky mean h of its square, of the time constant T_h, and the growth e of the gain
at a mean square of 1 (um/ms)^2::

    h <- h + (1 - exp(-Ts/T_h)) (v^2 - h),   x <- (1 + min(e h, 1)) x

Both are off by default.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.model.parameters import ParameterSet, parameter
from piezo_ros.model.step import Vector, step

__all__ = [
    'NO_LOAD', 'STATE_SIZE', 'LoadConstants', 'LoadParameters', 'allowed_voltage',
    'average_slew', 'heat_step', 'load_constants', 'warm_step',
]

_MS_PER_S = 1e3
_MOST_GROWTH = 1.0  # of the gain: a larger one makes it warmer, which would run away
STATE_SIZE = 3  # mean step of the voltage; samples limited by it; mean square speed


@dataclass(frozen=True, kw_only=True)
class LoadParameters(ParameterSet):
    """Average current of the amplifier and self-heating of the stage."""

    average_slew_limit_v_per_s: float = parameter(
        0.0, 'V/s', 'average current limit of the amplifier over the load capacitance, at its '
        'input: mean absolute slope of the voltage that it can keep up; 0: none',
        minimum=0.0, maximum=1e9)
    average_slew_time_s: float = parameter(
        0.005, 's', 'time over which the amplifier averages its current', minimum=1e-6, maximum=1e3)
    self_heating_gain: float = parameter(
        0.0, '1/(um/ms)^2', 'relative growth of the gain at a mean square speed of 1 (um/ms)^2; 0: '
        'no self-heating', minimum=0.0, maximum=10.0)
    self_heating_time_s: float = parameter(
        0.02, 's', 'time constant with which the gain follows the mean square speed: of a real '
        'stage minutes, here so short that a run reaches its end', minimum=1e-6, maximum=1e6)


class LoadConstants(NamedTuple):
    """What the steps need of the parameters."""

    average_step_v: float  # mean absolute step in a sample; 0: no limit
    averaged_samples: float  # T_a/Ts
    gain_per_um2: float  # growth at a mean square change of 1 um in a sample
    heat_rate: float  # share of the way that the mean square goes in a sample


NO_LOAD = LoadConstants(0.0, 1.0, 0.0, 0.0)


def load_constants(parameters: LoadParameters, sample_period_s: float) -> LoadConstants | None:
    """
    Return the constants of the steps, None where there is neither limit nor self-heating.

    Parameters
    ----------
    parameters : LoadParameters
        The effects.
    sample_period_s : float
        Sample period, seconds.

    """
    p = parameters
    if p.average_slew_limit_v_per_s == 0.0 and p.self_heating_gain == 0.0:
        return None
    return LoadConstants(
        average_step_v=p.average_slew_limit_v_per_s * sample_period_s,
        averaged_samples=max(p.average_slew_time_s / sample_period_s, 1.0),
        gain_per_um2=p.self_heating_gain / (_MS_PER_S * sample_period_s) ** 2,
        heat_rate=-math.expm1(-sample_period_s / p.self_heating_time_s))


def average_slew(
    voltage_v: NDArray[np.float64], average_s: float, sample_period_s: float, *,
    from_rest: bool = False,
) -> NDArray[np.float64]:
    """
    Return the mean absolute slope of a voltage as an amplifier averages it.

    Parameters
    ----------
    voltage_v : ndarray, shape (N,)
        The voltage.
    average_s : float
        Time over which the amplifier averages, seconds.
    sample_period_s : float
        Sample period, seconds.
    from_rest : bool
        Whether the voltage stood still before its first sample, as before a motion; else it has
        been as it is on the whole, as a scan in steady state.

    Returns
    -------
    ndarray, shape (N - 1,)
        Volts per second.

    """
    from scipy.signal import lfilter  # here: every node of the loop imports this module
    slope = np.abs(np.diff(voltage_v)) / sample_period_s
    rate = min(sample_period_s / average_s, 1.0)
    mean = 0.0 if from_rest else float(slope.mean())
    return np.asarray(lfilter([rate], [1.0, rate - 1.0], slope, zi=[(1.0 - rate) * mean])[0])


@step
def allowed_voltage(
    state: Vector, constants: LoadConstants | None, before_v: float, wanted_v: float,
) -> float:
    """Return a voltage, as near as the average current allows; the mean moves on."""
    if constants is None:
        return wanted_v
    if constants.average_step_v == 0.0:
        return wanted_v
    mean_v = state[0]
    most_v = mean_v + constants.averaged_samples * (constants.average_step_v - mean_v)
    size_v = abs(wanted_v - before_v)
    if size_v > most_v:
        size_v = most_v
        wanted_v = before_v + most_v if wanted_v > before_v else before_v - most_v
        state[1] += 1.0
    state[0] = mean_v + (size_v - mean_v) / constants.averaged_samples
    return wanted_v


@step
def warm_step(
    state: Vector, constants: LoadConstants | None, displacement_um: float,
) -> float:
    """Return a displacement of the stage at its temperature."""
    if constants is None:
        return displacement_um
    return displacement_um * (1.0 + min(constants.gain_per_um2 * state[2], _MOST_GROWTH))


@step
def heat_step(
    state: Vector, constants: LoadConstants | None, before_um: float, after_um: float,
) -> None:
    """Move the mean square speed on by a sample."""
    if constants is None:
        return
    change_um = after_um - before_um
    state[2] += constants.heat_rate * (change_um * change_um - state[2])
