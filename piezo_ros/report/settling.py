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
Whether the displacement of a run repeats from period to period, as it does in steady state.

With the displacement y, the period T of the reference y_d and h periods, half of the scored ones::

    c(t) = y(t) - y(t - h T)        in the last h periods
    change = RMS of the coherent part of c / (max y_d - min y_d)

The coherent part consists of the spectral lines of c that stand out of its noise: white noise of
the sensor changes from period to period in a run that has settled, too. As y_d repeats, c is also
the change of the tracking error; y has no corners, between which a period that is no whole number
of samples could not be interpolated.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ['Settling', 'settling', 'settling_periods']

# A line of white noise is above 20 times the median power in one of 10^6 cases.
_LINE_OVER_MEDIAN: Final = 20.0
_FEWEST_LINES: Final = 16  # below, noise cannot be told from lines
# The error has settled if it changes by less than a tenth of itself, or by less than what the
# tables show of the NRMSE.
_SETTLED_SHARE: Final = 0.1
_SETTLED_CHANGE: Final = 2e-4
# A loop is unstable if an oscillation of its own is a good part of the error and does not decay.
_UNSTABLE_SHARE: Final = 0.25
_UNSTABLE_CHANGE: Final = 5e-3
_NOT_DECAYING: Final = 0.7
_GROWING: Final = 1.5
# RMS change of a periodic reference, over its peak-to-peak, and what interpolation between the
# samples of a corner adds, times the samples in a period.
_REPEATED_REFERENCE: Final = 2e-3
_CORNERS: Final = 0.35

_Floats = NDArray[np.float64]


class Settling(NamedTuple):
    """
    What the last periods of a run tell of its steady state.

    Attributes
    ----------
    change_percent : float
        RMS by which the error changes over half of the scored periods, percent of the peak-to-peak
        reference, without noise.
    is_settled : bool
        Whether that is little beside the error itself.
    is_stable : bool
        False where an oscillation that is not the reference's is a good part of the error and does
        not decay.

    """

    change_percent: float
    is_settled: bool
    is_stable: bool


def settling_periods(scored_periods: float) -> int:
    """Return h, the number of periods that are compared; so many before the scored ones help."""
    return max(1, int(scored_periods) // 2)


def settling(
    reference_um: _Floats, displacement_um: _Floats, samples_per_period: float,
    scored_periods: float,
) -> Settling | None:
    """
    Return whether the error repeats at the end of a run.

    Parameters
    ----------
    reference_um, displacement_um : ndarray, shape (N,)
        The end of the run: the scored periods, and those before as far as they are there.
    samples_per_period : float
        Samples in a period of the reference.
    scored_periods : float
        Periods that are scored.

    Returns
    -------
    Settling or None
        None where it cannot be told: fewer than two periods, or a reference that does not repeat.

    """
    periods = settling_periods(scored_periods)
    lag = periods * samples_per_period
    span_um = float(np.ptp(reference_um))
    late, references = _stretches(displacement_um, lag), _stretches(reference_um, lag)
    if late is None or references is None or span_um == 0.0:
        return None
    repeated_um = span_um * max(_REPEATED_REFERENCE, _CORNERS / samples_per_period)
    if _rms(references[0] - references[1]) > repeated_um:
        return None
    scored = slice(-max(1, round(scored_periods * samples_per_period)), None)
    error_um = _rms(reference_um[scored] - displacement_um[scored])
    change_um, strongest = _coherent(late[0] - late[1])
    early = _stretches(displacement_um[:-late[0].size], lag)
    growth = None if early is None else _rms(late[0] - late[1]) / max(
        _rms(early[0] - early[1]), np.finfo(float).tiny)
    is_of_its_own = strongest > periods or (growth is not None and growth > _GROWING)
    lasts = growth is None or growth > _NOT_DECAYING
    is_large = change_um > max(_UNSTABLE_SHARE * error_um, _UNSTABLE_CHANGE * span_um)
    return Settling(
        100.0 * change_um / span_um,
        is_settled=change_um <= max(_SETTLED_SHARE * error_um, _SETTLED_CHANGE * span_um),
        is_stable=not (is_large and is_of_its_own and lasts))


def _stretches(values: _Floats, lag: float) -> tuple[_Floats, _Floats] | None:
    """Return the last `lag` samples and the `lag` samples before, None where there are fewer."""
    length = int(lag)
    last = values[values.size - length:]
    places = np.arange(values.size - length, values.size) - lag
    if length < 2 or places[0] < 0.0:
        return None
    return last, np.interp(places, np.arange(values.size), values)


def _coherent(values: _Floats) -> tuple[float, int]:
    """Return the RMS of the lines that stand out of the noise, and the number of the strongest."""
    power = np.abs(np.fft.rfft(values)) ** 2
    power[1:(values.size + 1) // 2] *= 2.0  # the negative frequencies
    if power.size >= _FEWEST_LINES:
        power = np.where(power > _LINE_OVER_MEDIAN * np.median(power), power, 0.0)
    return float(np.sqrt(power.sum()) / values.size), int(np.argmax(power))


def _rms(values: _Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
