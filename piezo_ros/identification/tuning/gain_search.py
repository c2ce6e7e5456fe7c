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
The search for PI gains of least objective within limits of robustness.

The search is over kP = g, kI = r g. Along a ray of fixed r the limits are kept from g = 0 up to
some g, which is found by bisection; so every candidate is stable and within the limits, and no
derivatives are needed.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from piezo_ros.identification.tuning.linear_plant import Bound, bound_magnitude
from piezo_ros.identification.tuning.loop_evidence import LoopEvidence
from piezo_ros.identification.tuning.pi_loop import PiLoop

__all__ = ['GainSearch']

# Rays from mostly proportional to all but purely integral, over the start's kI/kP.
_RAYS: Final = np.geomspace(1e-2, 1e4, 25)
_SHARES: Final = np.geomspace(1e-2, 1.0, 13)  # of the largest gain along a ray
_LARGEST_GAIN: Final = 1e3  # over the gain of the start; the search ends there
_SMALLEST_GAIN: Final = 1e-6
_BISECTIONS: Final = 24
_INTEGRAL_SHARE: Final = 0.3  # least kI/kP over the frequency where |S| = 1
_LOG_TOLERANCE: Final = 1e-5

_Complexes = NDArray[np.complex128]


class GainSearch:
    """The search for the gains of least objective within the limits."""

    def __init__(
        self, loop: PiLoop, bound: Bound | None, max_sensitivity: float, uncertainty_limit: float,
        typical_gain: float, evidence: LoopEvidence | None = None,
    ) -> None:
        self.loop = loop
        self._limits = (max_sensitivity, uncertainty_limit)
        self._typical_gain = typical_gain
        self._evidence = evidence
        # A grid that includes the lowest frequencies of any loop in the search.
        self._frequency_hz = loop.with_gains(
            typical_gain * _SMALLEST_GAIN, typical_gain).frequencies_hz()
        self._plant = loop.plant_response(self._frequency_hz) * loop.measurement_response(
            self._frequency_hz)
        without_lead = replace(loop, lead=None, proportional_gain=0.0)
        self._integral = without_lead.controller_response(self._frequency_hz)
        if loop.lead:
            self._plant *= loop.lead.response(self._frequency_hz, loop.sample_period_s)
        self._bound = (
            None if bound is None else bound_magnitude(bound, self._frequency_hz))
        self._step_s = loop.sample_period_s or 1.0 / float(
            np.abs(loop.plant.poles_rad_per_s).max())

    def feedback_band_s(self, loop: PiLoop) -> float:
        """
        Return one over the frequency below which |S| < 1, with the gains of a loop.

        It counts as lower by what kI falls short of its least share.
        """
        excess = np.abs(1.0 / (1.0 + self._open_loop(
            loop.proportional_gain, loop.integral_gain_per_s))) - 1.0
        above = np.flatnonzero(excess > 0.0)
        first = max(int(above[0]), 1) if above.size else excess.size - 1
        band_hz = float(np.interp(
            0.0, excess[first - 1:first + 1], self._frequency_hz[first - 1:first + 1]))
        least_per_s = _INTEGRAL_SHARE * 2.0 * math.pi * band_hz * loop.proportional_gain
        return max(1.0, least_per_s / loop.integral_gain_per_s) / band_hz

    def _open_loop(self, proportional_gain: float, integral_gain_per_s: float) -> _Complexes:
        return np.asarray((proportional_gain + integral_gain_per_s * self._integral) * self._plant)

    def allows(self, proportional_gain: float, integral_gain_per_s: float) -> bool:
        """Return whether a loop is stable and within its limits."""
        open_loop = self._open_loop(proportional_gain, integral_gain_per_s)
        sensitivity = 1.0 / (1.0 + open_loop)
        if np.abs(sensitivity).max() >= self._limits[0]:
            return False
        evidence = self._evidence
        if evidence is not None:
            if evidence.model_error is not None and evidence.band_sensitivity(
                    self._frequency_hz, open_loop).max() >= self._limits[0]:
                return False
            if (evidence.largest_on_points(self.loop.with_gains(
                    proportional_gain, integral_gain_per_s)) or 0.0) >= self._limits[0]:
                return False
        if self._bound is not None:
            if (self._bound * np.abs(open_loop * sensitivity)).max() >= self._limits[1]:
                return False
        return self.loop.with_gains(
            proportional_gain, integral_gain_per_s).slowest_decay(self._step_s) < 1.0

    def largest(self, ratio_per_s: float) -> float:
        """Return the largest kP along kI = ratio kP within the limits; 0 if there is none."""
        # Along a ray of large kI/kP the integral gain reaches the limits first.
        scale = self._typical_gain / (1.0 + ratio_per_s * self._time_s())
        low, high = math.log(scale * _SMALLEST_GAIN), math.log(scale * _LARGEST_GAIN)
        if not self._allows_ray(low, ratio_per_s):
            return 0.0
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            if self._allows_ray(middle, ratio_per_s):
                low = middle
            else:
                high = middle
        return math.exp(low)

    def _time_s(self) -> float:
        """Return the mean time constant of the plant, to compare kI with kP."""
        rates = np.abs(self.loop.plant.poles_rad_per_s)
        return float(1.0 / np.exp(np.mean(np.log(rates))))

    def _allows_ray(self, log_gain: float, ratio_per_s: float) -> bool:
        gain = math.exp(log_gain)
        return self.allows(gain, gain * ratio_per_s)

    def refusal(self) -> str:
        """Return the reason why no gains are within the limits."""
        slow = 'no gains, however small, are within the limits'
        if self._bound is not None and self._bound[0] >= self._limits[1]:
            return (
                f'{slow}: |W| is {self._bound[0]:.4g} at low frequencies, where |T| is 1, and '
                f'uncertainty_limit is {self._limits[1]:.4g}')
        return f'{slow} max_sensitivity {self._limits[0]:g}, uncertainty_limit {self._limits[1]:g}'

    def best(
        self, ratio_per_s: float, evaluate: Callable[[PiLoop], float],
    ) -> tuple[float, float]:
        """Return the gains of the smallest objective; rays are searched around the given one."""
        found: dict[float, tuple[float, float]] = {}

        def along(log_ratio: float) -> float:
            if log_ratio not in found:
                found[log_ratio] = self._best_of_ray(math.exp(log_ratio), evaluate)
            return found[log_ratio][1]

        rays = np.log(_RAYS * ratio_per_s)
        values = [along(ray) for ray in rays.tolist()]
        best = int(np.argmin(values))
        if not math.isfinite(values[best]):
            raise ValueError(self.refusal())
        minimize_scalar(
            along, bounds=(rays[max(best - 1, 0)], rays[min(best + 1, rays.size - 1)]),
            method='bounded', options={'xatol': _LOG_TOLERANCE})
        log_ratio = min(found, key=lambda ray: found[ray][1])
        gain = found[log_ratio][0]
        return gain, gain * math.exp(log_ratio)

    def _best_of_ray(
        self, ratio_per_s: float, evaluate: Callable[[PiLoop], float],
    ) -> tuple[float, float]:
        """Return the best kP of a ray and the objective."""
        largest = self.largest(ratio_per_s)
        if largest == 0.0:
            return 0.0, math.inf

        def value(log_share: float) -> float:
            gain = largest * math.exp(log_share)
            return evaluate(self.loop.with_gains(gain, gain * ratio_per_s))

        shares = np.log(_SHARES)
        values = [value(share) for share in shares.tolist()]
        best = int(np.argmin(values))
        refined = minimize_scalar(
            value, bounds=(shares[max(best - 1, 0)], shares[min(best + 1, shares.size - 1)]),
            method='bounded', options={'xatol': _LOG_TOLERANCE})
        log_share = float(refined.x) if refined.fun < values[best] else float(shares[best])
        return largest * math.exp(log_share), min(float(refined.fun), values[best])
