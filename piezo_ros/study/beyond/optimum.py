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
Finds the best known voltage of every cell of Table 4, with full knowledge of the simulated rig.

    minimise over c   mean of (y_d - y(B c))^2   within slew limit and rails

by sequential quadratic programming on the true stage without noise, from several starts and with
several bands up to the Nyquist frequency; the smallest error counts. It is the yardstick of what
was planned and learned without that knowledge. Local optima were within 1 % of each other; none is
certified to be global.

    python -m piezo_ros.study.beyond.optimum config/rig.yaml -o best_known.csv
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.waveform import WaveformParameters, abrupt_step, waveform_constants
from piezo_ros.model import LinearDynamics, RigParameters
from piezo_ros.parameters.parameter_file import read_parameter_set
from piezo_ros.planning.constrained_step import (
    AmplifierLimits,
    InfeasibleError,
    constrained_step,
)
from piezo_ros.planning.harmonics import (
    harmonic_basis,
    orders_of_band,
    repeating_samples,
    sample_turns,
)
from piezo_ros.planning.periodic_plan import plan_periodic
from piezo_ros.planning.periodic_stage import LinearisedAnswer, PeriodicStage
from piezo_ros.report.files import write_atomically
from piezo_ros.study.beyond.best_known import BestKnown, best_known_csv
from piezo_ros.study.table_4 import table_cells

__all__ = ['find_optimum']

_Floats = NDArray[np.float64]
_BANDS_HZ: Final = (15_000.0, 30_000.0, 49_900.0)
_SPREADS: Final = (0.0, 0.05, 0.1)  # of the coefficients of each start about the plan
_STEPS: Final = 60
_FIRST_REGULARISATION: Final = 1e-5  # of the mean square sensitivity
_LEAST_REGULARISATION: Final = 1e-9
_SETTLED: Final = 1e-5  # relative fall of the squared error
_MOST_REJECTED: Final = 6
_PERIOD_S: Final = 1e-5


class _Cell(NamedTuple):
    stage: PeriodicStage
    reference_um: _Floats
    basis: _Floats
    limits: AmplifierLimits


def find_optimum(
    rig: RigParameters, amplitude_um: float, frequency_hz: float,
    bands_hz: Sequence[float] = _BANDS_HZ, spreads: Sequence[float] = _SPREADS,
) -> BestKnown:
    """
    Return the best voltage found for a triangle on the true stage.

    Parameters
    ----------
    rig : RigParameters
        The rig with its mismatches.
    amplitude_um, frequency_hz : float
        The triangle.
    bands_hz : sequence of float, optional
        Highest frequencies of the voltage that are tried.
    spreads : sequence of float, optional
        Standard deviations of the starts, of the coefficients of the plan.

    """
    samples = repeating_samples(frequency_hz, _PERIOD_S)
    dynamics = LinearDynamics(rig.true_dynamics)
    stage = PeriodicStage(
        dynamics.before_hysteresis, rig, dynamics.behind_hysteresis, _PERIOD_S, samples,
        dynamics.delay_s)
    constants = waveform_constants(WaveformParameters(
        waveform='triangle', amplitude_um=amplitude_um, frequency_hz=frequency_hz,
        sample_period_s=_PERIOD_S))
    turns = sample_turns(samples, frequency_hz, _PERIOD_S)
    reference_um = np.array([abrupt_step(constants, turn) for turn in turns.tolist()])
    limits = AmplifierLimits(
        rig.slew_limit_v_per_s or np.inf, minimum_v=rig.voltage_minimum_v - rig.operating_point_v,
        maximum_v=rig.voltage_maximum_v - rig.operating_point_v)
    rng = np.random.default_rng(1)
    found = []
    for band_hz in bands_hz:
        plan = plan_periodic(
            stage, reference_um, frequency_hz, _PERIOD_S, band_hz=band_hz, limits=limits)
        orders = orders_of_band(band_hz, frequency_hz, _PERIOD_S, is_symmetric=True)
        cell = _Cell(stage, reference_um, harmonic_basis(turns, orders), limits)
        for spread in spreads:
            # Within the limits for sure: a little smaller than the plan.
            start = plan.coefficients_v * (1.0 - spread) * (
                1.0 + spread * rng.standard_normal(plan.coefficients_v.size))
            try:
                found.append(BestKnown(
                    amplitude_um, frequency_hz, _descend(cell, start), band_hz))
            except InfeasibleError:
                continue
    return min(found, key=lambda one: one.nrmse_percent)


def _descend(cell: _Cell, coefficients: _Floats) -> float:
    """Return the error that the steps come to, percent of the peak-to-peak reference."""
    weight = np.ones(cell.reference_um.size)
    share, rejected = _FIRST_REGULARISATION, 0
    answer = cell.stage.linearise(cell.basis @ coefficients, cell.basis)
    kept = cell.limits.worst(cell.basis @ coefficients, _PERIOD_S) <= 1.0 + 1e-5
    squares = _squares(cell, answer) if kept else np.inf
    for _ in range(_STEPS):
        change = constrained_step(
            answer.slope, cell.reference_um - answer.displacement_um, weight,
            share * float(np.mean(answer.slope**2)), cell.basis, coefficients, cell.limits,
            _PERIOD_S)
        tried = cell.stage.linearise(cell.basis @ (coefficients + change), cell.basis)
        now = _squares(cell, tried)
        if now < squares:
            settled = squares - now < _SETTLED * squares
            coefficients, answer, squares = coefficients + change, tried, now
            share, rejected = max(share / 3.0, _LEAST_REGULARISATION), 0
            if settled:
                break
        else:
            share, rejected = 10.0 * share, rejected + 1
            if rejected > _MOST_REJECTED:
                break
    return float(100.0 * np.sqrt(squares) / np.ptp(cell.reference_um))


def _squares(cell: _Cell, answer: LinearisedAnswer) -> float:
    return float(np.mean((cell.reference_um - answer.displacement_um)**2))


def main(arguments: Sequence[str] | None = None) -> int:
    """Search every cell of Table 4 and write the file."""
    parser = argparse.ArgumentParser(description='Find the best known voltage of every cell.')
    parser.add_argument('rig', type=Path, help='parameter file of the plant')
    parser.add_argument('-o', '--output', type=Path, required=True)
    options = parser.parse_args(arguments)
    rig = read_parameter_set(options.rig, 'plant', RigParameters)
    found = []
    for cell in table_cells():
        found.append(find_optimum(rig, *cell))
        print(found[-1], file=sys.stderr, flush=True)
    write_atomically(options.output, best_known_csv(rig, found))
    return 0


if __name__ == '__main__':
    sys.exit(main())
