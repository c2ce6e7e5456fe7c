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

from piezo_ros.control import WAVEFORMS, TrajectoryParameters
from piezo_ros.control.feedforward import feedforward_step
from piezo_ros.control.shapes.fourier_series import (
    PERIODIC,
    fourier_amplitudes,
    mean_square_um2,
)
from piezo_ros.control.trajectory_step import trajectory_constants, trajectory_step
from piezo_ros.model import DynamicsParameters, LinearDynamics, ParameterError

MODEL = LinearDynamics()


def projection(values, harmonic):
    """Sine coefficient of one period, by the trapezoidal rule."""
    phase = np.arange(values.size) / values.size
    return 2 * np.mean(values * np.sin(2 * np.pi * harmonic * phase))


def direct_sum(parameters, time_s):
    """(13) in Liu 2015 as it is printed."""
    total = np.zeros_like(time_s)
    for k in range(1, parameters.harmonics + 1):
        a_k = parameters.amplitude_um * 8 / (k * np.pi) ** 2 * np.sin(k * np.pi / 2)
        omega = 2 * np.pi * k * parameters.frequency_hz
        g = MODEL.response([omega / (2 * np.pi)])[0]
        total += a_k / np.abs(g) * np.sin(omega * time_s - np.angle(g))
    return total


def streams(parameters):
    constants = trajectory_constants(parameters)
    return np.array([trajectory_step(constants, k) for k in range(parameters.samples)]).T


@pytest.mark.parametrize('waveform', ['triangle', 'sine'])
def test_the_fourier_series_is_that_of_the_waveform(waveform):
    # The period is a whole number of samples, so that nothing leaks.
    parameters = TrajectoryParameters(
        waveform=waveform, amplitude_um=1.7, frequency_hz=1.0, periods=1.0, harmonics=0)
    reference_um, _ = streams(parameters)
    amplitudes = fourier_amplitudes(parameters, 25)
    projected = [projection(reference_um, k) for k in range(1, 26)]
    np.testing.assert_allclose(amplitudes, projected, rtol=0, atol=1e-8)
    assert np.all(amplitudes[1::2] == 0.0)


def test_the_first_coefficients_of_a_triangle_are_those_of_11():
    np.testing.assert_allclose(
        fourier_amplitudes(TrajectoryParameters(amplitude_um=2.0), 5),
        16 / np.pi**2 * np.array([1.0, 0.0, -1 / 9, 0.0, 1 / 25]), rtol=1e-14)


@pytest.mark.parametrize('harmonics', [1, 2, 3, 8, 9, 10, 15, 25])
@pytest.mark.parametrize('frequency_hz', [300.0, 777.7])
def test_the_feedforward_is_the_sum_of_13(harmonics, frequency_hz):
    parameters = TrajectoryParameters(
        harmonics=harmonics, frequency_hz=frequency_hz, amplitude_um=2.5, periods=5.0)
    _, feedforward_um = streams(parameters)
    expected_um = direct_sum(parameters, np.arange(parameters.samples) * 1e-5)
    np.testing.assert_allclose(feedforward_um, expected_um, rtol=0, atol=1e-11)


@pytest.mark.parametrize('harmonics', [1, 9, 25])
def test_through_the_model_it_becomes_the_truncated_triangle(harmonics):
    frequency_hz, samples = 400.0, 250
    parameters = TrajectoryParameters(
        harmonics=harmonics, frequency_hz=frequency_hz, amplitude_um=2.0, periods=1.0)
    assert parameters.samples == samples
    _, feedforward_um = streams(parameters)
    # One period in steady state: each harmonic times G, continuous time.
    spectrum = np.fft.rfft(feedforward_um)
    through = np.fft.irfft(
        spectrum * MODEL.response(np.arange(spectrum.size) * frequency_hz), samples)
    phase = np.arange(samples) / samples
    truncated = sum(
        a * np.sin(2 * np.pi * k * phase)
        for k, a in enumerate(fourier_amplitudes(parameters, harmonics), start=1))
    np.testing.assert_allclose(through, truncated, rtol=0, atol=1e-10)


def test_through_the_sampled_model_only_the_hold_remains():
    parameters = TrajectoryParameters(frequency_hz=400.0, amplitude_um=2.0, periods=8.0)
    _, feedforward_um = streams(parameters)
    system = MODEL.discrete(1e-5)
    state, output = np.zeros((5, 1)), []
    for value in feedforward_um:
        output.append((system.c @ state)[0, 0])
        state = system.a @ state + system.b * value
    into, out_of = np.fft.rfft(feedforward_um[-250:]), np.fft.rfft(output[-250:])
    for k in range(1, 10, 2):
        hold = out_of[k] / into[k] / MODEL.response([k * 400.0])[0]
        # Half a sample late, and next to nothing in magnitude.
        assert np.angle(hold) == pytest.approx(-np.pi * k * 400.0 * 1e-5, rel=0.02)
        assert np.abs(hold) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize('waveform', ['triangle', 'sine', 'decreasing_triangle'])
def test_without_harmonics_it_is_the_reference_over_the_dc_gain(waveform):
    reference_um, feedforward_um = streams(
        TrajectoryParameters(waveform=waveform, harmonics=0, ramp_periods=1.0, periods=3.0))
    np.testing.assert_allclose(
        feedforward_um, reference_um / DynamicsParameters().dc_gain, rtol=1e-14, atol=1e-300)


def test_a_soft_start_takes_the_jump_away_and_then_leaves_it_alone():
    soft_um = streams(TrajectoryParameters(ramp_periods=3.0))[1]
    abrupt_um = streams(TrajectoryParameters())[1]
    assert abs(abrupt_um[0]) > 0.1
    assert soft_um[0] == 0.0
    assert soft_um[1000:].tobytes() == abrupt_um[1000:].tobytes()
    assert np.abs(np.diff(soft_um)).max() <= np.abs(np.diff(abrupt_um)).max() * 1.01


def test_a_sine_needs_no_more_than_its_fundamental():
    one = streams(TrajectoryParameters(waveform='sine', harmonics=1))[1]
    nine = streams(TrajectoryParameters(waveform='sine', harmonics=9))[1]
    np.testing.assert_allclose(nine, one, rtol=0, atol=1e-15)


def test_it_depends_on_the_phase_within_the_period_alone():
    constants = trajectory_constants(TrajectoryParameters()).feedforward
    for turns in (0.0, 0.125, 0.5, 0.75):
        assert feedforward_step(constants, turns + 2.0**30, 0.0) == feedforward_step(
            constants, turns, 0.0)


@pytest.mark.parametrize(('values', 'message'), [
    ({'harmonics': 9, 'frequency_hz': 6000.0},
     'harmonics is 9: harmonic 9 of 6000 Hz is at 54000 Hz, it must be below the Nyquist freque'),
    ({'harmonics': 1, 'waveform': 'decreasing_triangle'},
     "waveform 'decreasing_triangle' is not periodic, harmonics must be 0"),
    ({'harmonics': -2}, 'harmonics is -2, allowed is -1 … 9999'),
])
def test_harmonics_that_do_not_exist_are_refused(values, message):
    with pytest.raises(ParameterError) as refusal:
        TrajectoryParameters(**values)
    assert str(refusal.value).startswith(message)


def test_the_highest_even_harmonic_may_lie_beyond_nyquist_because_it_is_zero():
    TrajectoryParameters(harmonics=10, frequency_hz=5200.0)


@pytest.mark.parametrize('waveform', PERIODIC)
def test_the_mean_square_is_that_of_the_series(waveform):
    scan = TrajectoryParameters(waveform=waveform, amplitude_um=2.0, harmonics=0)
    amplitudes_um = fourier_amplitudes(scan, 9999)
    # Of a sharp staircase, which jumps, as much is left beyond 9999 as sum 1/k^2 tells.
    assert mean_square_um2(scan) == pytest.approx(
        0.5 * float(np.sum(amplitudes_um**2)), rel=1e-3 if waveform == 'staircase' else 1e-9)


def test_every_periodic_waveform_is_one():
    assert set(PERIODIC) <= set(WAVEFORMS)
