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
The way of the output from the voltage that it holds to another, at a limited slope.

From a to b in n = max(1, ceil(|b - a| / (slew Ts))) steps, u[k] = a + (b - a)(k + 1)/n, u[n-1] = b.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ['ramp_voltage']

_MOST_SAMPLES: Final = 100_000_000


def ramp_voltage(
    from_v: float, to_v: float, slew_v_per_s: float, sample_period_s: float,
) -> NDArray[np.float64]:
    """
    Return a straight ramp, without its starting point, which is held already.

    Parameters
    ----------
    from_v, to_v : float
        The voltage that is held, and the one to go to, volts.
    slew_v_per_s : float
        Largest slope, volts per second.
    sample_period_s : float
        Sample period, seconds.

    Returns
    -------
    ndarray of float64, shape (n,)
        The ramp; the last value is `to_v`, exactly.

    Raises
    ------
    ValueError
        If a value is not finite, the slope or the period is not positive, or the ramp would be
        longer than 10^8 samples.

    Examples
    --------
    >>> ramp_voltage(1.0, 0.0, 40.0, 0.01).tolist()
    [0.6666666666666667, 0.33333333333333337, 0.0]

    """
    for name, value in (('from_v', from_v), ('to_v', to_v)):
        if not math.isfinite(value):
            raise ValueError(f'{name} is {value}, it must be finite')
    for name, value in (('slew_v_per_s', slew_v_per_s), ('sample_period_s', sample_period_s)):
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f'{name} is {value}, it must be positive and finite')
    wanted = abs(to_v - from_v) / (slew_v_per_s * sample_period_s)
    if not wanted <= _MOST_SAMPLES:
        raise ValueError(
            f'slew_v_per_s is {slew_v_per_s} V/s: the ramp from {from_v} V to {to_v} V would have '
            f'more than {_MOST_SAMPLES} samples of {sample_period_s} s; allowed is '
            f'{abs(to_v - from_v) / (_MOST_SAMPLES * sample_period_s):g} V/s or more')
    # A step may be above the slope by rounding alone.
    samples = max(1, math.ceil(wanted * (1.0 - 1e-12)))
    voltage_v = from_v + (to_v - from_v) * (np.arange(1, samples + 1) / samples)
    voltage_v[-1] = to_v
    return voltage_v
