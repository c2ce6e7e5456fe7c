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

from piezo_ros.model.noise import NoiseSource, unit_noise

COUNT = 10000  # more than two of the generator's chunks


def test_the_noise_of_a_sample_depends_on_seed_and_index_alone():
    whole = unit_noise(5, 0, COUNT)
    assert unit_noise(5, 0, COUNT).tobytes() == whole.tobytes()
    rng = np.random.default_rng(0)
    for start, stop in np.sort(rng.integers(0, COUNT, (50, 2))):
        assert unit_noise(5, int(start), int(stop - start)).tobytes() == whole[start:stop].tobytes()


def test_one_by_one_in_any_order_it_is_the_same_noise():
    whole = unit_noise(5, 0, COUNT)
    source = NoiseSource(5)
    assert [source(index) for index in range(COUNT)] == whole.tolist()
    for index in np.random.default_rng(1).integers(0, COUNT, 100).tolist():
        assert source(index) == whole[index]


@pytest.mark.parametrize('start', [0, 4095, 4096, 2**40, 2**53 - 10])
def test_it_goes_on_at_any_index(start):
    source = NoiseSource(1)
    assert unit_noise(1, start, 10).tolist() == [source(start + k) for k in range(10)]


@pytest.mark.parametrize('count', [0, -1])
def test_no_samples_have_no_noise(count):
    assert unit_noise(1, 4096, count).shape == (0,)


def test_it_is_white_and_of_unit_variance():
    noise = unit_noise(3, 0, 400_000)
    four_sigma = 4 / np.sqrt(noise.size)
    assert abs(noise.mean()) < four_sigma
    assert abs(noise.var() - 1) < four_sigma * np.sqrt(2)
    # Lags within a chunk of the generator, across its bounds, and from chunk to chunk.
    for lag in (1, 2, 3, 10, 100, 4095, 4096, 4097, 8192):
        assert abs(np.mean(noise[lag:] * noise[:-lag])) < four_sigma * 1.1


@pytest.mark.parametrize('other', [0, 2, 4097, 2**53])
def test_another_seed_gives_other_noise(other):
    one, another = unit_noise(1, 0, COUNT), unit_noise(other, 0, COUNT)
    assert not np.any(one == another)
    assert abs(np.mean(one * another)) < 4 / np.sqrt(COUNT)


def test_a_source_gives_blocks_and_single_samples_of_the_same_noise():
    source = NoiseSource(3)
    whole = unit_noise(3, 0, 10_000)
    for start, count in [(0, 10), (10, 5000), (5010, 1), (9000, 1000), (4095, 2), (7, 0)]:
        np.testing.assert_array_equal(source.block(start, count), whole[start:start + count])
        assert source(start) == whole[start]
