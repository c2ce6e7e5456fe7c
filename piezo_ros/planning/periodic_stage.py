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
The periodic answer of a stage to a periodic voltage, and its derivative.

    w = F u,   x = H(w),   y = B x

F and B are the sampled responses of what stands before and behind the hysteresis, exact for a
period of whole samples. H is the MRC operator in its periodic state, reached after one period. With
S the set of elements that do not slip, r_i their plays and kappa_i their compliances, (1) to (4) in
Liu 2015 give the derivative

    (1/kappa_{n+1} + sum over S of 1/kappa_i) dx = dw + sum over S of dr_i/kappa_i,   dr_i = dx

the latter for every element that slips. As long as S stays, the sum over S is constant. A map of
asymmetry behind the elements multiplies dx by its slope.

Examples
--------
A stage without poles, driven by a sine of 3 V and 400 samples; the derivative agrees with a
difference:

>>> time = 2.0 * np.pi * np.arange(400) / 400
>>> stage = PeriodicStage(gain(1.0), HysteresisParameters(), gain(1.0), 1e-5, 400)
>>> shape = np.sin(3.0 * time)[:, None]
>>> answer = stage.linearise(3.0 * np.sin(time), shape)
>>> moved_um = stage.answer(3.0 * np.sin(time) + 1e-7 * shape[:, 0])
>>> bool(np.max(np.abs((moved_um - answer.displacement_um) / 1e-7 - answer.slope[:, 0])) < 1e-4)
True

"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.model import HysteresisParameters, MaxwellResistiveCapacitor
from piezo_ros.model.state_space import (
    StateSpace,
    discretise_first_order_hold,
    discretise_zero_order_hold,
    frequency_response,
    gain,
)

__all__ = ['LinearisedAnswer', 'PeriodicStage', 'gain']

_Floats = NDArray[np.float64]


class LinearisedAnswer(NamedTuple):
    """
    The periodic displacement, and how it moves with the voltage.

    Attributes
    ----------
    displacement_um : ndarray, shape (P,)
        One period; sample k is the reading before the voltage k is given.
    slope : ndarray, shape (P, M)
        Its derivative along each direction of the voltage.

    """

    displacement_um: _Floats
    slope: _Floats


class PeriodicStage:
    """
    A stage under a periodic voltage, held from sample to sample.

    Parameters
    ----------
    before, behind : StateSpace
        What stands before the hysteresis (strictly proper, or a gain) and behind it.
    hysteresis : HysteresisParameters
        The MRC elements.
    sample_period_s : float
        Sample period, seconds.
    samples : int
        Samples P of one period (or of several, after which all repeats).
    delay_s : float, optional
        Pure delay, seconds.

    """

    def __init__(
        self, before: StateSpace, hysteresis: HysteresisParameters, behind: StateSpace,
        sample_period_s: float, samples: int, delay_s: float = 0.0,
    ) -> None:
        angle = 2.0 * np.pi * np.fft.rfftfreq(samples)
        z = np.exp(1j * angle)
        # The reading k + 1 is at the end of the time for which the voltage k is held.
        late = np.exp(-1j * angle * (delay_s / sample_period_s + bool(before.a.size)))
        self._before = frequency_response(
            discretise_zero_order_hold(before, sample_period_s), z) * (
                z if before.a.size else 1.0)
        self._behind = frequency_response(
            discretise_first_order_hold(behind, sample_period_s), z) * late
        self._operator = MaxwellResistiveCapacitor.of(hysteresis)
        # The plays move with what is before the map of asymmetry.
        self._elements = MaxwellResistiveCapacitor(
            hysteresis.kappa_um_per_v, hysteresis.saturation_v)
        self._threshold_um = np.array(hysteresis.asymmetry_threshold_um)
        self._weight = np.array(hysteresis.asymmetry_weight)
        *limited, unlimited = hysteresis.kappa_um_per_v
        self._slope_v_per_um = 1.0 / np.array(limited)
        self._unlimited_v_per_um = 1.0 / unlimited
        self._width_um = np.array(limited) * np.array(hysteresis.saturation_v)
        self.samples = samples

    @property
    def linear_response(self) -> NDArray[np.complex128]:
        """What stands before and behind the hysteresis, at the harmonics, shape (P//2 + 1,)."""
        return np.asarray(self._before * self._behind)

    def answer(self, voltage_v: _Floats) -> _Floats:
        """Return the periodic displacement, shape (P,), micrometres."""
        free_um = self._free(self._filtered(self._before, voltage_v))[self.samples:]
        return self._filtered(self._behind, free_um)

    def linearise(self, voltage_v: _Floats, directions: _Floats) -> LinearisedAnswer:
        """
        Return the periodic displacement and its derivative along directions of the voltage.

        Parameters
        ----------
        voltage_v : ndarray, shape (P,)
            One period of the voltage, deviations from the operating point.
        directions : ndarray, shape (P, M)
            Changes of the voltage, each periodic.

        """
        driving_v = self._filtered(self._before, voltage_v)
        inner_um = self._elements.forward(np.concatenate([driving_v, driving_v]))[0]
        driving = self._filtered(self._before, directions)
        slope = self._free_slope(inner_um, np.vstack([driving, driving]))[self.samples:]
        slope *= self._map_slope(inner_um[self.samples:])[:, None]
        return LinearisedAnswer(
            self._filtered(self._behind, self._free(driving_v)[self.samples:]),
            self._filtered(self._behind, slope))

    def _filtered(self, response: NDArray[np.complex128], values: _Floats) -> _Floats:
        spectrum = np.fft.rfft(values, axis=0)
        shaped = response.reshape(-1, *[1] * (values.ndim - 1))
        return np.fft.irfft(shaped * spectrum, self.samples, axis=0)

    def _free(self, driving_v: _Floats) -> _Floats:
        """Return two periods of H from the virgin state, shape (2 P,); the second one repeats."""
        return self._operator.forward(np.concatenate([driving_v, driving_v]))[0]

    def _map_slope(self, inner_um: _Floats) -> _Floats:
        """Return the slope of the map of asymmetry, 1 without one."""
        upper = self._threshold_um >= 0.0
        beyond = np.where(
            upper, inner_um[:, None] > self._threshold_um, inner_um[:, None] < self._threshold_um)
        return np.asarray(1.0 + beyond @ self._weight)

    def _free_slope(self, free_um: _Floats, driving: _Floats) -> _Floats:
        """Return the derivative of two periods of H, shape (2 P, M)."""
        slips = _slipping(free_um, self._width_um)
        changes = np.flatnonzero(np.any(slips[1:] != slips[:-1], axis=1)) + 1
        ends = [*changes.tolist(), free_um.size]
        plays = np.zeros((self._width_um.size, driving.shape[1]))
        result = np.empty_like(driving)
        start = 0
        for end in ends:
            slipping = slips[start]
            stiffness = np.where(slipping, 0.0, self._slope_v_per_um)
            result[start:end] = (driving[start:end] + stiffness @ plays) / (
                self._unlimited_v_per_um + stiffness.sum())
            plays[slipping] = result[end - 1]
            start = end
        return result


def _slipping(free_um: _Floats, width_um: _Floats) -> NDArray[np.bool_]:
    """Return which elements slip at each sample, shape (N, n)."""
    plays = np.empty((free_um.size, width_um.size))
    before = np.zeros_like(width_um)
    way = np.sign(np.diff(free_um, prepend=0.0))
    turns = np.flatnonzero(way[1:] != way[:-1]) + 1
    start = 0
    for end in [*turns.tolist(), free_um.size]:
        # From one turn to the next a play goes one way only.
        um = free_um[start:end, None]
        plays[start:end] = (
            np.maximum(before, um - width_um) if way[start] >= 0.0
            else np.minimum(before, um + width_um))
        before = plays[end - 1]
        start = end
    return np.asarray(np.diff(plays, axis=0, prepend=0.0) != 0.0)
