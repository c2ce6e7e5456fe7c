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

"""What the experiments of the study give: the content of every table and figure."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag import Run
from piezo_ros.identification import (
    DynamicsFit,
    FrequencyResponse,
    HysteresisFit,
    OperatingPoint,
    UncertaintyBound,
    crossing_frequency_hz,
)
from piezo_ros.identification.tuning.loop_shape import LoopShape
from piezo_ros.identification.tuning.pi_tuning import PiTuning
from piezo_ros.report.metrics import Nonlinearity

__all__ = [
    'Crossing', 'HarmonicsTrial', 'PaperResults', 'StaticLoop', 'WarmingResults',
    'known_frequency_hz',
]

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class StaticLoop:
    """One whole slow loop of input (V or um) and displacement, and its nonlinearity."""

    input: _Floats
    displacement_um: _Floats
    nonlinearity: Nonlinearity


@dataclass(frozen=True)
class Crossing:
    """
    FF and FBFF errors of sines of one amplitude, and where they are equal.

    Attributes
    ----------
    amplitude_um : float
        Peak amplitude.
    frequency_hz, ff_percent, fbff_percent : ndarray, shape (F,)
        NRMSE under both schemes.
    predicted_hz : float
        Where the identified models foresee the crossing; NaN where none.
    crossing_hz : float
        Where the two are equal; NaN where they nowhere are.

    """

    amplitude_um: float
    frequency_hz: _Floats
    ff_percent: _Floats
    fbff_percent: _Floats
    predicted_hz: float = math.nan

    @property
    def crossing_hz(self) -> float:
        """Frequency from which on feedback does harm, interpolated."""
        crossing_hz = crossing_frequency_hz(
            self.frequency_hz, self.ff_percent, self.fbff_percent)
        return known_frequency_hz(crossing_hz)


@dataclass(frozen=True)
class HarmonicsTrial:
    """
    Feedforward alone with several numbers of harmonics, predicted and measured.

    Attributes
    ----------
    point : OperatingPoint
        The scan, with what was predicted and chosen.
    harmonics : tuple of int
        Highest harmonics m that were run.
    measured_percent : tuple of float
        Their NRMSE.

    """

    point: OperatingPoint
    harmonics: tuple[int, ...]
    measured_percent: tuple[float, ...]

    @property
    def predicted_percent(self) -> dict[int, float]:
        """Predicted NRMSE of every m that was considered."""
        return self.point.choices['ff'].predicted_nrmse_percent


@dataclass(frozen=True)
class WarmingResults:
    """
    Tables 3 and 4, all as published, on a stage that warms by its losses.

    Attributes
    ----------
    self_heating_gain : float
        Relative growth of its gain at a mean square speed of 1 (um/ms)^2.
    crossings : tuple of Crossing
        Table 3; nothing is predicted.
    table_4 : ndarray, shape (30, 2)
        Percent, FF and FBFF.

    """

    self_heating_gain: float
    crossings: tuple[Crossing, ...]
    table_4: _Floats


@dataclass(frozen=True)
class PaperResults:
    """Everything that the report of the study shows."""

    uncompensated: StaticLoop
    compensated: StaticLoop
    compensated_identified: StaticLoop
    compensated_creeping: StaticLoop
    hysteresis: HysteresisFit
    bare_responses: tuple[tuple[FrequencyResponse, ...], ...]  # by amplitude, slow and fast sweep
    compensated_responses: tuple[FrequencyResponse, ...]  # behind the published inverse
    wide_response: FrequencyResponse  # a small amplitude, past the second resonance
    identified_responses: tuple[FrequencyResponse, ...]  # behind the identified one
    dynamics_published: DynamicsFit  # behind the published inverse
    dynamics: DynamicsFit  # behind the identified one
    uncertainty: UncertaintyBound
    closed_loop: FrequencyResponse
    loop_published: LoopShape
    loop_identified: LoopShape
    tuning: PiTuning
    crossings: tuple[Crossing, ...]
    cells: tuple[tuple[float, float], ...]
    table_4_published: _Floats  # (30, 2), percent, FF and FBFF
    table_4_identified: _Floats
    table_4_automatic: _Floats
    points: tuple[OperatingPoint, ...]  # (30,)
    trials: tuple[HarmonicsTrial, ...]
    warming: WarmingResults
    scans: Mapping[str, Run]  # scheme -> 2.5 um triangle of 300 Hz


def known_frequency_hz(frequency_hz: float) -> float:
    """Return NaN for a crossing that lies outside the frequencies that were looked at."""
    return frequency_hz if 0.0 < frequency_hz < math.inf else math.nan
