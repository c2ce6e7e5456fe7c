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

from piezo_ros.bag import BagError
from piezo_ros.bag.tables.time_base import time_base


def base(times_s, **options):
    return time_base('a.csv', np.asarray(times_s), lambda row: f'line {row + 2}', **options)


@pytest.mark.parametrize('period_s', [1e-4, 1.0 / 3000.0, 8e-5, 1.0 / 44100.0, 0.25])
@pytest.mark.parametrize('first_s', [0.0, -0.3, 1234.5])
def test_the_period_is_exact_where_the_times_are_rounded(period_s, first_s):
    times_s = np.round(first_s + period_s * np.arange(20_000), 6)
    found = base(times_s)
    assert found.sample_period_s == pytest.approx(period_s, rel=1e-9)
    assert found.at_s is None


def test_times_that_jitter_are_refused_and_may_be_resampled():
    rng = np.random.default_rng(1)
    times_s = 1e-3 * (np.arange(2000) + rng.uniform(-0.3, 0.3, 2000))
    with pytest.raises(BagError, match='not evenly spaced in time: line .* of a sample period'):
        base(times_s)
    found = base(times_s, resample=True, sample_period_s=1e-3)
    even_s = times_s[0] + np.arange(found.samples) * found.sample_period_s
    slow = np.sin(2 * np.pi * 10.0 * times_s)
    assert found.values(slow) == pytest.approx(np.sin(2 * np.pi * 10.0 * even_s), abs=2e-3)
    assert 'up to 5 % too small' in found.note


@pytest.mark.parametrize('resample', [False, True])
def test_a_gap_is_named_by_its_rows_and_never_filled(resample):
    times_s = 1e-3 * np.concatenate([np.arange(100), 150 + np.arange(100)])
    with pytest.raises(BagError, match=r'from line 101 to line 102 the time goes on by 0\.051 s'):
        base(times_s, resample=resample)


@pytest.mark.parametrize(('times_s', 'words'), [
    ([0.0, 1.0, 0.5, 2.0], r'line 4 is 0\.5 s, behind 1 s'),
    ([0.0, np.nan, 2.0], 'line 3 is nan, it must be a number'),
    ([0.0], 'has 1 rows, at least 2'),
])
def test_times_must_rise(times_s, words):
    with pytest.raises(BagError, match=words):
        base(times_s)


def test_a_period_that_disagrees_with_the_times_is_refused():
    with pytest.raises(BagError, match=r'0\.001 s by the times, and --sample-period-s 0\.002'):
        base(1e-3 * np.arange(100), sample_period_s=2e-3)
