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

from piezo_ros.report.analysis.draw_statistics import dependences, quantile, scalar_draws


def test_the_interval_of_a_quantile_covers_the_true_one_as_often_as_it_says():
    generator = np.random.default_rng(3)
    covered = [
        one.low <= 1.2815516 <= one.high
        for one in (quantile(generator.standard_normal(200), 0.9) for _ in range(400))]
    assert 0.92 <= np.mean(covered) <= 0.99


def test_of_too_few_draws_no_interval_is_told():
    one = quantile([1.0, 2.0, 3.0], 0.99)
    assert one.value == pytest.approx(2.98)
    assert one.high is None


def test_dependences_of_either_shape_are_found_and_chance_is_not():
    generator = np.random.default_rng(5)
    rising, either_sign, nothing = generator.uniform(-1.0, 1.0, (3, 2000))
    scores = np.exp(rising) + 4.0 * either_sign ** 2 + 0.1 * generator.standard_normal(2000)
    found = {each.name: each for each in dependences(scores, {
        'rising': rising, 'either': either_sign, 'nothing': nothing, 'fixed': np.ones(2000)})}
    assert set(found) == {'rising', 'either', 'nothing'}
    assert found['rising'].low > 0.3
    assert abs(found['either'].rank_correlation) < 0.1
    assert found['either'].variance_share > 0.5
    assert min(found['either'].at_lowest, found['either'].at_highest) > found['either'].median
    assert found['nothing'].low < 0.0 < found['nothing'].high
    assert found['nothing'].variance_share < 0.02


def test_of_few_draws_nothing_is_said():
    assert dependences(np.arange(20.0), {'x': np.arange(20.0)}) == ()


def test_a_list_is_its_elements_or_its_mean():
    each = [{'p': [1.0, 2.0]}, {'p': [1.1, 1.9]}, {'p': [0.9, 2.2]}]
    assert sorted(scalar_draws(each, 'p')) == ['p[0]', 'p[1]']
    whole = [{'p': [1.0, 2.0]}, {'p': [1.1, 2.2]}]
    assert list(scalar_draws(whole, 'p')) == ['mean of p']
    assert scalar_draws([{'p': 'a'}, {'p': 'b'}], 'p') == {}
