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
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from piezo_ros import paper
from piezo_ros.model import HysteresisParameters, MaxwellResistiveCapacitor, ParameterError
from piezo_ros.model.hysteresis import (
    forward_step,
    hysteresis_constants,
    hysteresis_state,
    inverse_step,
    settle_step,
)
from piezo_ros.report import nonlinearity

TOLERANCE = 1e-11

micrometres = st.floats(-12.0, 12.0, allow_subnormal=False)
shares = st.floats(0.0, 1.0)


@st.composite
def operators(draw):
    saturation = draw(st.lists(
        st.one_of(st.just(0.0), st.floats(1e-3, 0.3)), min_size=1, max_size=6))
    kappa = draw(st.lists(
        st.floats(0.5, 200.0), min_size=len(saturation), max_size=len(saturation)))
    return MaxwellResistiveCapacitor([*kappa, draw(st.floats(0.5, 5.0))], saturation)


inputs = st.lists(micrometres, min_size=1, max_size=30).map(np.array)
either_way = pytest.mark.parametrize('way', ['inverse', 'forward'])


def run(operator, way, values, state=None):
    return getattr(operator, way)(np.asarray(values, dtype=float), state)


def stop_operators(operator, displacement_um):
    """Section 2 of the paper to the letter: elements that clip increment by increment."""
    *kappa, unlimited = operator.parameters.kappa_um_per_v
    kappa, limit = np.array(kappa), np.array(operator.parameters.saturation_v)
    held, before, voltages = np.zeros(len(kappa)), 0.0, []
    for x in displacement_um:
        held = np.clip(held + (x - before) / kappa, -limit, limit)
        before = x
        voltages.append(x / unlimited + held.sum())
    return np.array(voltages)


def voltage_after(operator, state, displacement_um):
    """The voltage of one displacement out of a state, without the code under test."""
    *kappa, unlimited = operator.parameters.kappa_um_per_v
    limit = np.array(operator.parameters.saturation_v)
    held = np.clip((displacement_um - state) / np.array(kappa), -limit, limit)
    return displacement_um / unlimited + held.sum()


def plays_of(memory, constants):
    """The plays of a state, which stays as it is."""
    settled = list(memory)
    settle_step(settled, constants)
    return settled[:len(constants.width_um)]


def test_the_gain_is_that_of_the_paper_for_small_and_for_large_signals():
    operator = MaxwellResistiveCapacitor()
    small, _ = operator.forward([1e-6])
    assert small[0] / 1e-6 == pytest.approx(0.666, abs=5e-4)
    large, _ = operator.forward([4.0, 5.0])
    assert large[1] - large[0] == pytest.approx(1.281, abs=5e-4)


def test_the_loop_of_a_3_v_triangle_has_the_nonlinearity_of_the_paper():
    phase = np.arange(30000) / 10000
    voltage_v = 3.0 * 2 / np.pi * np.arcsin(np.sin(2 * np.pi * phase))
    displacement_um, _ = MaxwellResistiveCapacitor().forward(voltage_v)
    loop = nonlinearity(voltage_v, displacement_um)
    assert 100 * loop.input == pytest.approx(11.78, abs=0.02)
    assert 100 * loop.output == pytest.approx(12.37, abs=0.02)


@pytest.mark.parametrize('seed', range(3))
def test_forward_undoes_inverse_over_a_million_samples(seed):
    rng = np.random.default_rng(seed)
    operator = MaxwellResistiveCapacitor()
    wanted_um = rng.uniform(-12.0, 12.0, 10**6 if seed == 0 else 10**5)
    if seed == 2:
        wanted_um = np.clip(np.cumsum(rng.normal(0.0, 0.02, wanted_um.size)), -12.0, 12.0)
    voltage_v, inverse_state = operator.inverse(wanted_um)
    displacement_um, forward_state = operator.forward(voltage_v)
    assert np.max(np.abs(displacement_um - wanted_um)) <= 1e-12
    assert np.max(np.abs(forward_state - inverse_state)) <= 1e-12


@given(operators(), inputs)
def test_forward_undoes_inverse_for_any_elements(operator, wanted_um):
    displacement_um, _ = operator.forward(operator.inverse(wanted_um)[0])
    np.testing.assert_allclose(displacement_um, wanted_um, rtol=0, atol=TOLERANCE)


@given(operators(), inputs)
def test_inverse_agrees_with_elements_that_clip_increments(operator, displacement_um):
    voltage_v, _ = operator.inverse(displacement_um)
    expected_v = stop_operators(operator, displacement_um)
    np.testing.assert_allclose(voltage_v, expected_v, rtol=0, atol=TOLERANCE)


@given(operators(), inputs, st.floats(-20.0, 20.0))
def test_forward_agrees_with_a_root_finder(operator, history_um, voltage_v):
    _, state = operator.inverse(history_um)
    (displacement_um,), _ = operator.forward([voltage_v], state)
    expected_um = brentq(
        lambda x: voltage_after(operator, state, x) - voltage_v, -1e4, 1e4, xtol=1e-13)
    assert displacement_um == pytest.approx(expected_um, rel=1e-12, abs=1e-10)


@pytest.mark.parametrize('elements', [0, 1, 2, 300])
def test_any_number_of_elements_will_do(elements):
    rng = np.random.default_rng(elements)
    operator = MaxwellResistiveCapacitor(
        [*rng.uniform(1.0, 100.0 * (elements + 1), elements), 1.3],
        rng.uniform(0.0, 0.2, elements))
    wanted_um = rng.uniform(-12.0, 12.0, 3000)
    voltage_v, _ = operator.inverse(wanted_um)
    np.testing.assert_allclose(
        voltage_v, stop_operators(operator, wanted_um), rtol=0, atol=1e-10)
    displacement_um, _ = operator.forward(voltage_v)
    np.testing.assert_allclose(displacement_um, wanted_um, rtol=0, atol=1e-11)


def test_elements_that_hold_no_voltage_leave_a_spring():
    operator = MaxwellResistiveCapacitor([3.0, 7.0, 1.25], [0.0, 0.0])
    voltage_v = np.array([1.0, -2.0, 0.5, 0.5])
    np.testing.assert_allclose(operator.forward(voltage_v)[0], 1.25 * voltage_v, atol=1e-14)


@either_way
@given(operators(), inputs, micrometres, st.lists(shares, max_size=10))
def test_only_the_order_of_the_input_counts_not_its_rate(way, operator, history, end, between):
    output, state = run(operator, way, history)
    (direct,), direct_state = run(operator, way, [end], state)
    start = history[-1]
    slow = [start + share * (end - start) for share in sorted(between)]
    detour, detour_state = run(operator, way, [*slow, end], state)
    assert detour[-1] == pytest.approx(direct, abs=TOLERANCE)
    np.testing.assert_allclose(detour_state, direct_state, rtol=0, atol=TOLERANCE)
    again, again_state = run(operator, way, [start] * 3, state)
    np.testing.assert_allclose(again, output[-1], rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(again_state, state, rtol=0, atol=TOLERANCE)


@either_way
@given(operators(), inputs, micrometres, st.lists(shares, max_size=10))
def test_a_larger_extremum_wipes_out_the_smaller_ones_before_it(
        way, operator, history, end, excursion):
    _, state = run(operator, way, history)
    (direct,), direct_state = run(operator, way, [end], state)
    start = history[-1]
    inner = [start + share * (end - start) for share in excursion]
    wiped, wiped_state = run(operator, way, [*inner, end], state)
    assert wiped[-1] == pytest.approx(direct, abs=TOLERANCE)
    np.testing.assert_allclose(wiped_state, direct_state, rtol=0, atol=TOLERANCE)


@either_way
@given(operators(), inputs, inputs, micrometres, micrometres, st.lists(shares, max_size=6))
def test_loops_between_the_same_inputs_are_congruent_whatever_was_before(
        way, operator, one_history, other_history, low, high, between):
    steps = [low + share * (high - low) for share in sorted(between)]
    loop = [low, *steps, high, *reversed(steps), low]
    shapes = []
    for history in (one_history, other_history):
        _, state = run(operator, way, [*history, low, high])
        output, _ = run(operator, way, loop, state)
        shapes.append(output - output[0])
    np.testing.assert_allclose(*shapes, rtol=0, atol=TOLERANCE)


@either_way
@given(operators(), inputs, micrometres, st.floats(1e-6, 5.0))
def test_more_in_is_more_out_from_any_state(way, operator, history, value, more):
    _, state = run(operator, way, history)
    (lower,), _ = run(operator, way, [value], state)
    (higher,), _ = run(operator, way, [value + more], state)
    unlimited = operator.parameters.kappa_um_per_v[-1]
    stiffness = sum(1.0 / kappa for kappa in operator.parameters.kappa_um_per_v)
    bounds = (1.0 / unlimited, stiffness) if way == 'inverse' else (1.0 / stiffness, unlimited)
    assert bounds[0] * more - TOLERANCE <= higher - lower <= bounds[1] * more + TOLERANCE


@either_way
@given(operators(), inputs, st.data())
def test_any_split_of_the_input_gives_the_same_bits(way, operator, values, data):
    whole, whole_state = run(operator, way, values)
    cuts = sorted(data.draw(st.lists(st.integers(0, values.size), max_size=4)))
    state, pieces = None, []
    for piece in np.split(values, cuts):
        output, state = run(operator, way, piece, state)
        pieces.append(output)
    assert np.concatenate(pieces).tobytes() == whole.tobytes()
    assert state.tobytes() == whole_state.tobytes()


@either_way
@given(operators(), inputs)
def test_the_step_of_a_node_gives_the_same_bits_as_the_compiled_array(way, operator, values):
    step = inverse_step if way == 'inverse' else forward_step
    constants = hysteresis_constants(operator.parameters)
    memory = hysteresis_state([0.0] * len(constants.width_um))
    stepped = np.array([step(memory, constants, value) for value in values.tolist()])
    settle_step(memory, constants)
    output, state = run(operator, way, values)
    assert stepped.tobytes() == output.tobytes()
    assert np.array(memory[:state.size]).tobytes() == state.tobytes()


@either_way
def test_a_long_run_of_steps_gives_the_same_bits_as_the_compiled_array(way):
    values = np.random.default_rng(3).uniform(-6.0, 6.0, 20000)
    values[::2] = np.round(values[::2], 2)
    step = inverse_step if way == 'inverse' else forward_step
    constants = hysteresis_constants(HysteresisParameters())
    memory = hysteresis_state([0.0] * 10)
    stepped = np.array([step(memory, constants, value) for value in values.tolist()])
    settle_step(memory, constants)
    output, state = run(MaxwellResistiveCapacitor(), way, values)
    assert stepped.tobytes() == output.tobytes()
    assert np.array(memory[:state.size]).tobytes() == state.tobytes()


@either_way
@given(operators(), inputs, st.sampled_from([1.0, 1e-4, 1e-9, 1e-14]))
@settings(max_examples=300)
def test_the_line_that_is_kept_gives_the_same_bits_as_every_element_looked_at(
        way, operator, values, share):
    step = inverse_step if way == 'inverse' else forward_step
    constants = hysteresis_constants(operator.parameters)
    kept = hysteresis_state([0.0] * len(constants.width_um))
    # Out to a value, then ever so slowly on, to and fro, and in steps lost in rounding.
    values = [*values.tolist(), *(values[-1] + share * values).tolist(), *values.tolist()]
    plays = kept[:len(constants.width_um)]
    for value in values:
        without = hysteresis_state(plays)
        assert step(kept, constants, value) == step(without, constants, value)
        settle_step(without, constants)
        plays = without[:len(plays)]
    settle_step(kept, constants)
    assert kept[:len(plays)] == plays


@either_way
@given(operators(), inputs, st.booleans(), st.lists(
    st.integers(-2000, 2000) | st.integers(-3, 3), min_size=1, max_size=12))
@settings(max_examples=300)
def test_the_line_is_left_at_the_same_bit_where_the_next_element_saturates(
        way, operator, values, up, roundings):
    step = inverse_step if way == 'inverse' else forward_step
    constants = hysteresis_constants(operator.parameters)
    width_um = np.array(constants.width_um)
    kept = hysteresis_state([0.0] * width_um.size)
    for value in values.tolist():
        output = step(kept, constants, value)
    for rounding in roundings:
        plays = plays_of(kept, constants)
        newest_um = output if way == 'forward' else value
        edges_um = np.sort(plays + width_um if up else width_um - plays)
        ahead = edges_um[edges_um > (newest_um if up else -newest_um)]
        if not ahead.size:
            break
        edge_um = ahead[0] if up else -ahead[0]
        edge = edge_um if way == 'inverse' else voltage_after(operator, np.array(plays), edge_um)
        value = float(edge) + rounding * math.ulp(edge)
        without = hysteresis_state(plays)
        output = step(kept, constants, value)
        assert output == step(without, constants, value)
        assert plays_of(kept, constants) == plays_of(without, constants)


@either_way
@pytest.mark.parametrize('elements', [10, 40])
def test_a_scan_with_noise_gives_the_same_bits_as_every_element_looked_at(way, elements):
    rng = np.random.default_rng(elements)
    step = inverse_step if way == 'inverse' else forward_step
    operator = MaxwellResistiveCapacitor(
        [*rng.uniform(1.0, 100.0, elements), 1.3], rng.uniform(0.0, 0.05, elements))
    constants = hysteresis_constants(operator.parameters)
    kept = hysteresis_state([0.0] * elements)
    time = np.arange(6000)
    for value in (3.0 * np.sin(time / 40.0) + 0.003 * rng.normal(size=time.size)).tolist():
        without = hysteresis_state(plays_of(kept, constants))
        assert step(kept, constants, value) == step(without, constants, value)


@either_way
@given(inputs)
@settings(max_examples=20)
def test_neither_the_input_nor_the_state_is_changed(way, values):
    operator = MaxwellResistiveCapacitor()
    _, state = run(operator, way, [3.0, -1.0])
    values_before, state_before = values.copy(), state.copy()
    _, after = run(operator, way, values, state)
    assert after is not state
    np.testing.assert_array_equal(values, values_before)
    np.testing.assert_array_equal(state, state_before)


@either_way
def test_an_empty_input_leaves_the_state_as_it_is(way):
    operator = MaxwellResistiveCapacitor()
    _, state = run(operator, way, [2.0])
    output, after = run(operator, way, [], state)
    assert output.shape == (0,)
    np.testing.assert_array_equal(after, state)


@either_way
@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf])
def test_a_sample_that_is_no_number_is_refused_by_its_place(way, bad):
    name = 'displacement_um' if way == 'inverse' else 'voltage_v'
    with pytest.raises(ValueError, match=rf'{name}\[2\] is {bad}, it must be finite'):
        run(MaxwellResistiveCapacitor(), way, [0.0, 1.0, bad, bad])


@either_way
@pytest.mark.parametrize(('state', 'message'), [
    (np.zeros(9), r'state has shape \(9,\), it must be \(10,\)'),
    (np.full(10, np.nan), 'state is .*nan.*, every value must be finite'),
    (np.linspace(-5.0, 5.0, 10), 'belong to no state'),
])
def test_a_state_of_another_operator_is_refused(way, state, message):
    with pytest.raises(ValueError, match=message):
        run(MaxwellResistiveCapacitor(), way, [0.0], state)


@either_way
def test_an_array_of_arrays_is_refused(way):
    with pytest.raises(ValueError, match=r'has shape \(2, 3\), it must be one-dimensional'):
        run(MaxwellResistiveCapacitor(), way, np.zeros((2, 3)))


def test_elements_that_do_not_belong_together_are_refused():
    with pytest.raises(ParameterError, match='kappa_um_per_v has 2 values and saturation_v 2'):
        MaxwellResistiveCapacitor([1.0, 2.0], [0.1, 0.1])
    with pytest.raises(ParameterError, match='kappa_um_per_v is nan'):
        MaxwellResistiveCapacitor([float('nan'), 2.0], [0.1])


def test_the_default_is_table_1():
    parameters = MaxwellResistiveCapacitor().parameters
    assert parameters.kappa_um_per_v == paper.KAPPA_UM_PER_V
    assert parameters.saturation_v == paper.SATURATION_V
