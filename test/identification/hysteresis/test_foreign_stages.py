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

"""Stages that share no code with the package: identified, compensated, judged."""

import itertools

import numpy as np
import pytest

from piezo_ros.identification.hysteresis.hysteresis_fit import (
    fit_hysteresis,
    fit_hysteresis_records,
)
from piezo_ros.identification.hysteresis.records import (
    make_records,
    record_of_blocks,
    reduced,
    turns_of,
)

REACH_V = 10.0
SHARES = np.linspace(1.0, 0.1, 10)


def triangle(amplitudes_v, samples_per_period=400):
    corners = [0.0]
    for amplitude in amplitudes_v:
        corners += [amplitude, -amplitude]
    corners.append(0.0)
    quarter = samples_per_period // 4
    lengths = [quarter, *[2 * quarter] * (len(corners) - 3), quarter]
    return np.interp(
        np.arange(sum(lengths) + 1), np.concatenate(([0], np.cumsum(lengths))), corners)


def plays(thresholds_v, voltage_v):
    state, out = np.zeros(len(thresholds_v)), []
    for voltage in voltage_v:
        state = np.maximum(voltage - thresholds_v, np.minimum(voltage + thresholds_v, state))
        out.append(state)
    return np.array(out)


def superposition(elements, seed=0, reach_v=REACH_V, travel_um=12.0):
    rng = np.random.default_rng(seed)
    thresholds = reach_v * np.sort(rng.uniform(0.01, 0.8, elements))
    weights = 0.6 * rng.uniform(0.2, 1.0, elements) / elements
    scale = 0.4 * travel_um / reach_v
    return lambda voltage_v: scale * (voltage_v + plays(thresholds, voltage_v) @ weights)


def skewed(voltage_v):
    x = superposition(12, seed=1)(voltage_v) / 6.0
    return 6.0 * (x + 0.06 * x**2 - 0.03 * x**3)


def bouc_wen(voltage_v):
    h, out = 0.0, [0.0]
    for before, now in itertools.pairwise(voltage_v):
        for _ in range(20):
            step = (now - before) / 20.0
            h += 0.35 * step - 0.25 * abs(step) * h - 0.05 * step * abs(h)
        out.append(now - h)
    return 0.6 * np.array(out)


def preisach(voltage_v):
    grid = (np.arange(60) + 0.5) / 30.0 - 1.0
    up, down = np.meshgrid(grid, grid, indexing='ij')
    up, down = 10.2 * up[up >= down], 10.2 * down[up >= down]
    weight = np.exp(-((up + down) / 10.0) ** 2 / 2.0 - ((up - down) / 6.0) ** 2 / 2.0)
    state, out = np.where(up + down > 0.0, -1.0, 1.0), []
    for voltage in voltage_v:
        state = np.where(voltage >= up, 1.0, np.where(voltage <= down, -1.0, state))
        out.append(weight @ state / weight.sum())
    return 0.33 * voltage_v + 2.7 * np.array(out)


def recorded(stage, noise_um=1e-3, step_um=0.0, amplitudes_v=REACH_V * SHARES, **options):
    voltage_v = triangle(amplitudes_v)
    displacement_um = stage(voltage_v)
    displacement_um = displacement_um + noise_um * np.random.default_rng(5).normal(
        size=voltage_v.size)
    if step_um:
        displacement_um = step_um * np.round(displacement_um / step_um)
    return fit_hysteresis(voltage_v, displacement_um, **options)


def widest_gap_percent(input_, output):
    """The width of the last loop, percent of its span, without the code under test."""
    high = int(np.argmax(input_[len(input_) // 2:])) + len(input_) // 2
    low = high - len(input_) // 4
    down, up = slice(high, high + len(input_) // 4), slice(low, high)
    common = np.linspace(-0.9, 0.9, 50) * input_.max()
    rising = np.interp(common, input_[up], output[up])
    falling = np.interp(-common[::-1], -input_[down], output[down])[::-1]
    return 100.0 * np.abs(rising - falling).max() / np.ptp(output)


def left_percent(fit, stage, share):
    """Compensate a triangle at this share of the range; return the loop that is left."""
    wanted_um = triangle(np.ones(2)) * fit.model.forward([share * REACH_V])[0][0]
    voltage_v = fit.model.inverse(wanted_um)[0]
    return widest_gap_percent(wanted_um, stage(voltage_v))


@pytest.mark.parametrize('elements', [pytest.param(5, marks=pytest.mark.slow), 20])
def test_loops_of_every_amplitude_are_straight_behind_the_inverse(elements):
    stage = superposition(elements)
    fit = recorded(stage)
    for share in (0.95, 0.5, 0.2, 0.1):
        assert left_percent(fit, stage, share) < 0.15, share
    assert fit.verdict.word == 'good'
    assert not fit.parameters.asymmetry_weight


def test_d13_the_number_of_elements_does_for_small_loops_too():
    stage = superposition(20, seed=5)
    fit = recorded(stage, elements='auto')
    assert left_percent(fit, stage, 0.1) < 0.15
    assert max(level.percent for level in fit.validation.levels) < 0.15


@pytest.mark.parametrize(('noise_um', 'step_um'), [
    pytest.param(1e-4, 0.0, marks=pytest.mark.slow), (1e-3, 0.01)])
def test_neither_a_quiet_nor_a_coarse_sensor_makes_a_loop(noise_um, step_um):
    stage = superposition(5)
    fit = recorded(stage, noise_um, step_um)
    for share in (0.95, 0.3, 0.1):
        assert left_percent(fit, stage, share) < 0.15
    assert fit.verdict.word == 'good'


def test_a_stage_with_asymmetric_loops_gets_an_asymmetric_inverse():
    fit = recorded(skewed)
    assert fit.parameters.asymmetry_weight
    for share in (0.9, 0.5, 0.2, 0.1):
        assert left_percent(fit, skewed, share) < 0.5, share
    assert fit.verdict.word == 'good'


@pytest.mark.parametrize('stage', [
    preisach, pytest.param(bouc_wen, marks=pytest.mark.slow)])
def test_where_the_class_of_the_model_is_the_limit_the_verdict_says_so(stage):
    fit = recorded(stage)
    assert max(left_percent(fit, stage, share) for share in (0.9, 0.5, 0.2, 0.1)) > 0.5
    assert fit.verdict.word != 'good'
    assert 'the model class is the limit' in str(fit.verdict)
    assert fit.validation.worst_percent > 0.5


@pytest.mark.slow
def test_too_few_elements_are_told_from_a_wrong_model():
    fit = recorded(superposition(20), elements=1)
    assert '1 elements are too few' in str(fit.verdict)
    assert '--elements auto' in str(fit.verdict)


@pytest.mark.slow  # a fit for each step of the drift
def test_a_drift_is_found_and_is_no_hysteresis():
    stage = superposition(5)
    fit = recorded(lambda u: stage(u) + 0.05 * np.arange(u.size) / u.size)
    assert fit.drift_um_per_sample * fit.voltage_v.size == pytest.approx(0.05, rel=0.05)
    assert left_percent(fit, stage, 0.1) < 0.15
    assert 'drift' in str(fit.verdict)


def test_rate_dependence_is_named_where_one_amplitude_has_two_speeds():
    amplitudes = REACH_V * np.array([1.0, 0.8, 0.6, 0.4, 0.2, 0.1])
    fast, slow = triangle(amplitudes), triangle(amplitudes, 1600)
    voltage_v = np.concatenate((fast, slow))
    noise_um = 1e-3 * np.random.default_rng(0).normal(size=voltage_v.size)
    for weight_of_fast, depends in ((1.0, False), (1.2, True)):
        weight = np.where(np.arange(voltage_v.size) < fast.size, weight_of_fast, 1.0)
        loops_um = 0.2 * weight * plays(np.array([1.0, 3.0]), voltage_v).sum(axis=1)
        fit = fit_hysteresis(voltage_v, 0.4 * voltage_v + loops_um + noise_um)
        assert ('rate dependence' in str(fit.verdict)) == depends
        assert (fit.verdict.word == 'good') != depends


def test_a_memoryless_stage_gets_no_loop():
    voltage_v = triangle([3.0, 3.0])
    fit = recorded(lambda u: 0.6 * u)
    assert widest_gap_percent(voltage_v, fit.model.forward(voltage_v)[0]) < 0.05


@pytest.mark.parametrize(('voltage_v', 'virgin', 'message'), [
    (np.interp(np.arange(1001), [0, 500, 1000], [0, 100, 0]), False,
     'does not turn after its largest value, 100 V: a single branch cannot tell'),
    (np.linspace(0.0, 100.0, 1000), True, 'voltage_v does not turn: a single branch'),
    (np.linspace(100.0, 0.0, 1000), False, 'does not turn after its largest value'),
])
def test_d11_a_single_branch_is_refused_and_no_loop_invented(voltage_v, virgin, message):
    with pytest.raises(ValueError, match=message):
        fit_hysteresis(voltage_v, 0.1 * voltage_v + 2e-5 * voltage_v**2, virgin=virgin)


def test_d11_a_used_stage_is_told_by_one_more_turn():
    voltage_v = np.interp(np.arange(1501), [0, 500, 1000, 1500], [0, 100, 0, 100])
    noise_um = 1e-3 * np.random.default_rng(0).normal(size=voltage_v.size)
    fit = fit_hysteresis(voltage_v, 0.1 * voltage_v + noise_um, virgin=False)
    model_um = fit.model.forward(voltage_v)[0]
    assert np.abs(model_um[500:1001] - model_um[1500:999:-1]).max() < 0.01


def test_a_record_that_is_smaller_than_the_range_of_use_limits_the_verdict():
    fit = recorded(superposition(5), elements=5, range_v=(-20.0, 20.0))
    assert fit.verdict.word == 'usable up to'
    assert '-20 … 20 V asked for' in str(fit.verdict)


def test_d13_a_bag_in_blocks_is_reduced_to_its_branches_and_all_of_its_turns():
    stage = superposition(5)
    corners = triangle(REACH_V * SHARES, 40)
    samples = 600_000
    at = np.linspace(0.0, corners.size - 1.0, samples)
    voltage_v = np.interp(at, np.arange(corners.size), corners)
    # The stage is rate-independent: its displacement on few points, which show every bend well.
    fine = triangle(REACH_V * SHARES, 4000)
    displacement_um = np.interp(at / at[-1], np.linspace(0.0, 1.0, fine.size), stage(fine))
    displacement_um = np.concatenate((np.zeros(37), displacement_um[:-37]))  # a delay
    blocks = [slice(k, k + 70_001) for k in range(0, samples, 70_001)]
    record = record_of_blocks(
        ((voltage_v[part], displacement_um[part]) for part in blocks), samples)
    assert record.voltage_v.size < 210_000
    assert record.weight.sum() == samples
    assert record.voltage_v.max() == voltage_v.max()
    assert record.voltage_v.min() == voltage_v.min()
    coarse = record_of_blocks(
        ((voltage_v[part], displacement_um[part]) for part in blocks), samples, every=50)
    assert coarse.voltage_v.size < 15_000
    assert coarse.voltage_v.max() == voltage_v.max()
    for each in (record, coarse):
        fit = fit_hysteresis_records([each])
        assert fit.delay_samples == pytest.approx(37.0, abs=1.5)  # samples of the recording
        assert left_percent(fit, stage, 0.1) < 0.15
        assert fit.samples_used > 0.9 * samples


def test_a_noisy_reading_of_the_voltage_is_reduced_all_the_same():
    voltage_v = triangle(REACH_V * SHARES, 40_000)
    noise_v = 1e-3 * np.random.default_rng(0).normal(size=voltage_v.size)
    record = record_of_blocks(
        [(voltage_v + noise_v, superposition(1)(voltage_v[::100]).repeat(100)[:voltage_v.size])],
        voltage_v.size, every=100)
    assert record.voltage_v.size < 20_000


def test_turns_that_follow_each_other_faster_than_bins_stay_in_part():
    stage = superposition(5)
    voltage_v = triangle(REACH_V * np.linspace(1.0, 0.1, 1000), 40)  # bins of 21, a turn in each
    noise_um = 1e-3 * np.random.default_rng(0).normal(size=voltage_v.size)
    record = make_records(voltage_v, stage(voltage_v) + noise_um)[0]
    few = reduced(record, 2000)
    assert np.count_nonzero(few.weight) < 2500
    assert few.voltage_v.size < 10_000
    assert np.isin(voltage_v[turns_of(voltage_v)], few.voltage_v).all()
    used = few.index[few.weight > 0.0]
    assert np.diff(used).max() < 0.1 * voltage_v.size  # from the whole run
    fit = fit_hysteresis_records([few])
    assert left_percent(fit, stage, 0.95) < 0.15
    assert left_percent(fit, stage, 0.2) < 0.3


def test_loops_that_grow_serve_as_well_as_loops_that_shrink():
    stage = superposition(8, seed=2)
    fit = recorded(stage, amplitudes_v=REACH_V * SHARES[::-1])
    for share in (0.95, 0.3, 0.1):
        assert left_percent(fit, stage, share) < 0.15


def test_the_offset_of_loops_is_told_from_the_reading_at_rest():
    stage = superposition(5)
    assert recorded(stage).loop_offset_um == 0.0

    def moved(voltage_v):  # once it moves, it is elsewhere
        return stage(voltage_v) + 0.05 * (np.arange(voltage_v.size) > 2)
    assert recorded(moved).loop_offset_um == pytest.approx(0.05, abs=0.005)
