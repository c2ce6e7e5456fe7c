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
from hypothesis.extra.numpy import arrays

from piezo_ros.paper import KAPPA_UM_PER_V, SATURATION_V
from piezo_ros.report import nonlinearity, nrmse
from piezo_ros.report.metrics import tail

micrometres = st.floats(-100.0, 100.0, allow_nan=False)


@st.composite
def signals(draw):
    signal = draw(arrays(np.float64, st.integers(2, 50), elements=micrometres))
    signal[0], signal[-1] = -101.0, 101.0  # never constant
    return signal


def triangle(amplitude, samples_per_period, periods):
    phase = np.arange(periods * samples_per_period + 1) / samples_per_period
    return amplitude * 2 / np.pi * np.arcsin(np.sin(2 * np.pi * phase))


def stop_operator_displacement(voltage):
    """Table 1 driven by voltage: bisection on the published inverse, one sample at a time."""
    kappa, limit = np.array(KAPPA_UM_PER_V), np.array(SATURATION_V)
    stops, x, out = np.zeros_like(limit), 0.0, []
    for u in voltage:
        low, high = x - 20.0, x + 20.0
        for _ in range(60):
            middle = (low + high) / 2
            held = np.clip(stops + (middle - x) / kappa[:-1], -limit, limit)
            low, high = (
                (low, middle) if middle / kappa[-1] + held.sum() > u else (middle, high))
        stops, x = np.clip(stops + (middle - x) / kappa[:-1], -limit, limit), middle
        out.append(x)
    return np.array(out)


def test_nrmse_of_a_known_error():
    reference = np.array([-2.5, 2.5, -2.5, 2.5])
    assert nrmse(reference, reference + np.array([0.3, -0.4, 0.4, -0.3])) == pytest.approx(
        np.sqrt((0.09 + 0.16) / 2) / 5)


@given(signals())
def test_nrmse_of_a_perfect_copy_is_zero(reference):
    assert nrmse(reference, reference) == 0.0


@given(signals(), micrometres)
def test_nrmse_of_a_constant_offset_is_the_offset_over_peak_to_peak(reference, offset):
    assert nrmse(reference, reference + offset) == pytest.approx(abs(offset) / 202.0, abs=1e-12)


@given(signals(), st.floats(0.01, 100.0), micrometres, st.integers(0, 2**32 - 1))
def test_nrmse_does_not_depend_on_unit_sign_and_origin(reference, factor, offset, seed):
    measured = reference + np.random.default_rng(seed).normal(size=reference.size)
    assert nrmse(offset - factor * reference, offset - factor * measured) == pytest.approx(
        nrmse(reference, measured), rel=1e-6)


@pytest.mark.parametrize('metric', [nrmse, nonlinearity])
@pytest.mark.parametrize(('first', 'second', 'words'), [
    ([1.0, 2.0], [1.0], r'\(2,\).*\(1,\)'),
    ([[1.0, 2.0]], [[1.0, 2.0]], r'\(1, 2\)'),
    (1.0, 1.0, r'shape \(\)'),
    ([], [], 'empty'),
    ([1.0, np.nan], [1.0, 2.0], r'\[1\] is nan'),
    ([1.0, 2.0], [np.inf, 2.0], r'\[0\] is inf'),
    ([3.5, 3.5], [1.0, 2.0], r'constant at 3\.5'),
])
def test_a_bad_array_is_refused_by_name_and_value(metric, first, second, words):
    with pytest.raises(ValueError, match=words):
        metric(first, second)


def test_loop_of_table_1_has_the_published_nonlinearity():
    voltage = triangle(3.0, 400, 2)
    result = nonlinearity(voltage, stop_operator_displacement(voltage))
    assert result.input == pytest.approx(0.1178, abs=5e-5)
    assert result.output == pytest.approx(0.1237, abs=5e-5)


def test_a_parallelogram_has_the_width_it_was_given():
    # Backlash of 0.5 um behind a gain of 2 um/V: 0.5 V wide, and 1 um high, at +-5 V.
    voltage = triangle(5.0, 200, 3)
    displacement, out = 0.0, []
    for u in voltage:
        displacement = min(max(displacement, 2 * u - 0.5), 2 * u + 0.5)
        out.append(displacement)
    result = nonlinearity(voltage, out)
    assert result.input == pytest.approx(0.5 / 10)
    assert result.output == pytest.approx(1.0 / 19)


@given(st.floats(0.1, 10.0), st.floats(-5.0, 5.0))
def test_a_straight_line_has_no_nonlinearity(gain, offset):
    voltage = triangle(3.0, 100, 2)
    assert nonlinearity(voltage, gain * voltage + offset) == pytest.approx((0.0, 0.0), abs=1e-9)


@given(st.floats(0.01, 100.0), st.floats(0.01, 100.0), st.floats(-10.0, 10.0))
def test_nonlinearity_does_not_depend_on_units_and_operating_point(volt, micrometre, offset):
    voltage = triangle(3.0, 100, 2)
    displacement = np.roll(voltage, 3)
    assert nonlinearity(volt * voltage + offset, micrometre * displacement - offset) == (
        pytest.approx(nonlinearity(voltage, displacement), rel=1e-6))


def test_only_the_last_whole_loop_counts():
    voltage = triangle(3.0, 200, 4)
    displacement = voltage + 0.1 * np.sign(np.gradient(voltage))
    displacement[:400] += np.linspace(1.0, 0.0, 400)  # creep of the first two loops
    displacement[-20:] += 1.0  # after the last turn but one
    clean = nonlinearity(voltage, voltage + 0.1 * np.sign(np.gradient(voltage)))
    assert nonlinearity(voltage, displacement).input == pytest.approx(clean.input)


@pytest.mark.parametrize('start', ['upper', 'lower'])
def test_a_record_of_exactly_one_loop_is_enough(start):
    voltage = np.abs(np.arange(-50, 51)) / 10.0 * (1 if start == 'upper' else -1)
    displacement = voltage + np.where(np.arange(101) < 50, 0.25, -0.25)
    assert nonlinearity(voltage, displacement).output == pytest.approx(0.5 / 5, rel=0.2)


def test_less_than_a_loop_is_refused():
    voltage = np.concatenate((np.linspace(0, 3, 50), np.linspace(3, -3, 100)))
    with pytest.raises(ValueError, match='without one whole loop'):
        nonlinearity(voltage, voltage)


def test_noise_and_converter_steps_widen_the_loop_by_no_more_than_they_are_wide():
    voltage = np.round(triangle(3.0, 10_000, 2), 3)
    noise_um = np.random.default_rng(1).uniform(-1e-3, 1e-3, voltage.size)
    result = nonlinearity(voltage, np.round(voltage + noise_um, 4))
    assert 0 < result.output <= 2.2e-3 / 6
    assert 0 < result.input <= 3.2e-3 / 6


@pytest.mark.parametrize(('frequency_hz', 'sample_period_s', 'periods', 'count'), [
    (300.0, 1e-5, 4, 1333),
    (500.0, 1e-5, 4, 800),
    (800.0, 1e-5, 4, 500),
    (700.0, 1e-5, 4, 571),
    (1.0, 1e-4, 1, 10_000),
])
def test_tail_is_the_last_whole_samples_of_the_periods(
        frequency_hz, sample_period_s, periods, count):
    assert tail(12_345, frequency_hz, sample_period_s, periods) == slice(12_345 - count, 12_345)


@given(st.integers(1, 2000), st.integers(1, 20))
def test_tail_of_an_integer_ratio_loses_no_sample(samples_per_period, periods):
    for sample_period_s in (1e-5, 1e-4, 3e-5):
        frequency_hz = 1 / (samples_per_period * sample_period_s)
        window = tail(50_000, frequency_hz, sample_period_s, periods)
        assert window.stop - window.start == samples_per_period * periods


@pytest.mark.parametrize(('arguments', 'words'), [
    ((1332, 300.0, 1e-5, 4), '1333 samples.*has 1332'),
    ((100, 300.0, 1e-5, 1e-6), '0 samples'),
    ((100, 0.0, 1e-5, 4), 'frequency_hz is 0.0'),
    ((100, 300.0, float('nan'), 4), 'sample_period_s is nan'),
    ((100, 300.0, 1e-5, -1), 'periods is -1'),
])
def test_a_window_that_cannot_be_taken_is_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        tail(*arguments)
