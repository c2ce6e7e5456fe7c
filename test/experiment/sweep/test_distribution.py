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

from piezo_ros.experiment.sweep.distribution import read_distribution


def draws(content, base=None, count=2000, name='plant.x', seed=1):
    distribution = read_distribution(content)
    return [distribution.draw(base, name, seed, number) for number in range(count)]


def test_draws_follow_their_distribution():
    uniform = np.array(draws({'uniform': [-1.0, 3.0]}))
    assert -1.0 <= uniform.min() < -0.98
    assert 2.98 < uniform.max() <= 3.0
    assert uniform.mean() == pytest.approx(1.0, abs=0.1)
    normal = np.array(draws({'normal': [5.0, 0.5]}))
    assert normal.mean() == pytest.approx(5.0, abs=0.05)
    assert normal.std() == pytest.approx(0.5, rel=0.1)
    log_uniform = np.array(draws({'log_uniform': [1e-4, 1e-2]}))
    assert np.median(log_uniform) == pytest.approx(1e-3, rel=0.2)
    assert set(draws({'integers': [2, 4]})) == {2, 3, 4}
    assert set(draws({'choice': ['a', 'b']})) == {'a', 'b'}


def test_a_draw_depends_on_seed_number_and_name_alone():
    content = {'normal': [0.0, 1.0]}
    assert draws(content, count=5) == draws(content, count=50)[:5]
    assert draws(content, count=5) != draws(content, count=5, seed=2)
    assert draws(content, count=5) != draws(content, count=5, name='plant.y')


def test_a_relative_draw_multiplies_what_is_there():
    (scalar,) = draws({'times': {'choice': [3.0]}}, base=2.0, count=1)
    assert scalar == 6.0
    (whole,) = draws({'times': {'uniform': [0.9, 1.1]}}, base=[1.0, 2.0, 4.0], count=1)
    assert whole[1] == pytest.approx(2 * whole[0])
    assert whole[2] == pytest.approx(4 * whole[0])
    (each,) = draws({'each_times': {'uniform': [0.9, 1.1]}}, base=[1.0, 1.0, 1.0], count=1)
    assert len(set(each)) == 3
    assert all(0.9 <= value <= 1.1 for value in each)


@pytest.mark.parametrize(('content', 'message'), [
    (1.0, 'a mapping of one entry'),
    ({'uniform': [0, 1], 'normal': [0, 1]}, 'a mapping of one entry'),
    ({'gauss': [0, 1]}, "'gauss' is no distribution, allowed are uniform, log_uniform, normal"),
    ({'times': {'times': [0, 1]}}, "'times' is no distribution"),
    ({'uniform': [1, 0]}, r'uniform is \[1, 0\], it must be \[low, high\]'),
    ({'uniform': [0]}, 'it must be'),
    ({'uniform': 0}, 'it must be'),
    ({'uniform': ['a', 'b']}, 'it must be'),
    ({'uniform': [0, math.inf]}, 'it must be'),
    ({'normal': [0, -1]}, 'standard deviation'),
    ({'log_uniform': [0, 1]}, 'both above 0'),
    ({'integers': [0.5, 2]}, 'lowest, highest'),
    ({'choice': []}, 'a list of values'),
    ({'times': {'choice': ['a']}}, 'a list of values'),
])
def test_what_is_no_distribution_is_refused(content, message):
    with pytest.raises(ValueError, match=message):
        read_distribution(content)
