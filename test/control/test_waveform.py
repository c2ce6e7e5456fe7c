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
from hypothesis import given
from hypothesis import strategies as st

from piezo_ros.control.trajectory_blocks import trajectory_blocks
from piezo_ros.control.trajectory_step import TrajectoryParameters
from piezo_ros.control.waveform import (
    EXCITATIONS,
    WAVEFORMS,
    WaveformParameters,
    excitation_of,
    ramp_step,
    reference_step,
    turns_step,
    waveform_constants,
)
from piezo_ros.model import ParameterError

# The other ones are tables; see test_excitation.py.
# The others are in shapes/: of another shape, or of two axes.
any_waveform = pytest.mark.parametrize('waveform', WAVEFORMS[:3])


def reference(constants, turns):
    return np.array([reference_step(constants, value) for value in np.atleast_1d(turns).tolist()])


def constants_of(**parameters):
    return waveform_constants(WaveformParameters(**parameters))


@any_waveform
@given(amplitude=st.floats(1e-3, 1e3), periods=st.integers(1, 50))
def test_the_first_peaks_are_the_amplitude_and_zero_is_where_it_starts(
        waveform, amplitude, periods):
    constants = constants_of(waveform=waveform, amplitude_um=amplitude, periods=float(periods))
    start, peak, middle, trough = reference(constants, [0.0, 0.25, 0.5, 0.75])
    assert start == 0.0
    assert peak == pytest.approx(amplitude, rel=1e-12)
    assert middle == pytest.approx(0.0, abs=1e-12 * amplitude)
    assert trough == pytest.approx(-amplitude, rel=1e-12)


@any_waveform
def test_nowhere_does_it_jump_or_exceed_its_amplitude(waveform):
    constants = constants_of(waveform=waveform, amplitude_um=2.0, periods=7.0)
    turns = np.linspace(0.0, 7.0, 70001)
    values = reference(constants, turns)
    steepest = 2.0 * (2 * np.pi if waveform == 'sine' else 4.0)
    assert np.abs(np.diff(values)).max() <= steepest * 1e-4 * (1 + 1e-6)
    assert np.abs(values).max() <= 2.0 * (1 + 1e-12)


def test_the_triangle_is_straight_between_its_peaks():
    turns = np.linspace(0.0, 3.0, 3001)
    expected = 1.5 * 2 / np.pi * np.arcsin(np.sin(2 * np.pi * turns))
    np.testing.assert_allclose(
        reference(constants_of(amplitude_um=1.5), turns), expected, rtol=0, atol=1e-12)


def test_each_period_of_a_decreasing_triangle_is_lower_by_the_same_step_and_the_last_not_zero():
    constants = constants_of(waveform='decreasing_triangle', amplitude_um=3.0, periods=6.0)
    peaks = reference(constants, np.arange(6) + 0.25)
    troughs = reference(constants, np.arange(6) + 0.75)
    np.testing.assert_allclose(peaks, [3.0, 2.5, 2.0, 1.5, 1.0, 0.5], rtol=1e-12)
    np.testing.assert_allclose(troughs, -peaks, rtol=1e-12)


@any_waveform
def test_it_repeats_itself_far_from_the_start(waveform):
    constants = constants_of(waveform=waveform, periods=9e8)
    turns = np.linspace(0.0, 0.984375, 64)
    np.testing.assert_allclose(
        reference(constants, turns + 2.0 ** 20), reference(constants, turns), rtol=0,
        atol=2e-3 if waveform == 'decreasing_triangle' else 1e-12)


@any_waveform
def test_a_soft_start_rises_smoothly_from_nothing_to_the_waveform_itself(waveform):
    soft = constants_of(waveform=waveform, ramp_periods=2.0)
    abrupt = constants_of(waveform=waveform)
    turns = np.linspace(0.0, 4.0, 4001)
    ramp = np.array([ramp_step(soft, value) for value in turns.tolist()])
    assert ramp[0] == 0.0
    assert np.all(np.diff(ramp) >= 0.0)
    np.testing.assert_array_equal(ramp[turns >= 2.0], 1.0)
    np.testing.assert_allclose(ramp[turns == 1.0], 0.5, atol=1e-12)
    np.testing.assert_allclose(
        reference(soft, turns), ramp * reference(abrupt, turns), rtol=1e-12, atol=1e-15)


def test_without_a_soft_start_it_begins_at_once():
    assert ramp_step(constants_of(ramp_periods=0.0), 0.0) == 1.0


@given(st.integers(0, 2 ** 53))
def test_any_sample_can_be_asked_for_alone(index):
    constants = constants_of(frequency_hz=300.0)
    assert turns_step(constants, index) == 300.0 * 1e-5 * index


@pytest.mark.parametrize(('frequency_hz', 'periods', 'samples'), [
    (300.0, 15.0, 5000), (300.0, 1.0, 333), (700.0, 4.0, 571), (1.0, 0.5, 50000)])
def test_the_number_of_samples_is_that_of_its_periods(frequency_hz, periods, samples):
    assert WaveformParameters(frequency_hz=frequency_hz, periods=periods).samples == samples


@pytest.mark.parametrize(('values', 'message'), [
    ({'frequency_hz': 50e3},
     'frequency_hz is 50000.0 Hz, it must be below the Nyquist frequency 50000 Hz of sample_p'),
    ({'frequency_hz': 600.0, 'sample_period_s': 1e-3}, 'frequency_hz is 600.0 Hz'),
    ({'periods': 0.001}, 'periods is 0.001, which makes 0 samples; at least 2 are needed'),
    ({'periods': 1e9, 'frequency_hz': 1e-3, 'sample_period_s': 1e-6}, 'indices end at 9007199'),
    ({'waveform': 'square'}, "waveform is 'square', allowed are triangle, sine, "),
    ({'amplitude_um': -1.0}, 'amplitude_um is -1.0 um, allowed is 0 … 10000 um'),
])
def test_what_cannot_be_sampled_is_refused(values, message):
    with pytest.raises(ParameterError) as refusal:
        WaveformParameters(**values)
    assert message in str(refusal.value)


@pytest.mark.parametrize('waveform', EXCITATIONS)
@pytest.mark.parametrize('output', ['displacement', 'voltage'])
def test_an_excitation_is_played_sample_by_sample_with_the_amplitude_of_its_output(
        waveform, output):
    parameters = TrajectoryParameters(
        waveform=waveform, output=output, harmonics=0, amplitude_um=0.5, amplitude_v=2.0,
        offset_um=1.0, offset_v=-1.0, frequency_hz=50.0, periods=2.0, dwell_s=0.02,
        frequencies_hz=(50.0, 150.0, 400.0))
    expected = excitation_of(parameters).command
    peak, mean = (0.5, 1.0) if output == 'displacement' else (2.0, -1.0)
    assert np.max(np.abs(expected - mean)[-100:]) <= peak
    assert np.max(np.abs(expected)) == pytest.approx(peak + 1.0, rel=0.02)
    assert parameters.samples == expected.size
    values, _ = trajectory_blocks(parameters)(0, parameters.samples)
    np.testing.assert_array_equal(values, expected)
    compiled, _ = trajectory_blocks(parameters, compiled=True)(7, 100)
    np.testing.assert_array_equal(compiled, expected[7:107])


@pytest.mark.parametrize(('values', 'words'), [
    ({'frequencies_hz': (100.0, 60000.0)}, 'frequencies_hz'),
    ({'dwell_s': 1e5}, 'samples'),
])
def test_an_excitation_that_cannot_be_sampled_is_refused(values, words):
    with pytest.raises(ParameterError, match=words):
        TrajectoryParameters(waveform='stepped_sine', harmonics=0, **values)
