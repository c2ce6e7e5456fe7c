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

import control
import numpy as np
import pytest
from scipy import signal

from piezo_ros import paper
from piezo_ros.model import DynamicsParameters, LinearDynamics
from piezo_ros.model.rig import rig_constants
from piezo_ros.model.state_space import (
    StateSpace,
    discretise_first_order_hold,
    discretise_zero_order_hold,
    gain,
    linear_constants,
    output_then_update,
    series,
    update_then_output,
)

FREQUENCY_HZ = np.geomspace(1.0, 4e4, 200)
PERIOD_S = 1e-5


def response(system, frequency_hz, sample_period_s=None):
    """C (p I - A)^-1 B + D, p on the imaginary axis or on the unit circle."""
    s = 2j * np.pi * np.asarray(frequency_hz)
    points = s if sample_period_s is None else np.exp(s * sample_period_s)
    identity = np.eye(len(system.a))
    return np.array([
        (system.c @ np.linalg.solve(p * identity - system.a, system.b) + system.d)[0, 0]
        for p in points])


def whole(dynamics):
    return series(dynamics.amplifier, dynamics.mechanics_and_sensor)


@pytest.fixture
def dynamics():
    return LinearDynamics()


def test_the_dc_gain_is_that_of_the_paper(dynamics):
    assert dynamics.parameters.dc_gain == pytest.approx(0.988, abs=5e-4)
    assert dynamics.response([0.0])[0] == pytest.approx(dynamics.parameters.dc_gain, rel=1e-12)


def test_the_response_is_the_printed_formula(dynamics):
    t = paper.TABLE_2
    s = 2j * np.pi * FREQUENCY_HZ
    expected = t['gain_k_rad3_per_s3'] * (
        s**2 + t['zero_b1_rad_per_s'] * s + t['zero_b2_rad2_per_s2']) / (
        (s + 1 / t['time_constant_s'])
        * (s**2 + 2 * t['damping_ratio_1'] * t['natural_frequency_1_rad_per_s'] * s
           + t['natural_frequency_1_rad_per_s']**2)
        * (s**2 + 2 * t['damping_ratio_2'] * t['natural_frequency_2_rad_per_s'] * s
           + t['natural_frequency_2_rad_per_s']**2))
    np.testing.assert_allclose(dynamics.response(FREQUENCY_HZ), expected, rtol=1e-12)


def test_the_transfer_function_is_one_of_python_control_with_the_same_response(dynamics):
    transfer_function = dynamics.transfer_function
    assert isinstance(transfer_function, control.TransferFunction)
    assert transfer_function.isctime()
    np.testing.assert_allclose(
        transfer_function(2j * np.pi * FREQUENCY_HZ), dynamics.response(FREQUENCY_HZ), rtol=1e-12)


def test_the_zeros_are_in_the_right_half_plane_and_the_poles_in_the_left(dynamics):
    zeros = dynamics.transfer_function.zeros()
    np.testing.assert_allclose(sorted(zeros, key=np.imag), [17350 - 29866j, 17350 + 29866j],
                               atol=1.0)
    assert np.all(dynamics.transfer_function.poles().real < 0.0)


def test_amplifier_then_mechanics_and_sensor_are_the_whole(dynamics):
    np.testing.assert_allclose(
        response(whole(dynamics), FREQUENCY_HZ), dynamics.response(FREQUENCY_HZ), rtol=1e-10)
    assert response(dynamics.amplifier, [0.0])[0] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize('period_s', [1e-6, 1e-5, 1e-4])
def test_sampling_behind_a_zero_order_hold_agrees_with_scipy(dynamics, period_s):
    ours = dynamics.discrete(period_s)
    theirs = signal.cont2discrete(tuple(whole(dynamics)), period_s, 'zoh')
    for mine, scipys in zip(ours, theirs, strict=False):
        np.testing.assert_allclose(mine, scipys, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize('period_s', [1e-6, 1e-5, 1e-4])
def test_sampling_behind_a_zero_order_hold_agrees_with_python_control(dynamics, period_s):
    frequency_hz = FREQUENCY_HZ[FREQUENCY_HZ < 0.4 / period_s]
    sampled = control.c2d(control.ss(*whole(dynamics)), period_s, 'zoh')
    np.testing.assert_allclose(
        response(dynamics.discrete(period_s), frequency_hz, period_s),
        sampled(np.exp(2j * np.pi * frequency_hz * period_s)), rtol=1e-9)


@pytest.mark.parametrize('period_s', [1e-6, 1e-5, 1e-4])
def test_sampling_behind_a_first_order_hold_agrees_with_scipy(dynamics, period_s):
    ours = discretise_first_order_hold(dynamics.mechanics_and_sensor, period_s)
    theirs = signal.cont2discrete(tuple(dynamics.mechanics_and_sensor), period_s, 'foh')
    for mine, scipys in zip(ours, theirs, strict=False):
        np.testing.assert_allclose(mine, scipys, rtol=1e-9, atol=1e-12)


def test_the_hold_alone_separates_the_sampled_from_the_printed_response(dynamics):
    sampled = response(dynamics.discrete(PERIOD_S), [800.0, 2000.0], PERIOD_S)
    ratio = sampled / dynamics.response([800.0, 2000.0])
    deviation_percent = 100 * np.abs(ratio - 1)
    assert deviation_percent[0] == pytest.approx(2.5, abs=0.05)
    assert deviation_percent[1] == pytest.approx(6.3, abs=0.05)
    assert np.degrees(np.angle(ratio[1])) == pytest.approx(-3.6, abs=0.05)


@pytest.mark.parametrize('step', [output_then_update, update_then_output])
def test_the_steps_of_a_sample_agree_with_scipy(dynamics, step):
    inputs = np.random.default_rng(0).normal(size=400)
    if step is update_then_output:
        system = dynamics.discrete(PERIOD_S)
    else:
        system = discretise_first_order_hold(dynamics.mechanics_and_sensor, PERIOD_S)
    constants = linear_constants(system)
    state, scratch = [0.0] * len(constants.b), [0.0] * len(constants.b)
    outputs = [step(state, scratch, constants, value) for value in inputs.tolist()]
    _, expected, _ = signal.dlsim((*system, PERIOD_S), np.append(inputs, 0.0))
    # The one that moves first answers for the end of the sample, the other for its beginning.
    later = 1 if step is update_then_output else 0
    np.testing.assert_allclose(
        outputs, expected[later:later + inputs.size, 0], rtol=1e-9, atol=1e-12)


def test_a_gain_has_no_states_and_may_stand_anywhere_in_a_series():
    amplifier = LinearDynamics().amplifier
    for system in (series(gain(2.0), amplifier), series(amplifier, gain(2.0))):
        assert isinstance(system, StateSpace)
        np.testing.assert_allclose(
            response(system, FREQUENCY_HZ), 2 * response(amplifier, FREQUENCY_HZ), rtol=1e-12)


@pytest.mark.parametrize('period_s', [0.0, -1e-5, np.nan, np.inf])
def test_a_sample_period_that_is_none_is_refused(dynamics, period_s):
    message = f'sample_period_s is {period_s}, it must be finite and above 0'
    with pytest.raises(ValueError, match=message):
        dynamics.discrete(period_s)
    with pytest.raises(ValueError, match=message):
        discretise_first_order_hold(dynamics.amplifier, period_s)
    with pytest.raises(ValueError, match=message):
        discretise_zero_order_hold(dynamics.amplifier, period_s)
    from piezo_ros.model import RigParameters
    with pytest.raises(ValueError, match=message):
        rig_constants(RigParameters(), period_s)


def test_the_defaults_are_table_2():
    of_6 = [name for name in DynamicsParameters.names() if name in paper.TABLE_2]
    assert len(of_6) == 8
    for name in of_6:
        assert getattr(DynamicsParameters(), name) == paper.TABLE_2[name]
    assert DynamicsParameters().dynamics == 'liu'


def test_the_sampled_response_is_that_of_the_discrete_system():
    dynamics = LinearDynamics()
    np.testing.assert_allclose(
        dynamics.sampled_response(FREQUENCY_HZ, PERIOD_S),
        response(dynamics.discrete(PERIOD_S), FREQUENCY_HZ, PERIOD_S), rtol=1e-9)
