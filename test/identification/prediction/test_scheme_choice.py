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

import math

import numpy as np
import pytest

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.identification.prediction.operating_points import (
    equal_error_frequency_hz,
    recommend_scheme,
)
from piezo_ros.identification.prediction.tracking import predict_tracking
from piezo_ros.model import DynamicsParameters, LinearDynamics, RigParameters

# Gain and amplifier differ from the printed model, which the feedforward inverts.
DYNAMICS = LinearDynamics(DynamicsParameters(
    gain_k_rad3_per_s3=2.38e12, damping_ratio_1=0.55, time_constant_s=1.55e-4))
RIG = RigParameters(slew_limit_v_per_s=18200.0).replaced(**DYNAMICS.parameters.to_mapping())
LAW = ControllerParameters()


def sine(frequency_hz, **others):
    return TrajectoryParameters(waveform='sine', frequency_hz=frequency_hz, **others)


def measured(trajectory, schemes=('ff', 'fbff', 'fb')):
    return {
        scheme: predict_tracking(RIG, trajectory, LAW.replaced(scheme=scheme)).nrmse_percent
        for scheme in schemes}


def test_feedback_is_recommended_below_its_acceptable_frequency_and_not_above():
    # Without delay the known error of a sine is multiplied by S and nothing else, (14) and (15).
    prompt = LAW.replaced(measurement_delay_samples=0)
    limit_hz = recommend_scheme(DYNAMICS, sine(300.0), prompt).feedback_acceptable_frequency_hz
    assert recommend_scheme(DYNAMICS, sine(0.98 * limit_hz), prompt).scheme == 'fbff'
    assert recommend_scheme(DYNAMICS, sine(1.02 * limit_hz), prompt).scheme == 'ff'
    assert equal_error_frequency_hz(
        DYNAMICS, sine(300.0), prompt, np.arange(200.0, 800.0, 20.0)) == pytest.approx(
            limit_hz, rel=1e-3)


def test_the_recommended_scheme_is_the_one_that_tracks_best():
    recommended = set()
    for amplitude_um in (0.5, 1.5, 2.5):
        for frequency_hz in (300.0, 500.0, 800.0):
            scan = TrajectoryParameters(amplitude_um=amplitude_um, frequency_hz=frequency_hz)
            choice = recommend_scheme(RIG.replaced(seed=5), scan, LAW)
            errors = measured(scan)
            assert errors[choice.scheme] <= 1.02 * min(errors.values())
            recommended.add(choice.scheme)
    assert recommended == {'ff', 'fbff'}


def test_at_the_slew_limit_feedback_is_not_recommended():
    fast = TrajectoryParameters(amplitude_um=2.5, frequency_hz=700.0)
    choice = recommend_scheme(RIG, fast, LAW)
    free = recommend_scheme(RIG.replaced(slew_limit_v_per_s=0.0), fast, LAW)
    assert choice.predictions['fbff'].slew_limited
    assert choice.scheme == 'ff'
    assert choice.predicted_nrmse_percent['fbff'] > 2.0 * free.predicted_nrmse_percent['fbff']


def test_uncertainty_decides_for_the_scheme_that_lessens_it():
    # The feedforward inverts the right model: only the uncertainty is left.
    choices = [
        recommend_scheme(
            DYNAMICS, sine(frequency_hz).replaced(**DYNAMICS.parameters.to_mapping()), LAW,
            uncertainty=lambda f: 0.2 + 0.0 * f) for frequency_hz in (250.0, 600.0)]
    assert [choice.scheme for choice in choices] == ['fbff', 'ff']
    assert choices[0].predicted_nrmse_percent['ff'] == pytest.approx(
        20.0 * math.sqrt(0.5) / 2.0, rel=0.05)


def test_feedback_alone_is_recommended_where_the_feedforward_is_bad():
    wrong = sine(10.0, gain_k_rad3_per_s3=5e12)
    assert recommend_scheme(DYNAMICS, wrong, LAW).scheme in ('fb', 'fbff')
    errors = recommend_scheme(DYNAMICS, wrong, LAW).predicted_nrmse_percent
    assert errors['fb'] < errors['ff']


def test_an_unstable_loop_is_never_recommended():
    choice = recommend_scheme(
        DYNAMICS, sine(50.0), LAW.replaced(proportional_gain=5.0))
    assert choice.scheme == 'ff'
    assert list(choice.predicted_nrmse_percent) == ['ff']
    assert equal_error_frequency_hz(
        DYNAMICS, sine(50.0), LAW.replaced(proportional_gain=5.0), [50.0, 100.0]) == 0.0


def test_the_frequency_of_equal_errors_may_lie_outside():
    prompt = LAW.replaced(measurement_delay_samples=0)
    assert equal_error_frequency_hz(DYNAMICS, sine(50.0), prompt, [50.0, 100.0]) == math.inf
    assert equal_error_frequency_hz(DYNAMICS, sine(50.0), prompt, [900.0, 1000.0]) == 0.0
