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
PI gains and a lead section of least objective, within the limits of `pi_tuning`.

The lead (1 + s/wz)/(1 + s/wp) makes up for the phase of a slow pole, for instance of the sensor.
Its ratio wp/wz is given, for by that the noise of the displacement is amplified; its zero is
searched among the frequencies of the poles.
"""

import math
from typing import Any, Final

import numpy as np
from scipy.optimize import minimize_scalar

from piezo_ros.identification.tuning.linear_plant import LinearPlant, Model
from piezo_ros.identification.tuning.pi_loop import Lead
from piezo_ros.identification.tuning.pi_tuning import PiTuning, tune_pi

__all__ = ['tune_pi_with_lead']

_ZEROS: Final = 5  # that are tried before the search goes on about the best
_BELOW: Final = 0.5  # of the slowest pole, where they begin
_LOG_TOLERANCE: Final = 0.03
_SEARCHES: Final = 8  # at most


def tune_pi_with_lead(model: Model, *, ratio: float, **options: Any) -> PiTuning:
    """
    Return gains and lead section of least objective.

    Parameters
    ----------
    model : LinearDynamics, DynamicsFit or control.TransferFunction
        G(s), stable.
    ratio : float
        Pole over zero of the lead, above 1.
    **options
        As for `tune_pi`.

    Raises
    ------
    ValueError
        As from `tune_pi`, and if the ratio is out of range.

    """
    if not 1.0 < ratio <= 1e3:
        raise ValueError(f'the ratio of the lead is {ratio}, allowed is above 1 … 1000')
    found: dict[float, PiTuning | None] = {}
    refusals: list[ValueError] = []

    def objective(log_zero: float) -> float:
        if log_zero not in found:
            zero_hz = math.exp(log_zero)
            try:
                found[log_zero] = tune_pi(model, lead=Lead(zero_hz, ratio * zero_hz), **options)
            except ValueError as error:
                refusals.append(error)
                found[log_zero] = None
        tuning = found[log_zero]
        return math.inf if tuning is None else tuning.objective_after

    rates_hz = np.abs(LinearPlant.of(model).poles_rad_per_s) / (2.0 * np.pi)
    zeros = np.linspace(
        math.log(_BELOW * rates_hz.min()), math.log(max(rates_hz.max(), 2.0 * rates_hz.min())),
        _ZEROS)
    best = int(np.argmin([objective(zero) for zero in zeros.tolist()]))
    if not math.isfinite(objective(float(zeros[best]))):
        raise refusals[0]
    minimize_scalar(
        objective, bounds=(zeros[max(best - 1, 0)], zeros[min(best + 1, _ZEROS - 1)]),
        method='bounded', options={'xatol': _LOG_TOLERANCE, 'maxiter': _SEARCHES})
    tunings = [tuning for tuning in found.values() if tuning is not None]
    return min(tunings, key=lambda tuning: tuning.objective_after)
