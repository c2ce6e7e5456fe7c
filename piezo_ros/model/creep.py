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
Creep and drift: the slow motion of a piezo stage beside its hysteresis.

After a step of the displacement x at time 0, creep adds the same share c in every tenfold time::

    y(10 t) - y(t) = c x,   t_start < t < t_end / 10

The operator is linear, r relaxations with time constants spread evenly over the logarithm of time::

    p_j <- p_j + (1 - exp(-Ts / tau_j)) (x - p_j)
    tau_j = t_start q^(j + 1/2),   j = 0 ... r - 1,   q = (t_end / t_start)^(1/r)
    y = x + c log10(q) (p_0 + ... + p_{r-1})

Its inverse is exact, as x is in every new p_j in proportion: with s = c log10(q) and the rate
g_j = 1 - exp(-Ts/tau_j),

    x = (y - s sum_j (1 - g_j) p_j)/(1 + s sum_j g_j)

Drift, as of a rig that warms up, has a constant rate v whatever the voltage: y[k] = x[k] + v k Ts.
Both are off by default.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from piezo_ros.model.parameters import ParameterError, ParameterSet, parameter
from piezo_ros.model.step import Vector, step

__all__ = [
    'NO_CREEP', 'CreepConstants', 'CreepParameters', 'DriftParameters', 'creep_constants',
    'creep_step', 'drift_step', 'inverse_creep_step',
]

# So dense that the growth is even to a hundredth of itself.
_PER_DECADE = 2


@dataclass(frozen=True, kw_only=True)
class CreepParameters(ParameterSet):
    """Creep of a stage."""

    creep_per_decade: float = parameter(
        0.0, '', 'share of the displacement that a constant voltage adds in every tenfold time; '
        '0: no creep', minimum=0.0, maximum=1.0)
    creep_start_s: float = parameter(
        0.1, 's', 'time after a step at which creep begins', minimum=1e-6, maximum=1e6)
    creep_end_s: float = parameter(
        1000.0, 's', 'time after a step at which creep ends', minimum=1e-6, maximum=1e9)

    def check_together(self) -> None:
        """Refuse creep that ends before it begins."""
        super().check_together()
        if not self.creep_start_s < self.creep_end_s:
            raise ParameterError(
                f'creep_start_s is {self.creep_start_s} s, it must be below creep_end_s '
                f'{self.creep_end_s} s')


@dataclass(frozen=True, kw_only=True)
class DriftParameters(CreepParameters):
    """Creep and drift of a stage."""

    drift_um_per_s: float = parameter(
        0.0, 'um/s', 'drift of the displacement; 0: none', minimum=-1e3, maximum=1e3)


class CreepConstants(NamedTuple):
    """What the steps need of the parameters; lists in a node, arrays in a kernel."""

    share: Vector  # (r,) of the displacement, for each relaxation
    rate: Vector  # (r,) share of the way that it goes in a sample
    drift_um: float  # per sample


NO_CREEP = CreepConstants([], [], 0.0)


def creep_constants(
    parameters: CreepParameters, sample_period_s: float, substeps: int = 1,
) -> CreepConstants | None:
    """
    Return the constants of the steps, None where there is neither creep nor drift.

    For None the compiler leaves the code out; for empty lists it could not.

    Parameters
    ----------
    parameters : CreepParameters
        Creep and drift.
    sample_period_s : float
        Sample period, seconds.
    substeps : int, optional
        Into how many steps a sample is divided for the creep; drift has one.

    Examples
    --------
    A stage that creeps by 2 % a decade, from 1 s to 10 s after a step to 1 um:

    >>> constants = creep_constants(CreepParameters(creep_per_decade=0.02), 0.01)
    >>> relaxed_um = [0.0] * len(constants.rate)
    >>> crept_um = [creep_step(relaxed_um, constants, 1.0) for _ in range(1000)]
    >>> round(crept_um[999] - crept_um[99], 3)
    0.02

    """
    p = parameters
    drift_um_per_s = p.drift_um_per_s if isinstance(p, DriftParameters) else 0.0
    if p.creep_per_decade == 0.0 and drift_um_per_s == 0.0:
        return None
    count = 0
    if p.creep_per_decade > 0.0:
        decades = math.log10(p.creep_end_s / p.creep_start_s)
        count = max(round(_PER_DECADE * decades), 1)
    ratio = (p.creep_end_s / p.creep_start_s) ** (1.0 / max(count, 1))
    # Each stands in the middle of its part of the range.
    times_s = [p.creep_start_s * ratio ** (i + 0.5) for i in range(count)]
    return CreepConstants(
        share=[p.creep_per_decade * math.log10(ratio)] * count,
        rate=[-math.expm1(-sample_period_s / substeps / time_s) for time_s in times_s],
        drift_um=drift_um_per_s * sample_period_s)


@step
def creep_step(
    relaxed_um: Vector, constants: CreepConstants | None, displacement_um: float,
) -> float:
    """Return a displacement with its creep; the relaxations in ``relaxed_um`` move on."""
    if constants is None:
        return displacement_um
    crept_um = displacement_um
    for i in range(len(constants.rate)):
        relaxed_um[i] += constants.rate[i] * (displacement_um - relaxed_um[i])
        crept_um += constants.share[i] * relaxed_um[i]
    return crept_um


@step
def inverse_creep_step(
    relaxed_um: Vector, constants: CreepConstants | None, displacement_um: float,
) -> float:
    """Return what becomes a displacement by its creep; the relaxations move on."""
    if constants is None:
        return displacement_um
    remembered_um = 0.0
    at_once = 1.0
    for i in range(len(constants.rate)):
        remembered_um += constants.share[i] * (1.0 - constants.rate[i]) * relaxed_um[i]
        at_once += constants.share[i] * constants.rate[i]
    still_um = (displacement_um - remembered_um) / at_once
    for i in range(len(constants.rate)):
        relaxed_um[i] += constants.rate[i] * (still_um - relaxed_um[i])
    return still_um


@step
def drift_step(
    drift_um: Vector, constants: CreepConstants | None, displacement_um: float,
) -> float:
    """Return a displacement with the drift at the end of the sample, which moves on."""
    if constants is None or constants.drift_um == 0.0:
        return displacement_um
    drift_um[0] += constants.drift_um
    return displacement_um + drift_um[0]
