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

"""Samples that wait: the same as a deque, and what is in use stays as it is."""

from collections import deque

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezo_ros.runtime.streams.sample_queue import SampleQueue

# What is done: so many samples come alone, in one block, go alone, are used, go unseen.
STEPS = st.lists(st.tuples(
    st.sampled_from(['append', 'extend', 'popleft', 'pull', 'drop', 'clear']),
    st.integers(0, 3000)), max_size=40)


@given(STEPS)
def test_it_is_a_deque_whose_used_samples_stay(steps):
    queue, expected, number = SampleQueue(), deque(), 0
    used = []
    for what, count in steps:
        if what in ('append', 'extend'):
            new = np.arange(number, number + count, dtype=float)
            number += count
            expected.extend(new)
            if what == 'extend':
                queue.extend(new)
            else:
                for sample in new[:10]:
                    queue.append(sample)
                queue.extend(new[10:].tolist())
        elif what == 'popleft':
            for _ in range(min(count, 10, len(expected))):
                sample = queue.popleft()
                assert type(sample) is float
                assert sample == expected.popleft()
        elif what == 'pull':
            head = queue.pull(count)
            used.append((head, head.copy()))
            assert head.tolist() == list(expected)[:count]
            for _ in range(head.size):
                expected.popleft()
        else:
            count = len(expected) if what == 'clear' else count
            for _ in range(min(count, len(expected))):
                expected.popleft()
            if what == 'clear':
                queue.clear()
            else:
                queue.drop(count)
        assert len(queue) == len(expected)
    assert queue.pull(len(queue)).tolist() == list(expected)
    for head, before in used:
        np.testing.assert_array_equal(head, before)


def test_nothing_comes_out_of_an_empty_one():
    queue = SampleQueue()
    queue.extend([1.0])
    queue.popleft()
    with pytest.raises(IndexError, match='no sample waits'):
        queue.popleft()
