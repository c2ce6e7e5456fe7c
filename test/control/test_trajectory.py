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

from piezo_ros.control import TrajectoryParameters
from piezo_ros.control.trajectory_blocks import trajectory_blocks
from piezo_ros.control.trajectory_step import trajectory_constants, trajectory_step

PERIODIC = st.sampled_from([
    {'waveform': 'triangle'}, {'waveform': 'sine'},
    {'waveform': 'triangle', 'offset_um': -2.5, 'turn_fraction': 0.2},
    {'waveform': 'sawtooth', 'offset_um': 1.0}, {'waveform': 'sawtooth', 'turn_fraction': 1.0},
    {'waveform': 'staircase', 'turn_fraction': 0.3, 'harmonics': 5}, {'waveform': 'staircase'},
    {'waveform': 'lissajous', 'axis': 2, 'lissajous_cycles': (2.0, 3.0),
     'lissajous_phase': 0.25}])
ANY = PERIODIC | st.sampled_from([
    {'waveform': 'spiral', 'axis': 1}, {'waveform': 'spiral', 'axis': 2, 'offset_um': 0.5},
    {'waveform': 'decreasing_triangle', 'offset_um': 0.5, 'turn_fraction': 0.5}])
# What a scan is likely to have: 1000, 200, 320 samples and more that one or several periods take.
REPEATED_HZ = st.sampled_from([50.0, 300.0, 312.5, 500.0, 700.0, 1250.0])
OTHERS_HZ = st.floats(50.0, 3000.0)


def parameters_of(frequency_hz, **others):
    return TrajectoryParameters(**{'frequency_hz': frequency_hz, 'periods': 40.0, **others})


def directly(parameters, indices):
    """Reference and feedforward of samples by the formulas alone."""
    constants = trajectory_constants(parameters)._replace(repeat=0)
    return np.array([trajectory_step(constants, index) for index in indices.tolist()]).T


def test_the_scan_of_the_paper_repeats_itself_after_three_periods():
    assert trajectory_constants(TrajectoryParameters()).repeat == 1000


@given(PERIODIC, st.one_of(REPEATED_HZ, OTHERS_HZ), st.sampled_from([0.0, 0.5, 3.0, 7.2]))
def test_what_repeats_itself_is_what_the_formulas_say(waveform, frequency_hz, ramp_periods):
    parameters = parameters_of(frequency_hz, **waveform, ramp_periods=ramp_periods)
    indices = np.linspace(0, parameters.samples - 1, 200).round().astype(int)
    if parameters.waveform == 'staircase' and not parameters.turn_fraction:
        return  # on which side of a jump a sample lies is rounding
    constants = trajectory_constants(parameters)
    ours = np.array([trajectory_step(constants, index) for index in indices.tolist()]).T
    # The phase is rounded in the same way, however large the feedforward is.
    tolerance_um = 1e-11 * max(1.0, np.abs(ours).max())
    np.testing.assert_allclose(ours, directly(parameters, indices), rtol=0, atol=tolerance_um)


@given(ANY, st.one_of(REPEATED_HZ, OTHERS_HZ), st.sampled_from([0.0, 0.5, 7.2]), st.data())
def test_any_block_has_the_same_bits_in_python_and_compiled_and_sample_by_sample(
        waveform, frequency_hz, ramp_periods, data):
    parameters = parameters_of(frequency_hz, **waveform, ramp_periods=ramp_periods)
    constants = trajectory_constants(parameters)
    start = data.draw(st.integers(0, parameters.samples - 1))
    count = data.draw(st.integers(1, min(300, parameters.samples - start)))
    expected = np.array([trajectory_step(constants, start + k) for k in range(count)]).T
    for compiled in (False, True):
        block = np.array(trajectory_blocks(parameters, compiled=compiled)(start, count))
        assert block.tobytes() == expected.tobytes()


@pytest.mark.parametrize('index', [10**7, 10**12, 2**53 - 1])
def test_a_scan_is_as_exact_after_hours_as_at_its_start(index):
    constants = trajectory_constants(TrajectoryParameters())
    assert trajectory_step(constants, index) == trajectory_step(constants, index % 1000)


@pytest.mark.parametrize(('changes', 'why'), [
    ({'waveform': 'decreasing_triangle', 'harmonics': 0}, 'every period is smaller'),
    ({'frequency_hz': 299.9871}, 'not within thousands of samples'),
])
def test_what_does_not_repeat_itself_is_not_taken_for_it(changes, why):
    parameters = TrajectoryParameters(**changes)
    assert trajectory_constants(parameters).repeat == 0, why
    indices = np.arange(parameters.samples)
    ours = np.array(trajectory_blocks(parameters)(0, parameters.samples))
    assert ours.tobytes() == directly(parameters, indices).tobytes()
