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

"""Points of a stage with poles before its hysteresis are made linear."""

import numpy as np
import pytest

from piezo_ros.control import TrajectoryParameters
from piezo_ros.control.trajectory_blocks import trajectory_blocks
from piezo_ros.control.waveform import excitation_of
from piezo_ros.identification import fit_dynamics, frequency_response
from piezo_ros.identification.place.hysteresis_place import TimeRecord
from piezo_ros.identification.place.linearised_fit import fit_linearised
from piezo_ros.identification.place.placed_stage import Factors, Placement, simulate_placed
from piezo_ros.model import HysteresisParameters, MaxwellResistiveCapacitor

PERIOD_S = 5e-5
LAG_RAD_PER_S = 2.0 * np.pi * 400.0
STAGE = Factors(1.0, (LAG_RAD_PER_S,), ((2.0 * np.pi * 1200.0, 0.05),))
HYSTERESIS = HysteresisParameters(
    kappa_um_per_v=(9.0, 14.0, 20.0, 1.4), saturation_v=(0.02, 0.03, 0.05))
PLAYED = TrajectoryParameters(
    output='voltage', waveform='stepped_sine', harmonics=0, amplitude_v=0.3,
    frequencies_hz=tuple(np.round(np.geomspace(40.0, 3000.0, 30), 1)), dwell_s=0.03, settle_s=0.03,
    frequency_hz=300.0, sample_period_s=PERIOD_S)


def measure(before):
    """Return a record of the stage, its points and what makes points of other displacements."""
    operator = MaxwellResistiveCapacitor.of(HYSTERESIS)
    voltage_v = np.asarray(
        trajectory_blocks(PLAYED, compiled=True)(0, PLAYED.samples)[0])
    command_um = operator.forward(voltage_v)[0]
    displacement_um = simulate_placed(STAGE, before, operator, voltage_v, PERIOD_S)
    displacement_um += 1e-4 * np.random.default_rng(1).standard_normal(voltage_v.size)

    def respond(displacements_um):
        return frequency_response(
            command_um, displacements_um[0], PERIOD_S, excitation=excitation_of(PLAYED).windows)
    return TimeRecord(voltage_v, displacement_um, PERIOD_S), respond([displacement_um]), respond


@pytest.fixture(scope='module')
def lagging():
    record, measured, respond = measure(Placement((0,), ()))
    fit = fit_dynamics(measured, structure='auto')
    return measured, fit, fit_linearised(fit, measured, [record], HYSTERESIS, respond)


@pytest.mark.slow  # a hundred simulations
def test_no_model_of_the_points_explains_a_lag_before_the_hysteresis(lagging):
    measured, fit, _ = lagging
    assert fit.model_error > 2e-3
    true = LinearStage().response(measured.frequency_hz)
    assert np.max(np.abs(measured.response / true - 1.0)) > 0.05


@pytest.mark.slow  # a hundred simulations
def test_the_lag_is_found_and_the_points_are_those_of_the_linear_stage(lagging):
    measured, _, found = lagging
    assert found.before.rates_rad_per_s == pytest.approx((LAG_RAD_PER_S,), rel=0.02)
    assert 'lag' in str(found)
    true = LinearStage().response(measured.frequency_hz)
    np.testing.assert_allclose(found.response.response / true, 1.0, atol=0.01)
    assert found.fit.orders == (0, 3)
    assert found.fit.model_error < 1e-3


def test_points_that_a_model_explains_are_left_alone():
    record, measured, respond = measure(Placement())
    fit = fit_dynamics(measured, structure='auto')
    assert fit_linearised(fit, measured, [record], HYSTERESIS, respond) is None


class LinearStage:
    """The stage without hysteresis, behind the hold."""

    def response(self, frequency_hz):
        impulse_samples = 4000
        voltage_v = np.zeros(impulse_samples)
        voltage_v[0] = 1.0
        straight = MaxwellResistiveCapacitor((1.0,), ())
        impulse = simulate_placed(STAGE, Placement(), straight, voltage_v, PERIOD_S)
        turns = np.exp(-2j * np.pi * np.outer(
            frequency_hz, PERIOD_S * np.arange(impulse_samples)))
        return turns @ impulse
