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
from dataclasses import dataclass

import pytest

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.model import (
    DynamicsParameters,
    HysteresisParameters,
    ParameterError,
    ParameterSet,
    RigParameters,
)
from piezo_ros.model.parameters import parameter
from piezo_ros.parameters.node_parameters import NODE_PARAMETERS

SETS = [
    DynamicsParameters, HysteresisParameters, RigParameters, ControllerParameters,
    TrajectoryParameters]


@dataclass(frozen=True, kw_only=True)
class Example(ParameterSet):
    flag: bool = parameter(True, '', 'a flag')
    count: int = parameter(2, '', 'a count', minimum=0, maximum=9)
    length_um: float = parameter(1.5, 'um', 'a length', minimum=-1.0, maximum=10.0)
    above: float = parameter(1.0, '', 'bounded below', minimum=0.0)
    free: float = parameter(0.0, '', 'not bounded')
    kind: str = parameter('a', '', 'a choice', choices=('a', 'b'))
    many_v: tuple[float, ...] = parameter((1.0, 2.0), 'V', 'a list', minimum=0.0, maximum=5.0)


def numbers(parameter_set):
    return [(name, value) for name, value in parameter_set().to_mapping().items()
            if isinstance(value, int | float | list) and not isinstance(value, bool)]


@pytest.mark.parametrize(('name', 'value', 'message'), [
    ('flag', 1, 'flag is 1, it must be true or false'),
    ('count', True, 'count is True, it must be an integer'),
    ('count', 1.5, 'count is 1.5, it must be an integer'),
    ('count', math.nan, 'count is nan, it must be an integer'),
    ('count', math.inf, 'count is inf, it must be an integer'),
    ('count', '1', "count is '1', it must be an integer; did you mean 1?"),
    ('count', 10, 'count is 10, allowed is 0 … 9'),
    ('length_um', '1', "length_um is '1', it must be a number; did you mean 1?"),
    ('length_um', None, 'length_um is None, it must be a number'),
    ('length_um', False, 'length_um is False, it must be a number'),
    ('length_um', math.nan, 'length_um is nan um, allowed is -1 … 10 um'),
    ('length_um', 10.5, 'length_um is 10.5 um, allowed is -1 … 10 um'),
    ('length_um', -2, 'length_um is -2.0 um, allowed is -1 … 10 um'),
    ('above', -0.5, 'above is -0.5, allowed is 0 … inf'),
    ('above', math.inf, 'above is inf, allowed is 0 … inf'),
    ('free', math.nan, 'free is nan, allowed is any finite number'),
    ('kind', 'c', "kind is 'c', allowed are a, b"),
    ('kind', 1, 'kind is 1, it must be text'),
    ('many_v', 1.0, 'many_v is 1.0, it must be a list of numbers'),
    ('many_v', [1.0, 'x'], "many_v is [1.0, 'x'], it must be a list of numbers"),
    ('many_v', [1.0, True], 'many_v is [1.0, True], it must be a list of numbers'),
    ('many_v', [1.0, math.nan], 'many_v is nan V, allowed is 0 … 5 V'),
    ('many_v', [1.0, 6.0], 'many_v is 6.0 V, allowed is 0 … 5 V'),
])
def test_a_refusal_names_the_parameter_its_value_and_what_is_allowed(name, value, message):
    with pytest.raises(ParameterError) as refusal:
        Example.from_mapping({name: value})
    assert str(refusal.value) == message


@pytest.mark.parametrize('name', ['count', 'length_um', 'many_v'])
def test_an_integer_beyond_every_float_is_refused_in_words(name):
    huge = 10 ** 400
    with pytest.raises(ParameterError, match=name):
        Example.from_mapping({name: [huge] if name == 'many_v' else huge})


def test_an_unknown_name_is_refused_with_those_that_exist():
    with pytest.raises(ParameterError, match="'lenght_um'.*Example has flag, count, length_um"):
        Example.from_mapping({'lenght_um': 1.0})


def test_numbers_take_the_type_of_the_default():
    example = Example(count=3.0, length_um=2, many_v=[1, 2])
    assert (type(example.count), type(example.length_um)) == (int, float)
    assert example.many_v == (1.0, 2.0)
    assert all(type(value) is float for value in example.many_v)


def test_a_set_survives_the_way_through_a_mapping():
    example = Example(flag=False, many_v=(3.0,))
    assert example.to_mapping()['many_v'] == [3.0]
    assert Example.from_mapping(example.to_mapping()) == example
    assert example.replaced(count=7) == Example(flag=False, many_v=(3.0,), count=7)
    with pytest.raises(ParameterError, match='count is 70'):
        example.replaced(count=70)


@pytest.mark.parametrize('parameter_set', SETS)
@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf, 1e300, -1e300, 'text', None])
def test_no_number_of_any_set_may_be_other_than_finite_and_in_range(parameter_set, bad):
    for name, default in numbers(parameter_set):
        value = [bad, *default[1:]] if isinstance(default, list) else bad
        with pytest.raises(ParameterError, match=f'^{name} is .*(allowed is|must be)'):
            parameter_set.from_mapping({name: value})


@pytest.mark.parametrize('parameter_set', [
    *SETS, *sorted({each for sets in NODE_PARAMETERS.values() for each in sets},
                   key=lambda each: each.__name__)])
def test_the_defaults_of_every_set_are_allowed(parameter_set):
    assert parameter_set.from_mapping(parameter_set().to_mapping()) == parameter_set()


@pytest.mark.parametrize(('values', 'message'), [
    ({'kappa_um_per_v': [1.0]},
     'kappa_um_per_v has 1 values and saturation_v 10; there must be one kappa more than'),
    ({'kappa_um_per_v': [0.0] * 11}, 'kappa_um_per_v is 0.0 um/V, allowed is 1e-06 … 1e+09 um/V'),
    ({'saturation_v': [-0.1] * 10}, 'saturation_v is -0.1 V, allowed is 0 … 1000 V'),
    ({'operating_point_v': 11.0}, 'operating_point_v is 11.0, allowed is -2.0 … 10.0'),
    ({'operating_point_um': 12.5}, 'operating_point_um is 12.5, allowed is 0.0 … 12.0'),
    ({'voltage_minimum_v': 6.0}, 'operating_point_v is 5.0, allowed is 6.0 … 10.0'),
    ({'order': 'both'}, "order is 'both', allowed are physical, lumped"),
    ({'seed': -1}, 'seed is -1, allowed is 0 … '),
    ({'slew_limit_v_per_s': -1.0}, 'slew_limit_v_per_s is -1.0 V/s, allowed is 0 … 1e+09 V/s'),
    ({'damping_ratio_1': 1e-6, 'damping_ratio_1_mismatch': -0.5},
     'with its mismatches the rig is out of range: damping_ratio_1 is 5e-07'),
    ({'gain_k_rad3_per_s3': 0.0}, 'gain_k_rad3_per_s3 is 0.0 rad^3/s^3, allowed is 1e-24 …'),
])
def test_a_rig_that_cannot_be_is_refused(values, message):
    with pytest.raises(ParameterError) as refusal:
        RigParameters.from_mapping(values)
    assert str(refusal.value).startswith(message)
