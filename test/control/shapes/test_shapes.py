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

"""Shapes beyond triangle and sine: their course, their series, their axes."""

import numpy as np
import pytest

from piezo_ros.control import TrajectoryParameters
from piezo_ros.control.shapes.fourier_series import fourier_amplitudes, mean_square_um2
from piezo_ros.control.trajectory_step import trajectory_constants, trajectory_step
from piezo_ros.control.waveform import abrupt_step, waveform_constants
from piezo_ros.model import LinearDynamics, ParameterError


def scan(**values):
    return TrajectoryParameters(**{'harmonics': 0, **values})


def course(parameters, phases):
    constants = waveform_constants(parameters)
    return np.array([abrupt_step(constants, phase) for phase in np.atleast_1d(phases).tolist()])


def streams(parameters):
    constants = trajectory_constants(parameters)
    return np.array([trajectory_step(constants, k) for k in range(parameters.samples)]).T


@pytest.mark.parametrize(('flyback', 'turn'), [
    (0.1, 0.0), (0.01, 0.0), (0.5, 0.3), (0.3, 1.0), (0.83, 0.25), (0.99, 1e-3)])
def test_a_sawtooth_keeps_its_travel_and_is_continuous(flyback, turn):
    saw = scan(waveform='sawtooth', flyback_fraction=flyback, turn_fraction=turn,
               amplitude_um=2.0, offset_um=-1.0)
    phases = np.linspace(0.0, 1.0, 8001)
    values = course(saw, phases) + 1.0
    assert values[0] == pytest.approx(0.0, abs=1e-12)
    steepest = np.abs(np.diff(values)).max()
    # The peak may lie between two of the phases.
    assert 2.0 - steepest <= values.max() <= 2.0 * (1 + 1e-12)
    np.testing.assert_allclose(values, -values[::-1], atol=1e-9)
    assert steepest <= 2 * 4.0 / min(flyback, 1 - flyback) / 8000
    if turn == 0.0:
        assert (np.diff(values) < 0.0).mean() == pytest.approx(flyback, abs=3e-4)


def test_the_turns_of_a_triangle_are_parabolas_and_the_rest_is_straight():
    triangle = scan(waveform='triangle', turn_fraction=0.2, amplitude_um=1.0)
    phases = np.linspace(0.0, 0.5, 1001)
    bends = np.diff(course(triangle, phases), 2) / (phases[1] ** 2)
    slope = 4.0 / 0.9
    # Of a half period 0.5 the turn takes 0.1: there the slope goes from +slope to -slope.
    inside = np.abs(phases[1:-1] - 0.25) < 0.0495
    np.testing.assert_allclose(bends[inside], -2.0 * slope / 0.1, rtol=1e-6)
    np.testing.assert_allclose(bends[np.abs(phases[1:-1] - 0.25) > 0.0505], 0.0, atol=1e-6)
    assert course(triangle, 0.25)[0] == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize(('stairs', 'turn'), [(1, 0.0), (1, 1.0), (8, 0.3), (33, 0.05)])
def test_a_staircase_rests_on_its_stairs_between_smooth_steps(stairs, turn):
    parameters = scan(
        waveform='staircase', stairs=stairs, turn_fraction=turn, amplitude_um=3.0,
        frequency_hz=1.0)
    centres = np.arange(-stairs, stairs + 1) / (4.0 * stairs)
    np.testing.assert_allclose(
        course(parameters, centres % 1.0), np.linspace(-3.0, 3.0, 2 * stairs + 1), atol=1e-12)
    fine = course(parameters, np.linspace(0.0, 1.0, 4001))
    assert np.abs(fine).max() <= 3.0 * (1.0 + 1e-15)
    if turn > 0.2:
        assert np.abs(np.diff(fine)).max() <= 1.6 * 3.0 / stairs / turn * 4 * stairs / 4000


@pytest.mark.parametrize('values', [
    {'waveform': 'triangle', 'turn_fraction': 0.37}, {'waveform': 'sawtooth'},
    {'waveform': 'triangle', 'turn_fraction': 1.0},
    {'waveform': 'sawtooth', 'flyback_fraction': 0.7, 'turn_fraction': 0.25},
    {'waveform': 'sawtooth', 'flyback_fraction': 0.3, 'turn_fraction': 1.0},
    {'waveform': 'staircase', 'stairs': 3, 'turn_fraction': 0.4},
    {'waveform': 'staircase', 'stairs': 1, 'turn_fraction': 1.0},
])
def test_series_and_mean_square_are_those_of_the_course(values):
    parameters = scan(amplitude_um=1.7, offset_um=0.4, **values)
    phases = (np.arange(40_000) + 0.5) / 40_000
    curve = course(parameters, phases) - 0.4
    amplitudes = fourier_amplitudes(parameters, 40)
    projected = [2.0 * np.mean(curve * np.sin(2 * np.pi * k * phases)) for k in range(1, 41)]
    np.testing.assert_allclose(amplitudes, projected, atol=1e-6)
    assert mean_square_um2(parameters) == pytest.approx(np.mean(curve**2), rel=1e-6)


def test_a_sharp_staircase_has_the_series_of_its_jumps():
    parameters = scan(waveform='staircase', stairs=2, amplitude_um=1.0)
    phases = (np.arange(40_000) + 0.5) / 40_000
    curve = course(parameters, phases)
    projected = [2.0 * np.mean(curve * np.sin(2 * np.pi * k * phases)) for k in range(1, 20)]
    np.testing.assert_allclose(fourier_amplitudes(parameters, 19), projected, atol=1e-4)
    assert mean_square_um2(parameters) == pytest.approx(np.mean(curve**2), rel=1e-4)


@pytest.mark.parametrize('values', [
    {'waveform': 'sawtooth', 'harmonics': 20, 'flyback_fraction': 0.3, 'turn_fraction': 0.3},
    {'waveform': 'triangle', 'harmonics': 15, 'turn_fraction': 0.2},
    {'waveform': 'staircase', 'harmonics': 41, 'stairs': 3, 'turn_fraction': 1.0},
    {'waveform': 'lissajous', 'harmonics': 1, 'axis': 2, 'lissajous_phase': 0.1},
])
def test_through_the_model_the_feedforward_becomes_the_truncated_waveform(values):
    frequency_hz, samples, model = 100.0, 1000, LinearDynamics()
    parameters = TrajectoryParameters(
        frequency_hz=frequency_hz, amplitude_um=2.0, offset_um=0.7, periods=1.0, **values)
    reference_um, feedforward_um = streams(parameters)
    spectrum = np.fft.rfft(feedforward_um)
    through = np.fft.irfft(
        spectrum * model.response(np.arange(spectrum.size) * frequency_hz), samples)
    wanted = np.fft.rfft(reference_um)
    wanted[int(parameters.harmonics * parameters.cycles) + 1:] = 0.0
    np.testing.assert_allclose(through, np.fft.irfft(wanted, samples), atol=2e-5)


@pytest.mark.parametrize('axis', [1, 2])
def test_the_feedforward_of_a_spiral_is_exact_while_it_grows(axis):
    spiral = TrajectoryParameters(
        waveform='spiral', axis=axis, frequency_hz=500.0, periods=10.0, amplitude_um=2.0,
        sample_period_s=1e-6)
    assert spiral.harmonics == 1
    reference_um, feedforward_um = streams(spiral)
    system = LinearDynamics().discrete(1e-6)
    state, output = np.zeros((system.a.shape[0], 1)), []
    for value in feedforward_um:
        output.append((system.c @ state)[0, 0])
        state = system.a @ state + system.b * value
    error_um = (reference_um - np.array(output))[4000:]
    # What is left is half a sample of the hold; without the term of the growth it is 20 nm.
    assert np.abs(error_um).max() < 0.006
    assert reference_um[0] == 0.0
    assert np.abs(reference_um).max() == pytest.approx(2.0, rel=0.03)


def test_the_axes_of_a_lissajous_figure_close_together():
    figure = {'waveform': 'lissajous', 'frequency_hz': 10.0, 'lissajous_cycles': (5.0, 6.0),
              'periods': 2.0, 'amplitude_um': 1.5}
    x_um, y_um = (streams(scan(axis=axis, **figure))[0] for axis in (1, 2))
    turns = np.arange(20_000) / 10_000
    np.testing.assert_allclose(x_um, 1.5 * np.sin(2 * np.pi * 5 * turns), atol=1e-9)
    np.testing.assert_allclose(y_um, 1.5 * np.sin(2 * np.pi * 6 * turns), atol=1e-9)
    np.testing.assert_allclose(x_um[10_000:], x_um[:10_000], atol=1e-12)


def test_the_two_axes_of_a_spiral_are_a_quarter_turn_apart():
    x_um, y_um = (streams(scan(
        waveform='spiral', axis=axis, frequency_hz=100.0, periods=4.0))[0] for axis in (1, 2))
    radius_um = np.hypot(x_um, y_um)
    np.testing.assert_allclose(radius_um, np.arange(4000) / 4000, atol=1e-12)


@pytest.mark.parametrize('waveform', ['triangle', 'sine', 'decreasing_triangle', 'sawtooth',
                                      'staircase', 'lissajous', 'spiral'])
def test_an_offset_moves_every_waveform_and_its_feedforward(waveform):
    plain, moved = (streams(TrajectoryParameters(
        waveform=waveform, offset_um=offset_um, ramp_periods=1.0)) for offset_um in (0.0, 1.25))
    parameters = TrajectoryParameters(waveform=waveform)
    whole = slice(400, None)
    np.testing.assert_allclose(moved[0][whole], plain[0][whole] + 1.25, atol=1e-12)
    np.testing.assert_allclose(
        moved[1][whole], plain[1][whole] + 1.25 / parameters.dc_gain, atol=1e-12)
    assert moved[0][0] == 0.0


@pytest.mark.parametrize(('values', 'problem'), [
    ({'waveform': 'sine', 'turn_fraction': 0.2}, "turn_fraction is 0.2 and waveform 'sine'"),
    ({'turn_fraction': 1.5}, 'turn_fraction is 1.5, allowed is 0 … 1'),
    ({'waveform': 'sawtooth', 'flyback_fraction': 0.0}, 'flyback_fraction is 0.0, allowed is 0.01'),
    ({'waveform': 'staircase', 'stairs': 0}, 'stairs is 0, allowed is 1'),
    ({'waveform': 'spiral', 'axis': 3}, 'axis is 3, allowed is 1 … 2'),
    ({'waveform': 'lissajous', 'lissajous_cycles': (1.0,)}, 'it must be two integers'),
    ({'waveform': 'lissajous', 'lissajous_cycles': (1.5, 2.0)}, 'it must be two integers'),
    ({'waveform': 'lissajous', 'axis': 2, 'lissajous_cycles': (1.0, 200.0)},
     r'frequency_hz is 300.0 Hz \(of axis 2: 60000 Hz\), it must be below the Nyquist'),
    ({'waveform': 'sawtooth', 'harmonics': 200}, 'harmonic 200 of 300 Hz is at 60000 Hz'),
    ({'waveform': 'triangle', 'offset_um': float('nan')}, 'offset_um is nan'),
])
def test_what_is_no_shape_is_refused(values, problem):
    with pytest.raises(ParameterError, match=problem):
        TrajectoryParameters(**values)


def test_a_staircase_has_no_harmonics_unless_they_are_asked_for():
    assert TrajectoryParameters(waveform='staircase').harmonics == 0
    assert TrajectoryParameters(waveform='sawtooth').harmonics == 9
