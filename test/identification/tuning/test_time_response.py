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

import numpy as np
import pytest

from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.control.closed_loop import target_of
from piezo_ros.identification.tuning.pi_loop import PiLoop
from piezo_ros.identification.tuning.time_response import loop_response, settling_samples
from piezo_ros.model import HysteresisParameters, LinearDynamics, RigParameters


def test_the_linear_response_is_that_of_the_simulated_loop_without_hysteresis():
    straight = {'kappa_um_per_v': (1.0, 1.0), 'saturation_v': (0.0,)}
    plant = RigParameters(**straight, noise_rms_um=0.0, dac_bits=0, adc_bits=0, order='lumped')
    law = ControllerParameters(scheme='fb', measurement_delay_samples=0)
    scan = TrajectoryParameters(periods=2.0)
    run = simulate(plant, HysteresisParameters(**straight), law, scan)
    loop = PiLoop.of(
        LinearDynamics(plant.true_dynamics), law.proportional_gain, law.integral_gain_per_s,
        scan.sample_period_s, law.measurement_delay_samples)
    response = loop_response(loop, target_of(scan)[0], scan.sample_period_s)
    assert response.displacement_um == pytest.approx(run.displacement_um[:-1], abs=1e-6)


def test_an_unstable_loop_has_no_response():
    loop = PiLoop.of(LinearDynamics(), 500.0, 0.0, 1e-5)
    with pytest.raises(ValueError, match='not stable'):
        loop_response(loop, np.ones(10), 1e-5)


def test_a_step_has_settled_after_the_samples_that_are_told():
    loop = PiLoop.of(LinearDynamics(), 0.3, 3000.0, 1e-5)
    samples = settling_samples(loop, 1e-5)
    response = loop_response(loop, np.ones(2 * samples), 1e-5)
    assert abs(response.displacement_um[samples:] - 1.0).max() < 0.01
