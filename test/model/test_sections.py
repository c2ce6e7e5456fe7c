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


"""Any linear dynamics around the hysteresis, against the plain mathematics of scipy."""

import numpy as np
import pytest
from scipy import signal

from piezo_ros.control import TrajectoryParameters
from piezo_ros.model import (
    DynamicsParameters,
    LinearDynamics,
    MaxwellResistiveCapacitor,
    ParameterError,
    Rig,
    RigParameters,
)
from piezo_ros.model.rig import rig_constants
from piezo_ros.model.state_space import frequency_response

TS = 1e-4
IDEAL = {
    'noise_rms_um': 0.0, 'dac_bits': 0, 'adc_bits': 0, 'voltage_minimum_v': -50.0,
    'voltage_maximum_v': 50.0, 'adc_span_v': 1000.0}
STAGE = {
    'dynamics': 'sections', 'gain_um_per_um': 0.9, 'pole_rates_rad_per_s': [2500.0, 9000.0],
    'pole_frequencies_rad_per_s': [5000.0, 7500.0], 'pole_damping_ratios': [0.03, 0.4],
    'zero_rates_rad_per_s': [-20000.0], 'zero_frequencies_rad_per_s': [6000.0],
    'zero_damping_ratios': [0.02]}
NO_HYSTERESIS = {'kappa_um_per_v': [1.0, 1.0], 'saturation_v': [0.0]}
FREQUENCY_HZ = np.geomspace(1.0, 4000.0, 100)


def factors(values, kind):
    """The polynomials of the zeros or poles, by numpy."""
    found = [[1.0 / rate, 1.0] for rate in values.get(f'{kind}_rates_rad_per_s', ())]
    return found + [
        [1.0 / w**2, 2.0 * z / w, 1.0] for w, z in zip(
            values.get(f'{kind}_frequencies_rad_per_s', ()),
            values.get(f'{kind}_damping_ratios', ()), strict=True)]


def product(polynomials):
    result = np.ones(1)
    for polynomial in polynomials:
        result = np.polymul(result, polynomial)
    return result


def truth(values, frequency_hz):
    s = 2j * np.pi * np.asarray(frequency_hz)
    numerator, denominator = (
        np.prod([np.polyval(factor, s) for factor in factors(values, kind)], axis=0)
        for kind in ('zero', 'pole'))
    return values.get('gain_um_per_um', 1.0) * numerator / denominator * np.exp(
        -s * values.get('delay_s', 0.0))


def fine_rig(values, inputs, steps):
    """Simulate before, H and behind with many steps per sample; the displacement at samples."""
    p = DynamicsParameters.from_mapping(values)
    poles = factors(values, 'pole')
    rates = len(values.get('pole_rates_rad_per_s', ()))
    first = [*poles[:p.rates_before_hysteresis], *poles[rates:rates + p.pairs_before_hysteresis]]
    last = [pole for pole in poles if pole not in first]
    h = TS / steps
    held = np.repeat(inputs, steps)
    late = round(values.get('delay_s', 0.0) / h)
    held = np.concatenate([np.zeros(late), held])[:held.size]
    if first:
        *system, _ = signal.cont2discrete(signal.tf2ss([1.0], product(first)), h, 'zoh')
        held = signal.dlsim((*system, h), np.append(held, 0.0))[1][1:, 0]
    free, _ = MaxwellResistiveCapacitor().forward(held)
    hold = 'foh' if first else 'zoh'
    gain = values.get('gain_um_per_um', 1.0)
    *system, _ = signal.cont2discrete(
        signal.tf2ss(gain * product(factors(values, 'zero')), product(last)), h, hold)
    output = signal.dlsim((*system, h), free if first else np.append(free, 0.0))[1][:, 0]
    return output[steps - 1::steps] if first else output[steps::steps]


PLACES = [(0, 1), (1, 0), (1, 1), (2, 0), (0, 0)]
either_engine = pytest.mark.parametrize('compiled', [False, True])


@pytest.mark.parametrize(('rates', 'pairs'), PLACES)
@pytest.mark.parametrize('delay_s', [0.0, 2.5e-4])
def test_the_response_of_any_sections_is_that_of_their_factors(rates, pairs, delay_s):
    values = {**STAGE, 'delay_s': delay_s, 'rates_before_hysteresis': rates,
              'pairs_before_hysteresis': pairs}
    dynamics = LinearDynamics(DynamicsParameters.from_mapping(values))
    np.testing.assert_allclose(
        dynamics.response(FREQUENCY_HZ), truth(values, FREQUENCY_HZ), rtol=1e-10)
    s = 2j * np.pi * FREQUENCY_HZ
    halves = frequency_response(dynamics.before_hysteresis, s) * frequency_response(
        dynamics.behind_hysteresis, s)
    np.testing.assert_allclose(halves * np.exp(-s * delay_s), truth(values, FREQUENCY_HZ),
                               rtol=1e-9)
    numerator, denominator = dynamics.polynomials
    np.testing.assert_allclose(
        np.polyval(numerator, s) / np.polyval(denominator, s) * np.exp(-s * delay_s),
        truth(values, FREQUENCY_HZ), rtol=1e-8)


@pytest.mark.parametrize('delay_s', [0.0, 0.3 * TS, 2.0 * TS, 3.7 * TS])
def test_the_sampled_response_has_hold_and_delay(delay_s):
    values = {**STAGE, 'delay_s': delay_s}
    dynamics = LinearDynamics(DynamicsParameters.from_mapping(values))
    # Ten times as many steps as the delay has parts of: the same plant behind a held input.
    steps = 10
    *system, _ = signal.cont2discrete(
        signal.tf2ss(0.9 * product(factors(STAGE, 'zero')), product(factors(STAGE, 'pole'))),
        TS / steps, 'zoh')
    impulse = np.zeros(1200 * steps)
    late = round(delay_s / TS * steps)
    impulse[late:late + steps] = 1.0
    response = signal.dlsim((*system, TS / steps), impulse)[1][::steps, 0]
    frequency_hz = np.array([3.0, 100.0, 795.0, 3000.0])
    z = np.exp(-2j * np.pi * frequency_hz[:, None] * TS * np.arange(response.size))
    np.testing.assert_allclose(
        dynamics.sampled_response(frequency_hz, TS), z @ response, rtol=1e-5)


@pytest.mark.parametrize('values', [
    {'dynamics': 'sections', 'pole_rates_rad_per_s': [3000.0], 'rates_before_hysteresis': 0},
    {'dynamics': 'sections', 'pole_rates_rad_per_s': [3000.0, 800.0], 'rates_before_hysteresis': 2,
     'delay_s': 3.25 * TS},
    *(pytest.param(
        {**STAGE, 'rates_before_hysteresis': rates, 'pairs_before_hysteresis': pairs,
         'delay_s': delay_s}, marks=[pytest.mark.slow] if rates + pairs != 1 else [])
      for rates, pairs in PLACES for delay_s in (0.0, 1.75 * TS))])
def test_the_rig_is_before_hysteresis_and_behind(values):
    inputs = 3.0 * np.sin(2 * np.pi * 50.0 * TS * np.arange(300))
    rig = RigParameters.from_mapping({**values, **IDEAL})
    measured = Rig(rig, TS).run(inputs)
    expected = fine_rig({'pairs_before_hysteresis': 0, **values}, inputs, 40)
    np.testing.assert_allclose(measured, expected, rtol=0, atol=2e-3 * np.ptp(expected))


@pytest.mark.parametrize('values', [
    {**STAGE, 'delay_s': 3.3e-4},
    {**STAGE, 'rates_before_hysteresis': 2, 'pairs_before_hysteresis': 0, 'delay_s': 0.4e-4},
    {**STAGE, 'order': 'lumped', 'delay_s': 0.9e-4}, {**STAGE, 'creep_per_decade': 0.02},
    {'dynamics': 'sections', 'pole_rates_rad_per_s': [3000.0], 'rates_before_hysteresis': 1},
    {'rates_before_hysteresis': 1, 'pairs_before_hysteresis': 0, 'delay_s': 1.5e-4}])
def test_compiled_or_not_any_stage_gives_the_same_bits(values):
    rig = RigParameters.from_mapping(values)
    inputs = 3.0 * np.sin(np.arange(200) / 7.0) + np.random.default_rng(0).normal(size=200)
    plain, compiled = Rig(rig, TS, compiled=False), Rig(rig, TS)
    assert plain.run(inputs).tobytes() == compiled.run(inputs).tobytes()
    assert plain.state[:-1] == compiled.state[:-1]


@pytest.mark.parametrize('frequency_hz', [100.0, 300.0])
@pytest.mark.parametrize('pairs', [[50e3, 0.8], [50e3, 0.2], [5e5, 0.9], [4e3, 0.7]])
def test_d12_the_hold_behind_a_fast_amplifier_is_within_a_twentieth_of_a_percent(
        frequency_hz, pairs):
    """The output of the amplifier between samples drives the mechanics, not a straight line."""
    values = {
        'dynamics': 'sections', 'pole_frequencies_rad_per_s': [pairs[0], 6000.0],
        'pole_damping_ratios': [pairs[1], 0.3]}
    rig = RigParameters.from_mapping({**values, **IDEAL, **NO_HYSTERESIS})
    samples = round(60.0 / (frequency_hz * TS))
    count = np.arange(samples)
    rotation = np.exp(-2j * np.pi * frequency_hz * TS * count)
    output = Rig(rig, TS).run(np.sin(2 * np.pi * frequency_hz * TS * count))
    half = samples // 2
    # The reading at the end of the sample: one later than the voltage.
    measured = 2.0 * np.mean(output[half:] * rotation[half:]) * 1j
    measured *= np.exp(-2j * np.pi * frequency_hz * TS)
    held = LinearDynamics(DynamicsParameters.from_mapping(values)).sampled_response(
        [frequency_hz], TS)[0]
    assert abs(measured / held - 1.0) < 5e-4


def test_d12_the_published_stage_has_one_step_per_sample():
    assert rig_constants(RigParameters(), 1e-5).substeps == 1
    assert rig_constants(RigParameters(natural_frequency_1_rad_per_s=3e3), 1e-4).substeps == 3
    assert rig_constants(RigParameters(natural_frequency_1_rad_per_s=5e4), 1e-4).substeps == 20


@pytest.mark.parametrize(('values', 'message'), [
    ({'dynamics': 'sections'}, 'dynamics is sections, with 0 poles and 0 zeros'),
    ({'pole_rates_rad_per_s': [1.0]},
     r'pole_rates_rad_per_s is \[1.0\], but dynamics is liu'),
    ({'gain_um_per_um': 2.0}, 'gain_um_per_um is 2.0, but dynamics is liu'),
    ({**STAGE, 'pole_damping_ratios': [0.1]},
     'pole_frequencies_rad_per_s has 2 values and pole_damping_ratios 1'),
    ({**STAGE, 'zero_damping_ratios': []},
     'zero_frequencies_rad_per_s has 1 values and zero_damping_ratios 0'),
    ({**STAGE, 'zero_rates_rad_per_s': [0.0]}, 'zero_rates_rad_per_s is 0.0 rad/s, allowed is'),
    ({**STAGE, 'zero_rates_rad_per_s': [1e4] * 4}, 'with 6 poles and 6 zeros'),
    ({**STAGE, 'pole_rates_rad_per_s': [-5.0]}, 'pole_rates_rad_per_s is -5.0 rad/s, allowed is'),
    ({**STAGE, 'pole_damping_ratios': [0.1, 0.0]}, 'pole_damping_ratios is 0.0, allowed is'),
    ({**STAGE, 'rates_before_hysteresis': 3}, 'rates_before_hysteresis is 3, allowed is 0 … 2'),
    ({**STAGE, 'pairs_before_hysteresis': 2, 'rates_before_hysteresis': 1},
     'leaves 1 poles behind the hysteresis to 3 zeros'),
    ({'pairs_before_hysteresis': 2}, 'leaves 1 poles behind the hysteresis to 2 zeros'),
    ({'rates_before_hysteresis': 2}, 'rates_before_hysteresis is 2, allowed is 0 … 1'),
    ({**STAGE, 'delay_s': -1e-3}, 'delay_s is -0.001 s, allowed is 0'),
])
def test_dynamics_that_cannot_be_are_refused(values, message):
    with pytest.raises(ParameterError, match=message):
        DynamicsParameters.from_mapping(values)


def test_mismatches_of_sections_are_of_the_first_poles_and_refused_where_there_is_none():
    mismatched = RigParameters.from_mapping({
        **STAGE, 'gain_mismatch': 0.1, 'time_constant_mismatch': 0.25,
        'natural_frequency_1_mismatch': -0.1, 'damping_ratio_2_mismatch': 0.5})
    true = mismatched.true_dynamics
    assert true.gain_um_per_um == pytest.approx(0.99)
    assert true.pole_rates_rad_per_s == pytest.approx((2000.0, 9000.0))
    assert true.pole_frequencies_rad_per_s == pytest.approx((4500.0, 7500.0))
    assert true.pole_damping_ratios == pytest.approx((0.03, 0.6))
    assert true.zero_rates_rad_per_s == (-20000.0,)
    with pytest.raises(ParameterError, match='natural_frequency_2_mismatch is 0.1, but the '):
        RigParameters.from_mapping({
            'dynamics': 'sections', 'pole_frequencies_rad_per_s': [1e3],
            'pole_damping_ratios': [0.1], 'natural_frequency_2_mismatch': 0.1})
    with pytest.raises(ParameterError, match='time_constant_mismatch is 0.1, but the sections'):
        RigParameters.from_mapping({
            'dynamics': 'sections', 'pole_frequencies_rad_per_s': [1e3],
            'pole_damping_ratios': [0.1], 'time_constant_mismatch': 0.1})


def test_a_delay_of_a_million_samples_is_refused():
    with pytest.raises(ParameterError, match='delay_s is 10.0 s, allowed is 0 … 0.01 s'):
        rig_constants(RigParameters(delay_s=10.0), 1e-8)


def test_the_feedforward_refuses_a_harmonic_at_an_antiresonance_and_the_usual_ones_avoid_it():
    stage = {
        'dynamics': 'sections', 'pole_frequencies_rad_per_s': [5e3, 1e4],
        'pole_damping_ratios': [0.1, 0.1],
        'zero_frequencies_rad_per_s': [2.0 * np.pi * 900.0], 'zero_damping_ratios': [0.0]}
    message = 'harmonics is 5: at harmonic 3 of 300 Hz, 900 Hz, the model has the gain'
    with pytest.raises(ParameterError, match=message):
        TrajectoryParameters.from_mapping({**stage, 'harmonics': 5})
    assert TrajectoryParameters.from_mapping(stage).harmonics == 1


@pytest.mark.parametrize(('values', 'harmonics'), [
    ({}, 9), ({'sample_period_s': 2e-4}, 7), ({'sample_period_s': 5e-4}, 3),
    ({'sample_period_s': 1.5e-3}, 1), ({'waveform': 'decreasing_triangle'}, 0),
    ({'waveform': 'stepped_sine', 'frequencies_hz': [10.0], 'sample_period_s': 5e-4}, 0)])
def test_d2_harmonics_that_are_not_given_suit_waveform_and_sampling(values, harmonics):
    trajectory = TrajectoryParameters.from_mapping(values)
    assert trajectory.harmonics == harmonics
    assert TrajectoryParameters.from_mapping(trajectory.to_mapping()) == trajectory
    # They are chosen anew with the sampling, given ones are not.
    assert TrajectoryParameters().replaced(**values).harmonics == harmonics
    if 1 < harmonics < 9:
        with pytest.raises(ParameterError, match='harmonic 9 of 300 Hz'):
            TrajectoryParameters(harmonics=9).replaced(**values)
