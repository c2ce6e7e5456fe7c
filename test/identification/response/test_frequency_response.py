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

from piezo_ros.control.tables.excitation import Window, multisine, odd_lines, stepped_sine
from piezo_ros.identification.response.frequency_response import (
    Amplifier,
    frequency_response,
    merge,
)
from piezo_ros.identification.response.offline_excitation import run_excitation_offline
from piezo_ros.model import LinearDynamics, MaxwellResistiveCapacitor, RigParameters

TS = 1e-5
IDEAL = RigParameters(order='lumped', noise_rms_um=0.0, dac_bits=0, adc_bits=0)
SLEW_LIMIT_V_PER_S = 18900.0


def true_response(frequency_hz):
    system = LinearDynamics().discrete(TS)
    return np.array([
        (system.c @ np.linalg.solve(z * np.eye(5) - system.a, system.b))[0, 0]
        for z in np.exp(2j * np.pi * np.asarray(frequency_hz) * TS)])


def play(excitation, plant=IDEAL):
    return run_excitation_offline(
        plant, MaxwellResistiveCapacitor(), excitation.command, TS)


@pytest.fixture(scope='module')
def stepped():
    excitation = stepped_sine([40.0, 333.0, 1234.0, 7654.0], 0.5, TS, offset=0.4, dwell_s=0.02)
    return excitation, *play(excitation)


def test_an_ideal_lumped_rig_gives_the_sampled_response(stepped):
    excitation, _, displacement = stepped
    found = frequency_response(excitation.command, displacement, TS, excitation=excitation)
    expected = true_response(found.frequency_hz)
    assert np.max(np.abs(found.response / expected - 1.0)) < 1e-7
    assert found.coherence == pytest.approx(1.0)
    assert found.amplitude == pytest.approx(0.5, rel=0.02)
    assert found.offset == pytest.approx(0.4, abs=1e-6)
    assert found.excluded == ()


def test_a_stretch_need_not_be_whole_periods_of_whole_samples():
    # 61.7 samples per period and 13.4 periods: a DFT would leak by percents.
    turn = 2.0 * np.pi / 61.7
    k = np.arange(round(13.4 * 61.7))
    output = 3.0 + 0.7 * np.sin(turn * k - 0.4)
    found = frequency_response(
        5.0 + np.sin(turn * k), output, TS, excitation=[Window(0, k.size, 1.0 / (61.7 * TS))])
    assert found.response[0] == pytest.approx(0.7 * np.exp(-0.4j), abs=1e-12)


def test_what_happens_outside_the_windows_does_not_matter(stepped):
    excitation, _, displacement = stepped
    plain = frequency_response(excitation.command, displacement, TS, excitation=excitation)
    spoiled = np.full_like(displacement, 1e3)
    for window in excitation.windows:
        spoiled[window.start:window.stop] = displacement[window.start:window.stop]
    found = frequency_response(excitation.command, spoiled, TS, excitation=excitation)
    assert np.array_equal(found.response, plain.response)


def test_a_straight_drift_does_not_matter(stepped):
    excitation, _, displacement = stepped
    plain = frequency_response(excitation.command, displacement, TS, excitation=excitation)
    drifting = displacement + 0.3 * np.arange(displacement.size) * TS
    found = frequency_response(excitation.command, drifting, TS, excitation=excitation)
    assert np.max(np.abs(found.response - plain.response)) < 1e-9


@pytest.mark.parametrize('memory', [0.0, 0.999])
def test_the_variance_is_that_of_the_response_in_white_and_in_coloured_noise(memory):
    # Coloured noise is strong at low frequencies, where the residual per sample is too small.
    from scipy.signal import lfilter
    excitation = stepped_sine([100.0, 1000.0], 0.5, TS, dwell_s=0.1)
    generator = np.random.default_rng(5)
    ratios = []
    for _ in range(150):
        noise = lfilter(
            [0.01], [1.0, -memory], generator.normal(size=excitation.command.size))
        found = frequency_response(
            excitation.command, excitation.command + noise, TS, excitation=excitation,
            distortion_limit=np.inf)
        ratios.append(np.abs(found.response - 1.0)**2 / found.variance)
    # With coloured noise the estimate is too large where the noise is weak, never too small.
    ratio = np.mean(ratios, axis=0)
    assert np.all(ratio < 1.3)
    assert np.all(ratio > (0.7 if memory == 0.0 else 0.3))


def test_the_circle_of_confidence_holds_the_truth_in_95_percent_of_cases():
    excitation = stepped_sine(np.geomspace(200.0, 9000.0, 20), 0.5, TS, dwell_s=0.01)
    _, displacement = play(excitation)
    generator = np.random.default_rng(7)
    inside = []
    for _ in range(30):
        found = frequency_response(
            excitation.command, displacement + 1e-3 * generator.normal(size=displacement.size),
            TS, excitation=excitation, distortion_limit=np.inf)
        error = np.abs(found.response - true_response(found.frequency_hz))
        inside.append(error < found.confidence_radius)
    assert 0.92 < np.mean(inside) < 0.985


def test_coherence_falls_with_noise():
    excitation = stepped_sine([500.0], 0.5, TS, dwell_s=0.05)
    noise = np.random.default_rng(2).normal(size=excitation.command.size)
    coherences = [
        frequency_response(
            excitation.command, excitation.command + level * noise, TS, excitation=excitation,
            distortion_limit=np.inf).coherence[0]
        for level in (0.0, 0.1, 3.0)]
    assert coherences[0] > 0.999999
    assert coherences[0] > coherences[1] > coherences[2]
    assert coherences[2] < 0.95


def test_a_multisine_gives_the_same_response_as_the_truth():
    excitation = multisine(100.0, odd_lines(120), 0.5, TS, periods=4)
    _, displacement = play(excitation)
    found = frequency_response(excitation.command, displacement, TS, excitation=excitation)
    assert np.max(np.abs(found.response / true_response(found.frequency_hz) - 1.0)) < 1e-7
    assert found.distortion.max() < 1e-6


def test_points_at_which_the_amplifier_slews_are_left_out_and_listed():
    excitation = stepped_sine(np.geomspace(500.0, 9000.0, 12), 0.5, TS, dwell_s=0.02)
    limits = Amplifier(slew_limit_v_per_s=SLEW_LIMIT_V_PER_S)
    plants = [RigParameters(noise_rms_um=0.0, slew_limit_v_per_s=limit)
              for limit in (SLEW_LIMIT_V_PER_S, 0.0)]
    voltage, displacement = play(excitation, plants[0])
    found = frequency_response(
        excitation.command, displacement, TS, excitation=excitation, voltage_v=voltage,
        amplifier=limits)
    _, free = play(excitation, plants[1])
    unlimited = frequency_response(excitation.command, free, TS, excitation=excitation)
    by_frequency = dict(zip(unlimited.frequency_hz, unlimited.response, strict=True))
    kept = np.array([by_frequency[frequency] for frequency in found.frequency_hz])
    assert np.max(np.abs(found.response / kept - 1.0)) < 1e-3
    assert found.frequency_hz.size + len(found.excluded) == 12
    assert len(found.excluded) >= 2
    for point in found.excluded:
        assert point.frequency_hz > found.frequency_hz.max()
        assert point.amplitude == pytest.approx(0.5, rel=0.02)
        assert '0.189 V per sample' in point.reason


def test_points_at_which_the_voltage_is_at_a_rail_are_left_out_and_listed():
    excitation = stepped_sine([100.0, 200.0], [0.5, 2.0], TS, dwell_s=0.02)
    voltage, displacement = play(excitation)
    found = frequency_response(
        excitation.command, displacement, TS, excitation=excitation, voltage_v=voltage,
        amplifier=Amplifier(voltage_minimum_v=-1.0, voltage_maximum_v=1.0))
    assert found.frequency_hz == pytest.approx([100.0], rel=1e-3)
    assert 'saturates' in found.excluded[0].reason
    assert found.excluded[0].frequency_hz == pytest.approx(200.0, rel=1e-3)


def test_a_distorted_point_is_left_out_and_listed():
    excitation = stepped_sine([100.0, 1000.0], 0.5, TS, dwell_s=0.02)
    output = excitation.command.copy()
    window = excitation.windows[1]
    part = slice(window.start, window.stop)
    output[part] = np.clip(output[part], -0.25, 0.25)
    found = frequency_response(excitation.command, output, TS, excitation=excitation)
    assert found.frequency_hz == pytest.approx([100.0], rel=1e-3)
    assert 'distorted by 0.2' in found.excluded[0].reason


def test_distortion_of_a_multisine_appears_between_its_lines():
    excitation = multisine(100.0, odd_lines(60), 0.5, TS, periods=4)
    output = excitation.command + 0.5 * excitation.command**3
    found = frequency_response(
        excitation.command, output, TS, excitation=excitation, distortion_limit=np.inf)
    clean = frequency_response(
        excitation.command, excitation.command, TS, excitation=excitation)
    assert found.distortion[0] > 0.003
    assert clean.distortion[0] < 1e-9


def test_merged_records_are_in_order_and_keep_what_was_left_out():
    parts = []
    for frequency, amplitude in ((3000.0, 0.5), (100.0, 0.3)):
        excitation = stepped_sine([frequency, 2 * frequency], amplitude, TS, dwell_s=0.01)
        voltage, displacement = play(excitation)
        parts.append(frequency_response(
            excitation.command, displacement, TS, excitation=excitation, voltage_v=voltage,
            amplifier=Amplifier(slew_limit_v_per_s=SLEW_LIMIT_V_PER_S)))
    together = merge(parts)
    assert together.frequency_hz == pytest.approx([100.0, 200.0, 3000.0], rel=2e-2)
    assert together.amplitude == pytest.approx([0.3, 0.3, 0.5], rel=0.02)
    assert [round(point.frequency_hz, -2) for point in together.excluded] == [6000.0]


def test_records_of_unlike_sample_periods_are_not_merged():
    responses = []
    for period in (1e-5, 2e-5):
        excitation = stepped_sine([100.0], 1.0, period, dwell_s=0.02)
        responses.append(frequency_response(
            excitation.command, excitation.command, period, excitation=excitation))
    with pytest.raises(ValueError, match='sample_period_s 2e-05'):
        merge(responses)


SINE = np.sin(2.0 * np.pi * 0.01 * np.arange(1000))


@pytest.mark.parametrize(('arguments', 'words'), [
    ((SINE, SINE[1:], [Window(0, 900, 1000.0)]), 'output has 999 samples and input_ 1000'),
    ((SINE, np.where(np.arange(1000) % 2 == 0, np.nan, SINE), [Window(0, 900, 1000.0)]),
     'no point is left: 450 of 900 samples are lost'),
    ((SINE, SINE, [Window(500, 1001, 1000.0)]), 'not inside the record of 1000 samples'),
    ((SINE, SINE, [Window(0, 1000, 2000.0)]), 'does not contain 2000 Hz'),
    ((SINE, SINE, [Window(0, 50, 1000.0)]), '0.5 periods'),
    ((SINE, SINE, []), 'no window'),
])
def test_a_record_that_cannot_be_evaluated_is_refused_by_name(arguments, words):
    input_, output, windows = arguments
    with pytest.raises(ValueError, match=words):
        frequency_response(input_, output, TS, excitation=windows)


def test_a_record_of_which_nothing_is_left_says_why():
    with pytest.raises(ValueError, match='no point is left: slews'):
        frequency_response(
            SINE, SINE, TS, excitation=[Window(0, 1000, 1000.0)],
            amplifier=Amplifier(slew_limit_v_per_s=1.0))


@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize('stream', ['command', 'displacement'])
def test_d8_one_sample_that_is_not_finite_costs_no_other_frequency(stepped, value, stream):
    excitation, _, displacement = stepped
    record = {'command': excitation.command.copy(), 'displacement': displacement.copy()}
    window = excitation.windows[1]
    record[stream][[10, window.start + 50]] = value
    found = frequency_response(
        record['command'], record['displacement'], TS, excitation=excitation)
    expected = true_response(found.frequency_hz)
    assert found.frequency_hz.size == 4
    assert np.max(np.abs(found.response / expected - 1.0)) < 1e-7
    assert found.samples_lost == 2
    inside, outside = found.losses
    assert inside.startswith(f'{window.fundamental_hz:g} Hz: 1 of ')
    assert outside.startswith('outside of all frequencies: 1 samples are lost, from sample 10 to')


def test_d8_a_frequency_of_which_too_much_is_lost_is_left_out_with_the_reason(stepped):
    excitation, _, displacement = stepped
    gap = displacement.copy()
    window = excitation.windows[2]
    gap[window.start:window.start + 9 * (window.stop - window.start) // 10] = np.nan
    found = frequency_response(excitation.command, gap, TS, excitation=excitation)
    assert found.frequency_hz.size == 3
    (left_out,) = found.excluded
    assert left_out.frequency_hz == window.fundamental_hz
    assert 'samples are lost' in left_out.reason


def test_d8_of_a_multisine_the_periods_that_are_touched_are_dropped():
    excitation = multisine(100.0, odd_lines(60), 0.5, TS, periods=6)
    _, displacement = play(excitation)
    (window,) = excitation.windows
    gap = displacement.copy()
    gap[window.start + 1300:window.start + 1900] = np.nan  # within the second period
    found = frequency_response(excitation.command, gap, TS, excitation=excitation)
    assert np.max(np.abs(found.response / true_response(found.frequency_hz) - 1.0)) < 1e-7
    assert found.samples_used == 5000
    assert found.samples_lost == 600
    assert found.excluded == ()


def test_d8_scattered_losses_leave_every_frequency_with_an_honest_variance():
    excitation = stepped_sine([100.0, 1000.0, 3000.0], 0.5, TS, dwell_s=0.1)
    generator = np.random.default_rng(11)
    inside = []
    for _ in range(60):
        output = excitation.command + 1e-3 * generator.normal(size=excitation.command.size)
        output[generator.choice(output.size, 200)] = np.nan
        found = frequency_response(
            excitation.command, output, TS, excitation=excitation, distortion_limit=np.inf)
        inside.append(np.abs(found.response - 1.0) < found.confidence_radius)
    assert np.shape(inside) == (60, 3)
    assert 0.9 < np.mean(inside) < 1.0


def test_d8_a_limit_that_is_reached_for_a_moment_costs_the_periods_around_it():
    excitation = stepped_sine([1000.0], 0.5, TS, dwell_s=0.1)
    voltage, displacement = play(excitation)
    (window,) = excitation.windows
    at = window.start + 5000
    voltage[at], displacement[at:at + 50] = 9.0, 0.0
    found = frequency_response(
        excitation.command, displacement, TS, excitation=excitation, voltage_v=voltage,
        amplifier=Amplifier(voltage_maximum_v=8.0))
    assert np.max(np.abs(found.response / true_response(found.frequency_hz) - 1.0)) < 1e-7
    assert 0.85 < found.samples_used / (window.stop - window.start) < 1.0
