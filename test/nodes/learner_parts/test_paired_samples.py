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

"""Two streams cut into blocks of their own, paired by index."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from piezo_ros.nodes.learner_parts.paired_samples import PairedSamples

blocks = st.lists(st.integers(1, 9), min_size=1, max_size=12)


@given(first=st.tuples(st.integers(0, 30), st.integers(0, 30)), sizes=st.tuples(blocks, blocks),
       order=st.randoms(use_true_random=False))
def test_whatever_comes_first_the_pairs_are_those_of_one_index(first, sizes, order):
    paired, got = PairedSamples(), []
    coming = [[], []]
    for which in range(2):
        index = first[which]
        for size in sizes[which]:
            coming[which].append((index, np.arange(index, index + size) + 0.25 * which))
            index += size
    ends = [parts[-1][0] + parts[-1][1].size for parts in coming]
    while any(coming):
        which = order.choice([k for k in range(2) if coming[k]])
        paired.add(which, *coming[which].pop(0))
        for index, one, other in paired.take():
            assert one.size == other.size > 0
            assert one[0] == index
            np.testing.assert_array_equal(one + 0.25, other)
            got += one.tolist()
    assert got == list(range(max(first), max(min(ends), max(first))))
