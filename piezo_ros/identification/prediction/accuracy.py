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
How far the models of a prediction are known, and what that leaves open of a predicted error.

Identification writes what it knows of its own errors: the residual of the hysteresis with its
distribution over amplitudes, the relative error of the dynamics and up to where they hold. With the
residual r of the loops of the scan's amplitude, which has the shares p_k of the orders of the scan,
passes the dynamics behind the hysteresis and is lessened by feedback, the part of the error that is
due to the hysteresis is::

    rms = r sqrt(sum_k p_k |S G/G(0)|^2(k f))

Where identification does not tell the shares they are those of 1/k at k = 1, 3, ... 9.

and without integral feedback the offset of the loops besides, as the root of the sum of squares.

Of the predicted error, known part E0, parts of the dynamics Ed and of the hysteresis Eh::

    NRMSE = sqrt(E0^2 + Ed^2 + Eh^2)
    low   = 0.9 sqrt(max(min E0 - Ed, 0)^2 + (Eh/1.7)^2)
    high  = 1.1 sqrt((max E0 + Ed)^2 + (1.7 Eh)^2)

over all places of the hysteresis among the poles that are possible. The phase of Ed is not known:
it may add to E0 or take away from it. The residual of a scan is that of the record within a factor
of 1.7, a simulated run that of the stage within 10 %.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ['ErrorInterval', 'ModelAccuracy', 'error_interval']

_SPREAD: Final = 1.7  # of the residual from record to scan
_SIMULATED: Final = 0.1  # relative, of a simulated run

_UNKNOWN_SHARES: Final = tuple((1.0 / np.arange(1, 10) ** 2 * (np.arange(1, 10) % 2)).tolist())

_Floats = NDArray[np.float64]


class ErrorInterval(NamedTuple):
    """Where the error of a run is expected, percent; no highest value where a part is unknown."""

    low_percent: float
    high_percent: float | None

    def __str__(self) -> str:
        high = '?' if self.high_percent is None else f'{self.high_percent:.2f}'
        return f'{self.low_percent:.2f}…{high}'


@dataclass(frozen=True)
class ModelAccuracy:
    """
    What identification knows of the errors of its own models; None for what is not known.

    Attributes
    ----------
    hysteresis_rms_um : float or None
        Residual of the hysteresis over its whole record, noise included.
    noise_rms_um : float or None
        Noise of that record.
    level_v, level_percent : tuple of float
        Amplitudes of the record, and the residual there in percent of the span of the loop.
    level_rms_um : tuple of float
        Root mean square of what is left of a loop there, without noise; empty where not known.
    order_share : tuple of float
        Shares of the orders 1, 2, ... of a scan in its mean square.
    model_error : float or None
        Relative error of the dynamics.
    usable_to_hz : float
        Up to where they hold; above, their error is taken as 100 %.
    loop_offset_um : float
        How far the loops of a stage that was virgin lie beside those of the model.

    """

    hysteresis_rms_um: float | None = None
    noise_rms_um: float | None = None
    level_v: tuple[float, ...] = ()
    level_percent: tuple[float, ...] = ()
    level_rms_um: tuple[float, ...] = ()
    order_share: tuple[float, ...] = _UNKNOWN_SHARES
    model_error: float | None = None
    usable_to_hz: float = math.inf
    loop_offset_um: float = 0.0

    def relative_error(self, frequency_hz: ArrayLike) -> _Floats:
        """Return the relative error of the dynamics at frequencies in hertz, shape (N,)."""
        frequency = np.asarray(frequency_hz, dtype=np.float64)
        return np.where(frequency <= self.usable_to_hz, self.model_error or 0.0, 1.0)

    def residual_um(self, amplitude_v: float, noise_rms_um: float) -> float:
        """
        Return the residual of the hysteresis in a loop, without noise.

        Parameters
        ----------
        amplitude_v : float
            Amplitude of the voltage of the loop.
        noise_rms_um : float
            Noise of the sensor, where that of the record is not told.

        """
        levels = np.array(self.level_v)
        order = np.argsort(levels)
        # Below the smallest loop of the record a residual falls, but less than the loop does.
        below = math.sqrt(min(amplitude_v / float(levels.min()), 1.0)) if levels.size else 1.0
        if self.level_rms_um:
            known_um = np.array(self.level_rms_um)
            return below * float(np.interp(amplitude_v, levels[order], known_um[order]))
        whole_um = self.hysteresis_rms_um or 0.0
        noise_um = noise_rms_um if self.noise_rms_um is None else self.noise_rms_um
        rms_um = math.sqrt(max(whole_um**2 - noise_um**2, 0.0))
        sizes = levels * np.array(self.level_percent)
        if not sizes.size or not sizes.any():
            return rms_um
        relative = sizes / math.sqrt(float(np.mean(sizes**2)))
        return rms_um * below * float(np.interp(amplitude_v, levels[order], relative[order]))

    def residual_gain(
        self, frequency_hz: float, sample_period_s: float, passed: Callable[[_Floats], _Floats],
    ) -> float:
        """
        Return how much larger the residual of the hysteresis is in a scan than at rest.

        Parameters
        ----------
        frequency_hz, sample_period_s : float
            Of the scan and of its samples; orders above half the sampling frequency are left out.
        passed : callable
            Frequencies in hertz to |S G/G(0)| there.

        """
        share = np.array(self.order_share)
        sampled = share[:math.ceil(0.5 / (frequency_hz * sample_period_s)) - 1]
        gain = passed(frequency_hz * np.arange(1.0, sampled.size + 1.0))
        return math.sqrt(float(np.sum(sampled * gain**2)) / float(share.sum()))

    def unknown(self, *, bound: bool) -> tuple[str, ...]:
        """
        Return the names of the parts of a prediction that are not known.

        Parameters
        ----------
        bound : bool
            Whether the uncertainty W(s) is known.

        """
        parts = []
        if self.hysteresis_rms_um is None:
            parts.append('hysteresis residual')
        if not bound and self.model_error is None:
            parts += ['W(s)', 'error of the dynamics']
        return tuple(parts)


def error_interval(
    known_percent: Sequence[float], dynamics_percent: float, hysteresis_percent: float,
    unknown: Sequence[str],
) -> ErrorInterval:
    """
    Return where the error of a run is expected.

    Parameters
    ----------
    known_percent : sequence of float
        The known part for each place of the hysteresis that is possible.
    dynamics_percent, hysteresis_percent : float
        The parts due to the errors of the models.
    unknown : sequence of str
        The parts that are not known.

    """
    low = (1.0 - _SIMULATED) * math.hypot(
        max(min(known_percent) - dynamics_percent, 0.0), hysteresis_percent / _SPREAD)
    high = (1.0 + _SIMULATED) * math.hypot(
        max(known_percent) + dynamics_percent, hysteresis_percent * _SPREAD)
    return ErrorInterval(low, None if unknown else high)
