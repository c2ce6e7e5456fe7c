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

from pathlib import Path

import numpy as np
import pytest
import yaml

from piezo_ros.control.waveform import (
    WaveformParameters,
    reference_step,
    turns_step,
    waveform_constants,
)
from piezo_ros.identification.hysteresis.hysteresis_fit import fit_hysteresis
from piezo_ros.model import (
    HysteresisParameters,
    LinearDynamics,
    MaxwellResistiveCapacitor,
    Rig,
    RigParameters,
)
from piezo_ros.parameters.parameter_file import read_parameter_file
from piezo_ros.report import nonlinearity

SAMPLE_PERIOD_S = 1e-4
# Three elements in the order in which they saturate.
SMALL = MaxwellResistiveCapacitor((3.6, 9.0, 20.0, 1.3), (0.02, 0.1, 0.08))
CONFIG = Path(__file__).parents[3] / 'config'


def drive(waveform, amplitude_v, frequency_hz, periods, sample_period_s=SAMPLE_PERIOD_S):
    parameters = WaveformParameters(
        waveform=waveform, amplitude_um=amplitude_v, frequency_hz=frequency_hz, periods=periods,
        sample_period_s=sample_period_s)
    constants = waveform_constants(parameters)
    return np.array([
        reference_step(constants, turns_step(constants, k)) for k in range(parameters.samples)])


def decreasing(frequency_hz=1.0, amplitude_v=3.0, sample_period_s=SAMPLE_PERIOD_S):
    return drive('decreasing_triangle', amplitude_v, frequency_hz, 10, sample_period_s)


def short():
    """Return the same excitation in a tenth of the samples, for the rate-independent operator."""
    return decreasing(sample_period_s=1e-3)


def noise(samples, rms_um=1e-3, seed=0):
    return rms_um * np.random.default_rng(seed).normal(size=samples)


def in_order_of_saturation(parameters):
    kappa = np.array(parameters.kappa_um_per_v)
    saturation = np.array(parameters.saturation_v)
    order = np.argsort(kappa[:-1] * saturation)
    return np.append(kappa[:-1][order], kappa[-1]), saturation[order]


@pytest.fixture(scope='module')
def configured_rig():
    values = read_parameter_file(CONFIG / 'rig.yaml', ['plant'])['plant']
    return RigParameters.from_mapping(values)


@pytest.fixture(scope='module')
def fit_of_rig(configured_rig):
    voltage = decreasing()
    return fit_hysteresis(voltage, Rig(configured_rig, SAMPLE_PERIOD_S).run(voltage))


def test_the_elements_of_table_1_are_recovered_to_rounding_from_its_own_displacement():
    voltage = decreasing()
    fit = fit_hysteresis(voltage, MaxwellResistiveCapacitor().forward(voltage)[0])
    kappa, saturation = in_order_of_saturation(HysteresisParameters())
    np.testing.assert_allclose(fit.parameters.kappa_um_per_v, kappa, rtol=1e-9)
    np.testing.assert_allclose(fit.parameters.saturation_v, saturation, rtol=1e-9)
    assert fit.rms_um < 1e-12
    assert abs(fit.delay_samples) < 1e-9


def test_lumped_dynamics_without_noise_leave_the_elements_as_they_are():
    ideal = RigParameters(order='lumped', noise_rms_um=0.0, dac_bits=0, adc_bits=0)
    voltage = decreasing()
    fit = fit_hysteresis(voltage, Rig(ideal, SAMPLE_PERIOD_S).run(voltage))
    kappa, saturation = in_order_of_saturation(HysteresisParameters())
    error = np.abs(np.array(fit.parameters.kappa_um_per_v) / (ideal.dc_gain * kappa) - 1.0)
    assert fit.rms_um < 5e-6
    # The element with 0.7 % of the compliance of the first, and its neighbour, show least.
    assert np.sort(error)[:-2].max() < 1e-4
    assert error.max() < 2e-3
    np.testing.assert_allclose(fit.parameters.saturation_v, saturation, rtol=2e-3)


def test_the_compensated_rig_is_as_linear_as_the_published_one(configured_rig, fit_of_rig):
    triangle = drive('triangle', 3.0, 1.0, 3)
    bare = nonlinearity(triangle, Rig(configured_rig, SAMPLE_PERIOD_S).run(triangle))
    assert bare.input == pytest.approx(0.118, abs=0.005)
    assert bare.output == pytest.approx(0.127, abs=0.008)
    model = fit_of_rig.model
    command = triangle / 3.0 * model.forward([3.0])[0][0]
    voltage = model.inverse(command)[0]
    assert voltage.max() == pytest.approx(3.0)
    compensated = nonlinearity(command, Rig(configured_rig, SAMPLE_PERIOD_S).run(voltage))
    assert compensated.input <= 0.0040
    assert compensated.output <= 0.0038


def test_gain_and_lag_of_the_rig_go_where_they_belong(configured_rig, fit_of_rig):
    true = LinearDynamics(configured_rig.true_dynamics)
    gain = true.parameters.dc_gain
    assert fit_of_rig.parameters.kappa_um_per_v[-1] == pytest.approx(
        gain * configured_rig.kappa_um_per_v[-1], rel=3e-4)
    lag_s = -np.angle(true.response([1.0])[0]) / (2.0 * np.pi)
    # The reading of a sample is taken at its end, and the voltage is held over it.
    expected = lag_s / SAMPLE_PERIOD_S - 1.0 + 0.5
    assert fit_of_rig.delay_samples == pytest.approx(expected, abs=0.1)
    assert fit_of_rig.rms_um == pytest.approx(configured_rig.noise_rms_um, rel=0.02)


def test_the_speed_of_the_excitation_does_not_bias_the_hysteresis(configured_rig, fit_of_rig):
    fast_voltage = decreasing(frequency_hz=10.0, sample_period_s=1e-5)
    fast = fit_hysteresis(fast_voltage, Rig(configured_rig, 1e-5).run(fast_voltage))
    loop = drive('triangle', 3.0, 1.0, 2, 1e-3)
    difference = fast.model.forward(loop)[0] - fit_of_rig.model.forward(loop)[0]
    # The lag alone opens a loop of 10 Hz by 40 nm.
    assert np.abs(difference).max() < 3e-3


def test_a_delay_does_not_hide_behind_elements_that_are_missing():
    voltage = decreasing()
    displacement = np.roll(MaxwellResistiveCapacitor().forward(voltage)[0], 3)
    displacement[:3] = 0.0
    fit = fit_hysteresis(voltage, displacement + noise(voltage.size), elements=2)
    assert fit.elements == 2
    assert fit.delay_samples == pytest.approx(3.0, abs=0.3)


@pytest.mark.parametrize('elements', [1, pytest.param(3, marks=pytest.mark.slow), 12])
def test_every_fit_is_monotone_and_invertible_however_noisy_the_data(elements):
    voltage = short()
    for seed in range(3):
        displacement = SMALL.forward(voltage)[0] + noise(voltage.size, 0.1, seed)
        fit = fit_hysteresis(voltage, displacement, elements=elements)
        assert fit.elements == elements
        assert min(fit.parameters.kappa_um_per_v) > 0.0
        assert min(fit.parameters.saturation_v) >= 0.0
        there = fit.model.forward(voltage)[0]
        np.testing.assert_allclose(fit.model.inverse(there)[0], voltage, atol=1e-10)


def test_elements_that_are_not_needed_do_no_harm():
    voltage = short()
    fit = fit_hysteresis(voltage, SMALL.forward(voltage)[0] + noise(voltage.size), elements=12)
    loop = drive('triangle', 2.9, 1.0, 2, 1e-3)
    np.testing.assert_allclose(fit.model.forward(loop)[0], SMALL.forward(loop)[0], atol=6e-4)


def coverage_of_small(seeds):
    """Return the share of 95 % intervals that hold the true elements."""
    voltage = short()
    displacement = SMALL.forward(voltage)[0]
    inside = []
    for seed in range(seeds):
        fit = fit_hysteresis(voltage, displacement + noise(voltage.size, seed=seed), elements=3)
        for values, errors, truth in (
            (fit.parameters.kappa_um_per_v, fit.kappa_standard_error_um_per_v,
             SMALL.parameters.kappa_um_per_v),
            (fit.parameters.saturation_v, fit.saturation_standard_error_v,
             SMALL.parameters.saturation_v),
        ):
            inside.extend(np.abs(np.array(values) - truth) <= 1.96 * errors)
    return np.mean(inside)


def test_the_stated_95_percent_bands_cover_the_truth():
    assert 0.90 <= coverage_of_small(10) <= 0.99


@pytest.mark.slow
def test_95_percent_bands_hold_the_elements_in_93_to_97_percent_of_200_seeds():
    assert 0.93 <= coverage_of_small(200) <= 0.97


# 21 parameters in each of 50 runs with another noise.
@pytest.mark.slow
def test_95_percent_bands_hold_the_elements_of_the_lumped_rig_in_90_to_99_percent_of_cases():
    voltage = decreasing()
    kappa, saturation = in_order_of_saturation(HysteresisParameters())
    inside = []
    for seed in range(50):
        rig = RigParameters(order='lumped', seed=seed)
        fit = fit_hysteresis(voltage, Rig(rig, SAMPLE_PERIOD_S).run(voltage))
        for values, errors, truth in (
            (fit.parameters.kappa_um_per_v, fit.kappa_standard_error_um_per_v,
             rig.dc_gain * kappa),
            (fit.parameters.saturation_v, fit.saturation_standard_error_v, saturation),
        ):
            inside.extend(np.abs(np.array(values) - truth) <= 1.96 * errors)
    assert len(inside) == 1050
    assert 0.90 <= np.mean(inside) <= 0.99


def test_correlated_noise_widens_the_standard_errors():
    voltage = short()
    displacement = SMALL.forward(voltage)[0]
    white = noise(voltage.size)
    slow = np.convolve(white, np.ones(50) / np.sqrt(50), 'same')
    of_white = fit_hysteresis(voltage, displacement + white, elements=3)
    of_slow = fit_hysteresis(voltage, displacement + slow, elements=3)
    ratio = of_slow.kappa_standard_error_um_per_v / of_white.kappa_standard_error_um_per_v
    assert ratio.min() > 3.0


def test_cross_validation_finds_the_number_of_elements():
    voltage = short()
    displacement = SMALL.forward(voltage)[0] + noise(voltage.size)
    fit = fit_hysteresis(voltage, displacement, elements='auto')
    assert fit.elements == 3
    errors = fit.cross_validated_rms_um
    assert errors[2] > 1.5 * errors[3]
    assert errors[3] == pytest.approx(1e-3, rel=0.05)


def test_the_residual_is_what_the_model_leaves():
    voltage = short()
    displacement = SMALL.forward(voltage)[0] + 0.25 + noise(voltage.size)
    fit = fit_hysteresis(voltage, displacement, elements=3)
    assert fit.offset_um == pytest.approx(0.25, abs=1e-4)
    assert fit.residual_um.shape == voltage.shape
    assert np.sqrt(np.nanmean(fit.residual_um**2)) == pytest.approx(fit.rms_um)
    expected = displacement - fit.offset_um - fit.model.forward(voltage)[0]
    np.testing.assert_allclose(np.nan_to_num(fit.residual_um - expected), 0.0, atol=2e-4)


def test_a_used_stage_is_identified_from_its_largest_voltage_on():
    voltage = short()
    history = SMALL.forward([0.0, 1.2, -2.0, 0.4])[1]
    displacement = SMALL.forward(voltage, history)[0]
    fit = fit_hysteresis(voltage, displacement, elements=3, virgin=False)
    np.testing.assert_allclose(
        fit.parameters.kappa_um_per_v, SMALL.parameters.kappa_um_per_v, rtol=1e-6)


def test_a_used_stage_that_is_told_to_be_virgin_is_found_out():
    voltage = short()
    history = SMALL.forward([0.0, 1.2, -2.0, 0.4])[1]
    displacement = SMALL.forward(voltage, history)[0]
    fit = fit_hysteresis(voltage, displacement, elements=3)
    np.testing.assert_allclose(
        fit.parameters.kappa_um_per_v, SMALL.parameters.kappa_um_per_v, rtol=1e-6)
    assert 'the first rise contradicts the loops and is left out' in str(fit.verdict)
    assert np.isnan(fit.residual_um[0])


def _lags_more_upwards(voltage_v):
    """Superpose plays that are 1.7 times as wide upwards as downwards, and bend the sum."""
    total = 0.7 * voltage_v
    for width_v in np.geomspace(0.1, 2.0, 8):
        value, played = 0.0, np.empty_like(voltage_v)
        for k, voltage in enumerate(voltage_v):
            value = played[k] = min(max(value, voltage - width_v), voltage + 0.6 * width_v)
        total = total + 0.05 * played
    return total + 0.006 * total**2


def test_a_stage_that_lags_by_other_voltages_up_and_down_is_identified_by_its_loops():
    voltage = short()
    displacement = _lags_more_upwards(voltage)
    fit = fit_hysteresis(voltage, displacement + noise(voltage.size), elements=10)
    assert 'the first rise contradicts the loops and is left out' in str(fit.verdict)
    assert fit.rms_um < 1.1e-3  # the noise is 1 nm
    assert fit.validation.worst_percent < 0.1


def test_several_runs_count_together_and_each_starts_anew():
    voltage = short()
    runs = [0.4 * voltage, voltage, -voltage]
    fit = fit_hysteresis(runs, [SMALL.forward(run)[0] for run in runs], elements=3)
    assert fit.voltage_v.size == 3 * voltage.size
    np.testing.assert_allclose(
        fit.parameters.saturation_v, SMALL.parameters.saturation_v, rtol=1e-6)


def test_displacements_that_are_no_numbers_are_left_out():
    voltage = short()
    displacement = SMALL.forward(voltage)[0]
    displacement[[0, 17, 1203]] = np.nan
    displacement[4000:4300] = np.inf
    fit = fit_hysteresis(voltage, displacement, elements=3)
    assert np.isnan(fit.residual_um).sum() == 303
    np.testing.assert_allclose(
        fit.parameters.kappa_um_per_v, SMALL.parameters.kappa_um_per_v, rtol=1e-6)
    assert fit.coverage.maximum_um == pytest.approx(np.nanmax(displacement[:4000]))


def test_an_excitation_that_stops_short_of_the_wanted_range_is_told():
    voltage = short()
    displacement = SMALL.forward(voltage)[0]
    assert fit_hysteresis(voltage, displacement, elements=3).coverage.warning == ''
    covered = fit_hysteresis(voltage, displacement, elements=3, range_v=(-2.5, 2.9))
    assert covered.coverage.warning == ''
    short_of = fit_hysteresis(voltage, displacement, elements=3, range_v=(-2.0, 4.5))
    assert '4.5 V' in short_of.coverage.warning
    assert short_of.coverage.warning in short_of.to_parameter_yaml(source='a bag')


def test_the_parameter_file_holds_the_same_bits(tmp_path):
    voltage = short()
    fit = fit_hysteresis(
        voltage, SMALL.forward(voltage)[0] + noise(voltage.size), elements=8)
    file = tmp_path / 'compensator.yaml'
    file.write_text(fit.to_parameter_yaml(source='bags/a\n/**/plant: {}'), encoding='utf-8')
    values = read_parameter_file(file, ['compensator', 'plant'])
    assert list(values) == ['compensator']
    assert HysteresisParameters.from_mapping(values['compensator']) == fit.parameters
    assert '# source: bags/a\n' in file.read_text()


def test_every_number_of_the_parameter_file_is_a_floating_point_number_to_any_reader():
    from piezo_ros.identification.hysteresis.hysteresis_file import parameter_yaml
    parameters = HysteresisParameters(kappa_um_per_v=(1e-6, 2.0, 1e9), saturation_v=(0.0, 1e-5))
    text = parameter_yaml(parameters, np.array([np.nan, 0.1, 0.2]), np.array([np.nan, 0.1]), [])
    values = yaml.safe_load(text)['/**/compensator']['ros__parameters']
    for name, numbers in values.items():
        assert all(isinstance(number, float) for number in numbers), name
        written = text.split(f'{name}: [')[1].split(']')[0].split(', ')
        assert all('.' in number for number in written)
    assert 'not needed' in text


@pytest.mark.parametrize(('change', 'message'), [
    ({'elements': 0}, 'elements is 0, allowed is 1 … 160'),
    ({'elements': 161}, 'elements is 161'),
    ({'elements': 'many'}, "elements is 'many'"),
    ({'range_v': (2.0, -2.0)}, r'range_v is \(2.0, -2.0\)'),
    ({'voltage_v': np.full(10_000, 2.0)}, 'run 0: voltage_v is constant at 2.0 V'),
    ({'voltage_v': np.r_[0.0, np.nan, short()[2:]]}, r'run 0: voltage_v\[1\] is nan'),
    ({'voltage_v': short()[:-1]}, 'equally long'),
    ({'voltage_v': [short(), short()]}, '2 runs and displacement_um 1'),
    ({'displacement_um': np.full(10_000, np.nan)}, '0 finite samples, at least 100'),
    ({'displacement_um': -SMALL.forward(short())[0]}, 'does not rise with voltage_v'),
])
def test_data_that_cannot_serve_are_refused_by_name(change, message):
    arguments = {'voltage_v': short(), 'displacement_um': SMALL.forward(short())[0], **change}
    voltage, displacement = arguments.pop('voltage_v'), arguments.pop('displacement_um')
    with pytest.raises(ValueError, match=message):
        fit_hysteresis(voltage, displacement, **arguments)
