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

import copy

import numpy as np
import pytest
from scipy import signal

from piezo_ros.model import LinearDynamics, MaxwellResistiveCapacitor, Rig, RigParameters
from piezo_ros.model.noise import unit_noise
from piezo_ros.model.rig import rig_constants

PERIOD_S = 1e-5
IDEAL = {'noise_rms_um': 0.0, 'dac_bits': 0, 'adc_bits': 0}
MISMATCHES = {
    'gain_mismatch': -0.06, 'natural_frequency_1_mismatch': -0.034,
    'natural_frequency_2_mismatch': 0.17, 'damping_ratio_1_mismatch': -0.238,
    'time_constant_mismatch': -0.029}
RIGS = {
    'physical': RigParameters(),
    'lumped': RigParameters(order='lumped'),
    'slew': RigParameters(slew_limit_v_per_s=18900.0, **MISMATCHES),
    'ideal': RigParameters(order='lumped', **IDEAL),
    'creeping': RigParameters(
        creep_per_decade=0.02, creep_start_s=1e-3, drift_um_per_s=0.1, **MISMATCHES),
    'creeping lumped': RigParameters(order='lumped', creep_per_decade=0.02, creep_end_s=1.0),
    'drifting': RigParameters(drift_um_per_s=-0.1),
    'few elements': RigParameters(kappa_um_per_v=[20.0, 1.3], saturation_v=[0.0], seed=9),
}
either_order = pytest.mark.parametrize('order', ['physical', 'lumped'])
any_rig = pytest.mark.parametrize('name', RIGS)


def voltages(samples, seed=0):
    """Walks, jumps and plateaus, partly beyond the rails."""
    rng = np.random.default_rng(seed)
    values = np.cumsum(rng.normal(0.0, 0.1, samples))
    values = 9.0 * np.sin(values)
    values[::7] = rng.uniform(-9.0, 9.0, values[::7].size)
    values[samples // 2:samples // 2 + 50] = 1.0
    return values


@any_rig
def test_stepping_and_running_give_the_same_bits(name):
    inputs = voltages(12000)
    stepped, array = Rig(RIGS[name]), Rig(RIGS[name])
    one_by_one = np.array([stepped.step(value) for value in inputs.tolist()])
    assert one_by_one.tobytes() == array.run(inputs).tobytes()
    assert stepped.state[:-1] == array.state[:-1]
    assert stepped.index == array.index == inputs.size


@any_rig
def test_any_split_into_runs_and_steps_gives_the_same_bits(name):
    inputs = voltages(6000, seed=1)
    whole = Rig(RIGS[name]).run(inputs)
    rng = np.random.default_rng(2)
    rig, pieces = Rig(RIGS[name]), []
    for piece in np.split(inputs, np.sort(rng.integers(0, inputs.size, 12))):
        if rng.random() < 0.5:
            pieces.append(rig.run(piece))
        else:
            pieces.append([rig.step(value) for value in piece.tolist()])
    assert np.concatenate(pieces).tobytes() == whole.tobytes()


@any_rig
def test_a_reset_brings_the_same_bits_again(name):
    rig = Rig(RIGS[name])
    first_reading = rig.measure()
    first = rig.run(voltages(1000))
    rig.reset()
    assert (rig.index, rig.measure()) == (0, first_reading)
    assert rig.run(voltages(1000)).tobytes() == first.tobytes()


def test_lumped_it_is_the_hysteresis_and_then_all_of_g_behind_a_hold():
    inputs = 3.0 * np.sin(np.arange(3000) / 50)
    measured_um = Rig(RigParameters(order='lumped', **IDEAL)).run(inputs)
    free_um, _ = MaxwellResistiveCapacitor().forward(inputs)
    system = LinearDynamics().discrete(PERIOD_S)
    _, expected_um, _ = signal.dlsim((*system, PERIOD_S), np.append(free_um, 0.0))
    np.testing.assert_allclose(measured_um, expected_um[1:, 0], rtol=0, atol=1e-9)


def test_in_physical_order_the_amplifier_precedes_the_hysteresis():
    inputs = 3.0 * np.sin(np.arange(3000) / 50)
    measured_um = Rig(RigParameters(**IDEAL)).run(inputs)
    dynamics = LinearDynamics()
    amplifier = signal.cont2discrete(tuple(dynamics.amplifier), PERIOD_S, 'zoh')
    _, amplified_v, _ = signal.dlsim(amplifier, np.append(inputs, 0.0))
    free_um, _ = MaxwellResistiveCapacitor().forward(amplified_v[:, 0])
    # The samples of the amplifier begin at zero, at rest; straight lines run between them.
    mechanics = signal.cont2discrete(tuple(dynamics.mechanics_and_sensor), PERIOD_S, 'foh')
    _, expected_um, _ = signal.dlsim(mechanics, free_um)
    np.testing.assert_allclose(measured_um, expected_um[1:, 0], rtol=0, atol=1e-9)


@either_order
@pytest.mark.parametrize('mismatch', [0.0, -0.06])
def test_a_constant_voltage_settles_at_the_dc_gain_of_the_hysteresis(order, mismatch):
    rig = Rig(RigParameters(order=order, gain_mismatch=mismatch, **IDEAL))
    # So smooth a rise that the amplifier does not overshoot and drag elements along.
    rise_v = 1.0 - np.cos(np.linspace(0.0, np.pi, 30000))
    measured_um = rig.run(np.append(rise_v, np.full(1000, 2.0)))
    free_um = MaxwellResistiveCapacitor().forward([2.0])[0][0]
    gain = LinearDynamics().parameters.dc_gain * (1 + mismatch)
    assert measured_um[-1] == pytest.approx(gain * free_um, rel=1e-6)


def test_every_mismatch_changes_its_own_parameter_and_no_other():
    p = RigParameters(damping_ratio_2_mismatch=0.5, **MISMATCHES)
    true = p.true_dynamics
    for name in ('natural_frequency_1_rad_per_s', 'natural_frequency_2_rad_per_s',
                 'damping_ratio_1', 'damping_ratio_2', 'time_constant_s'):
        mismatch = getattr(p, name.removesuffix('_rad_per_s').removesuffix('_s') + '_mismatch')
        assert mismatch != 0.0
        assert getattr(true, name) == pytest.approx(getattr(p, name) * (1 + mismatch), rel=1e-14)
    assert true.dc_gain == pytest.approx(p.dc_gain * (1 + p.gain_mismatch), rel=1e-14)
    for name in ('zero_b1_rad_per_s', 'zero_b2_rad2_per_s2'):
        assert getattr(true, name) == getattr(p, name)


@either_order
@pytest.mark.parametrize(('voltage_v', 'rail_v'), [(1e6, 5.0), (-1e6, -7.0)])
def test_no_voltage_leaves_the_rails(order, voltage_v, rail_v):
    beyond, at_the_rail = Rig(RigParameters(order=order)), Rig(RigParameters(order=order))
    half_a_step_v = 20.0 / 2**17
    for _ in range(300):
        assert beyond.step(voltage_v) == at_the_rail.step(rail_v)
        assert beyond.state.drive_v[0] == pytest.approx(rail_v, abs=half_a_step_v * (1 + 1e-9))


def test_the_reading_ends_where_the_converter_does():
    p = RigParameters(sensor_scale_um_per_v=0.7, **IDEAL)  # 7 um absolute, 1 um of deviation
    readings = Rig(p).run(np.full(2000, 4.0))
    assert readings.max() == 1.0
    assert readings[-1] == 1.0


@either_order
def test_the_voltage_changes_no_faster_than_the_current_limit(order):
    rig = Rig(RigParameters(order=order, slew_limit_v_per_s=18900.0, dac_bits=0))
    largest_v, drive = 18900.0 * PERIOD_S, [0.0]
    for value in voltages(3000).tolist():
        rig.step(value)
        drive.append(rig.state.drive_v[0])
    changes = np.abs(np.diff(drive))
    assert changes.max() <= largest_v * (1 + 1e-12)
    assert np.count_nonzero(changes > 0.999999 * largest_v) > 1000


def test_a_voltage_within_the_current_limit_is_not_touched_by_it():
    inputs = 2.0 * np.sin(2 * np.pi * 300 * PERIOD_S * np.arange(2000))
    limited = Rig(RigParameters(slew_limit_v_per_s=18900.0)).run(inputs)
    assert limited.tobytes() == Rig(RigParameters()).run(inputs).tobytes()


def test_the_noise_is_that_of_seed_and_index_and_only_added():
    inputs = voltages(5000)
    still = {**IDEAL, 'noise_rms_um': 0.0}
    quiet = Rig(RigParameters(**still)).run(inputs)
    noisy = Rig(RigParameters(**{**still, 'noise_rms_um': 1e-3}, seed=4)).run(inputs)
    np.testing.assert_allclose(noisy - quiet, 1e-3 * unit_noise(4, 1, 5000), rtol=0, atol=1e-14)
    assert np.std(noisy - quiet) == pytest.approx(1e-3, rel=0.05)


@either_order
@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_refused_and_changes_nothing(order, bad):
    rig = Rig(RigParameters(order=order))
    rig.run(voltages(100))
    state, index, reading = copy.deepcopy(rig.state), rig.index, rig.measure()
    with pytest.raises(ValueError, match=f'voltage_v is {bad}, it must be finite'):
        rig.step(float(bad))
    with pytest.raises(ValueError, match=rf'voltage_v\[1\] is {bad}, it must be finite'):
        rig.run([0.0, bad])
    with pytest.raises(ValueError, match=r'voltage_v has shape \(1, 2\)'):
        rig.run([[0.0, 1.0]])
    assert (rig.state, rig.index, rig.measure()) == (state, index, reading)


def test_a_sample_period_that_is_none_is_refused():
    with pytest.raises(ValueError, match='sample_period_s is 0'):
        Rig(sample_period_s=0.0)


def test_a_long_violent_run_stays_finite_and_within_the_travel_of_the_voltage():
    measured_um = Rig(RigParameters(slew_limit_v_per_s=18900.0, **IDEAL)).run(voltages(300_000))
    assert np.isfinite(measured_um).all()
    assert np.abs(measured_um).max() < 1.3 * 1.2808 * 7.0


@pytest.mark.parametrize(('operating_point_um', 'reach_um'), [(6.0, 6.0), (2.0, 2.0), (9.0, 3.0)])
def test_the_reach_ends_at_the_nearer_end_of_the_travel(operating_point_um, reach_um):
    assert RigParameters(operating_point_um=operating_point_um).reach_um == reach_um


def test_the_slew_limit_can_be_switched_off():
    assert rig_constants(RigParameters(slew_limit_v_per_s=0.0), PERIOD_S).slew_step_v > 1e6


@pytest.mark.parametrize('compiled', [False, True])
@pytest.mark.parametrize('voltage_v', [1e4, 1e17, 1e19, 1e25, 1e300, 1.7e308])
def test_any_finite_voltage_is_the_rail_that_it_is_beyond(voltage_v, compiled):
    """A1: steps of a converter beyond 2^63 are no integers any more; and 1.7e308 + 50 is finite."""
    beyond, at_the_rail = Rig(compiled=compiled), Rig(compiled=compiled)
    for sign in (1.0, -1.0, 1.0):
        rail_v = 5.0 if sign > 0.0 else -7.0
        assert beyond.step(sign * voltage_v) == at_the_rail.step(rail_v)
    assert beyond.step(0.0) == at_the_rail.step(0.0)
    assert beyond.driven_v == at_the_rail.driven_v
