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

"""The excitation of a record, found in its input, and broadband inputs."""

import numpy as np
import pytest
from scipy.signal import chirp, cont2discrete, lfilter

from piezo_ros.control.tables.excitation import multisine, odd_lines, stepped_sine
from piezo_ros.identification.response.amplifier_limits import Amplifier
from piezo_ros.identification.response.broadband_response import broadband_response
from piezo_ros.identification.response.detected_excitation import detect_excitation
from piezo_ros.identification.response.frequency_response import frequency_response
from piezo_ros.identification.response.welch_response import welch_response

TS = 1e-4
SAMPLES = 20_000
TIME_S = TS * np.arange(SAMPLES)
# A lag of 400 Hz and a resonance at 1.2 kHz, behind a hold.
NUMERATOR, DENOMINATOR, _ = cont2discrete(
    ([0.97], np.polymul([1.0 / 2513.0, 1.0], [1.0 / 7540.0**2, 0.06 / 7540.0, 1.0])), TS)
NUMERATOR = NUMERATOR.ravel()
INPUTS = {
    'noise': lambda seed: 0.3 * np.random.default_rng(1000 + seed).normal(size=SAMPLES),
    'chirp': lambda seed: 0.5 * chirp(TIME_S, 20.0, TIME_S[-1], 3000.0),
    'logarithmic chirp': lambda seed: 0.5 * chirp(
        TIME_S, 20.0, TIME_S[-1], 3000.0, method='logarithmic'),
}


def truth(frequency_hz):
    z = np.exp(2j * np.pi * frequency_hz * TS)
    return np.polyval(NUMERATOR, z) / np.polyval(DENOMINATOR, z)


def measured(values, seed=0, noise_um=5e-3):
    output = lfilter(NUMERATOR, DENOMINATOR, values)
    return output + noise_um * np.random.default_rng(seed).normal(size=output.size)


def test_the_dwells_of_a_stepped_sine_are_found():
    excitation = stepped_sine(np.geomspace(20.0, 4500.0, 20), 1.0, TS, offset=0.7)
    found = detect_excitation(excitation.command, TS)
    assert found.kind == 'stepped'
    assert [window.fundamental_hz for window in found.windows] == pytest.approx(
        excitation.frequency_hz.tolist(), rel=1e-6)
    for window, own in zip(found.windows, excitation.windows, strict=True):
        assert own.start - 40 < window.start < window.stop <= own.stop + 150


def test_dwells_need_not_be_whole_periods_nor_free_of_noise():
    hertz = np.array([47.1, 101.7, 333.33, 777.7, 1234.5, 2222.2, 3901.0])
    time_s = TS * np.arange(2130)
    values = np.concatenate([np.sin(2.0 * np.pi * each * time_s) for each in hertz])
    values += 0.01 * np.random.default_rng(0).normal(size=values.size)
    found = detect_excitation(values, TS)
    assert found.kind == 'stepped'
    assert [window.fundamental_hz for window in found.windows] == pytest.approx(
        hertz.tolist(), rel=1e-3)
    output = measured(values, noise_um=0.0)
    response = frequency_response(values, output, TS, excitation=found.windows)
    assert response.response == pytest.approx(truth(response.frequency_hz), rel=0.02)


def test_the_lines_of_a_multisine_are_found_also_if_its_period_is_not_whole_samples():
    excitation = multisine(10.0, odd_lines(200, per_decade=20), 1.0, TS, periods=6)
    found = detect_excitation(excitation.command, TS)
    assert found.kind == 'multisine'
    assert found.windows[0].lines == excitation.windows[0].lines
    assert found.windows[0].fundamental_hz == pytest.approx(10.0, rel=1e-12)
    lines = (1, 3, 5, 9, 17, 33, 65, 129)
    values = sum(np.cos(2.0 * np.pi * 7.3 * line * TIME_S + line**2) for line in lines)
    (window,) = detect_excitation(values, TS).windows
    assert window.lines == lines
    assert window.fundamental_hz == pytest.approx(7.3, rel=1e-5)


@pytest.mark.parametrize('name', INPUTS)
def test_noise_and_chirps_are_broadband(name):
    assert detect_excitation(INPUTS[name](0), TS).kind == 'broadband'


@pytest.mark.parametrize(('values', 'kind', 'words'), [
    (np.zeros(100), 'auto', 'the input does not move'),
    (np.random.default_rng(0).normal(size=500), 'stepped', 'no dwell of 4 equal periods'),
    (np.random.default_rng(0).normal(size=500), 'multisine', 'does not repeat itself'),
    (np.full(9, np.nan), 'auto', 'no finite sample'),
    (np.ones(9), 'sweep', "excitation is 'sweep', allowed are auto, stepped"),
])
def test_an_input_that_is_not_what_is_told_is_refused(values, kind, words):
    with pytest.raises(ValueError, match=words):
        detect_excitation(values, TS, kind)


@pytest.mark.parametrize('name', INPUTS)
def test_a_broadband_input_gives_the_response(name):
    values = INPUTS[name](1)
    found = broadband_response(values, measured(values), TS)
    chosen = (found.frequency_hz > 50.0) & (found.frequency_hz < 1500.0)
    assert np.count_nonzero(chosen) > 40
    error = np.abs(found.response / truth(found.frequency_hz) - 1.0)[chosen]
    assert np.median(error) < 0.02
    assert 0.85 < np.mean((np.abs(found.response - truth(found.frequency_hz))
                           < found.confidence_radius)[chosen]) <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize('name', INPUTS)
def test_the_circle_of_a_broadband_estimate_holds_the_truth_in_95_percent_of_200_seeds(name):
    inside = []
    for seed in range(200):
        values = INPUTS[name](seed)
        found = broadband_response(values, measured(values, seed), TS)
        chosen = (found.frequency_hz > 25.0) & (found.frequency_hz < 2900.0)
        error = np.abs(found.response - truth(found.frequency_hz))
        inside.append((error < found.confidence_radius)[chosen])
    assert 0.93 < np.mean(np.concatenate(inside)) < 0.975


@pytest.mark.slow
def test_the_circle_of_welchs_method_holds_the_truth_in_95_percent_of_200_seeds():
    numerator, denominator = [0.0, 0.3], [1.0, -0.7]  # memory that is short against a segment
    inside = []
    for seed in range(200):
        values = INPUTS['noise'](seed)
        output = lfilter(numerator, denominator, values)
        output += 0.05 * np.random.default_rng(seed).normal(size=output.size)
        found = welch_response(values, output, TS)
        z = np.exp(2j * np.pi * found.frequency_hz * TS)
        error = np.abs(
            found.response - np.polyval(numerator, z) / np.polyval(denominator, z))
        inside.append(error < found.confidence_radius)
    assert 0.93 < np.mean(np.concatenate(inside)) < 0.975


def test_points_without_input_are_left_out_with_the_reason():
    values = INPUTS['chirp'](0)
    found = broadband_response(values, measured(values), TS)
    assert found.frequency_hz.max() < 3500.0
    high = [point for point in found.excluded if point.frequency_hz > 3500.0]
    assert high
    assert all('hardly any input at this frequency' in point.reason for point in high)


def test_d8_lost_samples_divide_a_broadband_record():
    values = INPUTS['noise'](2)
    output = measured(values)
    output[[100, 5000]] = np.nan  # bridged
    output[9000:9050] = np.nan  # a gap
    values[15_000] = np.nan
    found = broadband_response(values, output, TS)
    assert found.samples_lost == 53
    assert '3 pieces with 19949 of 20000 samples are used' in found.losses[0]
    chosen = (found.frequency_hz > 50.0) & (found.frequency_hz < 1500.0)
    error = np.abs(found.response / truth(found.frequency_hz) - 1.0)[chosen]
    assert np.median(error) < 0.03
    inside = np.abs(found.response - truth(found.frequency_hz)) < found.confidence_radius
    assert np.mean(inside) > 0.85


def test_samples_at_which_the_amplifier_saturates_are_left_out():
    values = INPUTS['noise'](3)
    found = broadband_response(
        values, measured(values), TS, amplifier=Amplifier(voltage_maximum_v=1.0))
    assert 'the limit is 1 V' in found.losses[-1]
    assert found.samples_used < SAMPLES


def test_h1_is_biased_by_noise_in_the_input_and_h2_by_noise_in_the_output():
    values = INPUTS['noise'](4)
    generator = np.random.default_rng(5)
    gain = {}
    for estimator in ('h1', 'h2'):
        for where in ('input', 'output'):
            noise = 0.15 * generator.normal(size=SAMPLES)
            read, output = (values + noise, values) if where == 'input' else (
                values, values + noise)
            found = welch_response(read, output, TS, estimator=estimator)
            gain[estimator, where] = float(np.median(np.abs(found.response)))
    assert gain['h1', 'output'] == pytest.approx(1.0, abs=0.01)
    assert gain['h2', 'input'] == pytest.approx(1.0, abs=0.01)
    assert gain['h1', 'input'] == pytest.approx(0.8, abs=0.02)
    assert gain['h2', 'output'] == pytest.approx(1.25, abs=0.03)
    assert 'resolve' in found.notes[0]


@pytest.mark.parametrize(('arguments', 'words'), [
    ({'estimator': 'h3'}, "estimator is 'h3', allowed are h1, h2"),
    ({'segment_samples': 5}, 'segment_samples is 5, allowed is 16'),
])
def test_an_estimator_that_is_not_known_is_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        welch_response(np.arange(100.0), np.arange(100.0), TS, **arguments)
