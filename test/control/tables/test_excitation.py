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

from piezo_ros.control.tables.excitation import multisine, odd_lines, stepped_sine
from piezo_ros.identification.response.offline_excitation import run_excitation_offline
from piezo_ros.model import MaxwellResistiveCapacitor, Rig, RigParameters

TS = 1e-5


def test_every_window_of_a_stepped_sine_is_whole_periods_on_ever_other_phases():
    wanted = np.array([97.0, 1000.0, 12500.0])
    excitation = stepped_sine(wanted, 0.5, TS)
    for window, frequency in zip(excitation.windows, wanted, strict=True):
        samples = window.stop - window.start
        periods = window.fundamental_hz * samples * TS
        assert periods == pytest.approx(round(periods), abs=1e-9)
        assert math.gcd(round(periods), samples) == 1
        assert window.fundamental_hz == pytest.approx(frequency, rel=1e-3)
        k = np.arange(window.start, window.stop)
        turn = 2.0 * np.pi * window.fundamental_hz * TS * k
        basis = np.stack([np.sin(turn), np.cos(turn)], axis=1)
        part = excitation.command[window.start:window.stop]
        fitted = basis @ np.linalg.lstsq(basis, part)[0]
        assert np.max(np.abs(part - fitted)) < 1e-9
        assert np.max(np.abs(part)) == pytest.approx(0.5, rel=0.02)


def test_nothing_in_a_stepped_sine_is_steeper_than_its_fastest_sine():
    amplitudes = np.array([1.0, 0.2, 0.4])
    frequencies = np.array([50.0, 3000.0, 1000.0])
    excitation = stepped_sine(frequencies, amplitudes, TS, offset=1.5)
    steepest = np.max(2.0 * np.pi * frequencies * amplitudes) * TS
    assert np.max(np.abs(np.diff(excitation.command))) < 1.1 * steepest
    assert excitation.command[0] == 0.0
    for window in excitation.windows:
        assert excitation.command[window.start:window.stop].mean() == pytest.approx(1.5, abs=1e-3)


def test_a_multisine_has_its_lines_and_no_others_at_a_low_peak():
    lines = odd_lines(200, seed=3)
    excitation = multisine(50.0, lines, 0.7, TS, offset=0.5, periods=2)
    window = excitation.windows[0]
    part = excitation.command[window.start:window.stop] - 0.5
    spectrum = np.abs(np.fft.rfft(part)) / part.size * 2.0
    level = spectrum[2 * np.array(lines)]
    assert np.ptp(level) < 1e-9 * level.max()
    spectrum[2 * np.array(lines)] = 0.0
    assert spectrum.max() < 1e-9 * level.max()
    assert np.max(np.abs(part)) == pytest.approx(0.7)
    assert np.max(np.abs(part)) / np.std(part) < 1.75


def test_one_odd_line_in_four_is_left_for_detection():
    lines = odd_lines(401, seed=1)
    assert all(line % 2 == 1 for line in lines)
    assert len(lines) == pytest.approx(201 * 3 / 4, abs=2)
    assert odd_lines(401, seed=1) == lines
    assert odd_lines(401, seed=2) != lines


def test_lines_can_be_thinned_out_evenly_over_the_logarithm():
    lines = np.array(odd_lines(4001, per_decade=10.0))
    ratios = lines[1:] / lines[:-1]
    assert ratios.min() >= 10.0**0.1
    assert np.sum(lines > 400) == pytest.approx(10, abs=1)
    assert set(lines) <= set(odd_lines(4001))


def test_a_reading_offline_precedes_the_voltage_of_its_sample():
    command = stepped_sine([500.0], 0.5, TS, dwell_s=0.01).command
    plant, compensator = RigParameters(), MaxwellResistiveCapacitor()
    voltage, displacement = run_excitation_offline(plant, compensator, command, TS)
    assert np.array_equal(voltage, compensator.inverse(command)[0])
    rig = Rig(plant, TS)
    assert displacement[0] == rig.measure()
    assert np.array_equal(displacement[1:], rig.run(voltage)[:-1])


def test_without_a_compensator_the_command_is_the_voltage():
    command = stepped_sine([500.0], 0.5, TS, dwell_s=0.01).command
    voltage, _ = run_excitation_offline(RigParameters(), None, command, TS)
    assert np.array_equal(voltage, command)


@pytest.mark.parametrize(('build', 'words'), [
    (lambda: stepped_sine([100.0, 50000.0], 1.0, TS), 'frequencies_hz: 50000 Hz'),
    (lambda: stepped_sine([0.0], 1.0, TS), 'frequencies_hz: 0 Hz'),
    (lambda: stepped_sine([100.0], -1.0, TS), 'amplitude is -1.0'),
    (lambda: multisine(100.0, [1, 600], 1.0, TS), 'lines: 60000 Hz'),
    (lambda: multisine(100.0, [1, 3], math.nan, TS), 'amplitude is nan'),
])
def test_an_impossible_excitation_is_refused_by_name(build, words):
    with pytest.raises(ValueError, match=words):
        build()
