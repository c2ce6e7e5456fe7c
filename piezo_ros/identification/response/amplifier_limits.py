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

"""Limits of the amplifier, and the samples of a record that reach them."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ['Amplifier', 'limit_reached', 'settled_samples']

_BLOCKS: Final = 24  # a limit that is reached for a moment costs two of so many parts of a window


class Amplifier(NamedTuple):
    """
    Limits of the amplifier; infinite where unknown.

    Attributes
    ----------
    slew_limit_v_per_s : float
        Fastest change of its input, V/s.
    voltage_minimum_v, voltage_maximum_v : float
        Rails, volts; deviations from the operating point where the recorded voltage is one.

    """

    slew_limit_v_per_s: float = math.inf
    voltage_minimum_v: float = -math.inf
    voltage_maximum_v: float = math.inf


def limit_reached(
    voltage_v: NDArray[np.float64], limits: Amplifier, sample_period_s: float,
) -> tuple[str, NDArray[np.bool_]]:
    """
    Return the limit of the amplifier that a stretch reaches, in words, and at which samples.

    Parameters
    ----------
    voltage_v : ndarray, shape (N,)
        Amplifier input; samples that are not finite reach no limit.
    limits : Amplifier
        The limits.
    sample_period_s : float
        Sample period, seconds.

    Returns
    -------
    str
        The limit in words; empty for none.
    ndarray of bool, shape (N,)
        The samples at which it is reached.

    """
    voltage_v = np.where(np.isfinite(voltage_v), voltage_v, np.nan)
    slew_step_v = limits.slew_limit_v_per_s * sample_period_s
    step_v = np.abs(np.diff(voltage_v, prepend=voltage_v[:1]))
    any_reached = step_v >= slew_step_v
    reasons = []
    if any_reached.any():
        reasons.append(
            f'slews: a voltage step of {np.nanmax(step_v):.4g} V reaches the {slew_step_v:.4g} V '
            'per sample that the amplifier can')
    for sign, reaches, limit in (
        (-1.0, 'falls to', limits.voltage_minimum_v), (1.0, 'rises to', limits.voltage_maximum_v),
    ):
        reached = sign * voltage_v >= sign * limit
        if reached.any():
            value = sign * float(np.nanmax(sign * voltage_v))
            reasons.append(
                f'saturates: the voltage {reaches} {value:.4g} V, the limit is {limit:.4g} V')
            any_reached = any_reached | reached
    return reasons[0] if reasons else '', np.asarray(any_reached)


def settled_samples(reached: NDArray[np.bool_], samples_per_period: float) -> NDArray[np.bool_]:
    """
    Return the samples of a stretch in which the stage has settled after a limit was reached.

    Parameters
    ----------
    reached : ndarray of bool, shape (N,)
        The samples at which a limit is reached.
    samples_per_period : float
        Length of a period.

    Returns
    -------
    ndarray of bool, shape (N,)
        False for the parts of the stretch that are touched, and for those that follow.

    """
    block = max(math.ceil(samples_per_period), -(-reached.size // _BLOCKS))
    touched = np.unique(np.flatnonzero(reached) // block)
    # The response to what happened in one block lasts into the next.
    bad = np.isin(np.arange(reached.size) // block, np.concatenate([touched, touched + 1]))
    return np.asarray(~bad)
