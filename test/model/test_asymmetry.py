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

from piezo_ros.model import (
    HysteresisParameters,
    InverseHysteresis,
    MaxwellResistiveCapacitor,
    ParameterError,
    Rig,
    RigParameters,
)
from piezo_ros.model.hysteresis import (
    compensation_step,
    hysteresis_constants,
    hysteresis_state,
    hysteresis_step,
)

values_um = st.lists(st.floats(-8.0, 8.0), min_size=1, max_size=25).map(np.array)
shares = st.floats(0.0, 1.0)
TOLERANCE = 1e-9


@st.composite
def asymmetric(draw):
    """Draw parameters of an operator with an output map that rises everywhere."""
    thresholds = sorted(draw(st.lists(
        st.floats(-6.0, 6.0).map(lambda x: round(x, 3)), max_size=6, unique=True)))
    below = [value for value in thresholds if value < 0.0]
    above = [value for value in thresholds if value >= 0.0]
    weights = []
    for side in (list(reversed(below)), above):
        slopes = [1.0, *(draw(st.floats(0.2, 3.0)) for _ in side)]
        weights.append(np.diff(slopes).tolist())
    return HysteresisParameters(
        kappa_um_per_v=(4.0, 9.0, 1.3), saturation_v=(0.05, 0.2),
        asymmetry_threshold_um=thresholds,
        asymmetry_weight=[*reversed(weights[0]), *weights[1]])


def mapped(parameters, displacement_um):
    """Return the superposition of one-sided dead zones, without the code under test."""
    image = np.array(displacement_um, dtype=float)
    for threshold, weight in zip(
            parameters.asymmetry_threshold_um, parameters.asymmetry_weight, strict=True):
        beyond = displacement_um - threshold
        image += weight * (np.minimum(beyond, 0.0) if threshold < 0.0 else np.maximum(beyond, 0.0))
    return image


@given(asymmetric(), values_um)
def test_the_operator_is_the_map_of_dead_zones_behind_the_elements(parameters, voltage_v):
    symmetric = MaxwellResistiveCapacitor(parameters.kappa_um_per_v, parameters.saturation_v)
    expected_um = mapped(parameters, symmetric.forward(voltage_v)[0])
    np.testing.assert_allclose(
        MaxwellResistiveCapacitor.of(parameters).forward(voltage_v)[0], expected_um,
        rtol=0, atol=TOLERANCE)


@given(asymmetric(), values_um)
def test_forward_undoes_the_inverse_of_an_asymmetric_operator(parameters, wanted_um):
    operator = MaxwellResistiveCapacitor.of(parameters)
    voltage_v, state = operator.inverse(wanted_um)
    displacement_um, after = operator.forward(voltage_v)
    np.testing.assert_allclose(displacement_um, wanted_um, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(after, state, rtol=0, atol=TOLERANCE)


@given(asymmetric(), values_um, st.floats(-8.0, 8.0), st.floats(1e-6, 5.0))
def test_an_asymmetric_operator_rises_from_any_state(parameters, history, value, more):
    operator = MaxwellResistiveCapacitor.of(parameters)
    _, state = operator.forward(history)
    (lower,), _ = operator.forward([value], state)
    (higher,), _ = operator.forward([value + more], state)
    assert higher > lower


@given(asymmetric(), values_um, st.floats(-8.0, 8.0), st.lists(shares, max_size=8))
def test_an_asymmetric_operator_forgets_what_a_larger_extremum_wipes_out(
        parameters, history, end, excursion):
    operator = MaxwellResistiveCapacitor.of(parameters)
    _, state = operator.forward(history)
    (direct,), direct_state = operator.forward([end], state)
    start = history[-1]
    wiped, wiped_state = operator.forward(
        [*(start + share * (end - start) for share in excursion), end], state)
    assert wiped[-1] == pytest.approx(direct, abs=TOLERANCE)
    np.testing.assert_allclose(wiped_state, direct_state, rtol=0, atol=TOLERANCE)


@given(asymmetric(), values_um)
def test_a_node_and_the_kernels_give_the_same_bits_with_an_asymmetry(parameters, values):
    constants = hysteresis_constants(parameters)
    operator = MaxwellResistiveCapacitor.of(parameters)
    for step, array in ((hysteresis_step, operator.forward), (compensation_step, operator.inverse)):
        state = hysteresis_state([0.0] * 2)
        stepped = np.array([step(state, constants, value) for value in values.tolist()])
        assert stepped.tobytes() == array(values)[0].tobytes()
    in_node, packed = (
        InverseHysteresis(parameters, compiled=flag).answer(0, values) for flag in (False, True))
    assert in_node.tobytes() == packed.tobytes() == operator.inverse(values)[0].tobytes()


def test_without_thresholds_not_a_bit_is_another():
    values = np.random.default_rng(0).uniform(-6.0, 6.0, 500)
    symmetric = MaxwellResistiveCapacitor()
    flat = MaxwellResistiveCapacitor(
        asymmetry_threshold_um=(-3.0, 0.0, 2.0), asymmetry_weight=(0.0, 0.0, 0.0))
    np.testing.assert_allclose(flat.forward(values)[0], symmetric.forward(values)[0], atol=1e-14)
    of_node = InverseHysteresis(HysteresisParameters(), compiled=False).answer(0, values)
    assert of_node.tobytes() == symmetric.inverse(values)[0].tobytes()


def test_the_rig_has_the_asymmetry_that_it_is_given():
    asymmetry = {'asymmetry_threshold_um': (-1.0, 0.5), 'asymmetry_weight': (0.4, -0.3)}
    ideal = {'dac_bits': 0, 'adc_bits': 0, 'noise_rms_um': 0.0, 'order': 'lumped'}
    held_v = np.full(3000, 2.0)
    symmetric, skewed = (
        Rig(RigParameters(**ideal, **more), 1e-4).run(held_v)[-1] for more in ({}, asymmetry))
    expected = MaxwellResistiveCapacitor(**asymmetry).forward([2.0])[0][0]
    plain = MaxwellResistiveCapacitor().forward([2.0])[0][0]
    assert skewed / symmetric == pytest.approx(expected / plain, rel=1e-6)


def test_a_compensator_with_the_asymmetry_of_the_stage_makes_it_straight():
    skewed = HysteresisParameters(
        asymmetry_threshold_um=(-1.0, 0.5), asymmetry_weight=(0.4, -0.3))
    wanted_um = 2.0 * np.sin(np.arange(400) / 20.0)
    voltage_v = InverseHysteresis(skewed).answer(0, wanted_um)
    np.testing.assert_allclose(
        MaxwellResistiveCapacitor.of(skewed).forward(voltage_v)[0], wanted_um, atol=1e-12)


@pytest.mark.parametrize(('values', 'complaint'), [
    ({'asymmetry_threshold_um': (1.0,)},
     'asymmetry_threshold_um has 1 values and asymmetry_weight 0; there must be one weight'),
    ({'asymmetry_threshold_um': (1.0, 0.5), 'asymmetry_weight': (0.1, 0.1)},
     r'asymmetry_threshold_um is \[1.0, 0.5\], the values must rise'),
    ({'asymmetry_threshold_um': (1.0,), 'asymmetry_weight': (-1.0,)},
     'the slope falls to 0, allowed is 0.001 or more'),
    ({'asymmetry_threshold_um': (-2.0, -1.0), 'asymmetry_weight': (-0.7, -0.5)},
     'the slope falls to -0.2')])
def test_an_asymmetry_without_inverse_is_refused(values, complaint):
    with pytest.raises(ParameterError, match=complaint):
        HysteresisParameters(**values)
