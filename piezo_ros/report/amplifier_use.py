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
Samples at which the amplifier could not follow the voltage that it was asked for.

With the voltage u asked for, what the D/A converter makes of it inside the rails, DA(u), and the
slew limit, the amplifier follows by::

    d[k] = d[k-1] + clip(DA(u[k]) - d[k-1], -slew Ts, slew Ts)

as `piezo_ros.model.rig` does; here only the samples are counted at which a limit counts.
"""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.hardware.limits import DriveLimits
from piezo_ros.model import ParameterError, RigParameters

__all__ = ['AmplifierLimits', 'amplifier_limits', 'limited_samples']

_NEEDED: Final = ('voltage_minimum_v', 'voltage_maximum_v', 'operating_point_v')


class AmplifierLimits(NamedTuple):
    """
    Rails, slew limit and D/A converter of an amplifier.

    Attributes
    ----------
    minimum_v, maximum_v : float
        Rails, deviations from the operating point, volts.
    slew_limit_v_per_s : float or None
        Slew limit, V/s; 0 for none, None where it is not known.
    resolution_v : float
        Step of the D/A converter, volts; 0 for an ideal one.
    operating_point_v : float
        Absolute voltage of zero deviation, volts.

    """

    minimum_v: float
    maximum_v: float
    slew_limit_v_per_s: float | None
    resolution_v: float
    operating_point_v: float


def amplifier_limits(plant: Mapping[str, Any]) -> AmplifierLimits | None:
    """
    Return the limits of the amplifier of a plant.

    Parameters
    ----------
    plant : mapping of str to value
        Parameters of the plant or of the hardware plant, as a bag has them.

    Returns
    -------
    AmplifierLimits or None
        None where the parameters do not tell the rails, as those of a foreign plant.

    """
    if any(name not in plant for name in _NEEDED):
        return None
    try:
        if 'device' in plant:
            drive = DriveLimits.among(plant)
            # 0 of a real amplifier means that its limit was not told.
            return _limits(drive, drive.slew_limit_v_per_s or None, 0.0)
        rig = RigParameters.among(plant)
    except ParameterError:  # of a foreign plant
        return None
    resolution_v = rig.dac_span_v / 2.0**rig.dac_bits if rig.dac_bits else 0.0
    return _limits(rig, rig.slew_limit_v_per_s, resolution_v)


def _limits(
    of: DriveLimits | RigParameters, slew_limit_v_per_s: float | None, resolution_v: float,
) -> AmplifierLimits:
    point_v = of.operating_point_v
    return AmplifierLimits(
        of.voltage_minimum_v - point_v, of.voltage_maximum_v - point_v, slew_limit_v_per_s,
        resolution_v, point_v)


def limited_samples(
    voltage_v: NDArray[np.float64], limits: AmplifierLimits, sample_period_s: float,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """
    Return the samples at which the amplifier is at its rails, and those at which it slews.

    Parameters
    ----------
    voltage_v : ndarray, shape (N,)
        Voltage asked for, deviations from the operating point; the amplifier is taken to be at the
        first one.
    limits : AmplifierLimits
        The limits.
    sample_period_s : float
        Sample period, seconds.

    Returns
    -------
    at_rails, slewing : ndarray of bool, shape (N,)
        Samples beyond a rail, and samples at which the amplifier is behind by the slew limit.

    """
    at_rails = (voltage_v < limits.minimum_v) | (voltage_v > limits.maximum_v)
    slewing = np.zeros(voltage_v.size, dtype=np.bool_)
    step_v = (limits.slew_limit_v_per_s or 0.0) * sample_period_s
    if not step_v:
        return at_rails, slewing
    asked_v = voltage_v
    if limits.resolution_v:
        point_v, resolution_v = limits.operating_point_v, limits.resolution_v
        asked_v = np.floor((voltage_v + point_v) / resolution_v + 0.5) * resolution_v - point_v
    asked_v = np.clip(asked_v, limits.minimum_v, limits.maximum_v)
    following = 0
    for first in np.flatnonzero(np.abs(np.diff(asked_v)) > step_v).tolist():
        if first < following:
            continue  # the amplifier was still behind
        driven_v = float(asked_v[first])
        following = first + 1
        while following < asked_v.size:
            missing_v = float(asked_v[following]) - driven_v
            if abs(missing_v) <= step_v:
                break
            slewing[following] = True
            driven_v += step_v if missing_v > 0.0 else -step_v
            following += 1
    return at_rails, slewing
