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

"""Damaged bags: refused, or read as far as they are right with a word on what is lost."""

import resource

import pytest
from bag_trials import BagTrials, make_bags
from fault_results import add_results, first_trial, number_of_trials

QUICK_TRIALS = 40
SLOW_TRIALS = 3000
MEMORY_KB = 400_000  # what all trials together may need more than before


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    return make_bags(tmp_path_factory.mktemp('bags'))


@pytest.fixture
def trials(tmp_path, bags):
    return BagTrials(tmp_path, bags)


def test_every_kind_of_damage_changes_a_bag(trials):
    unchanged = set(trials.names)
    for number in range(len(trials.names) * 9):
        if number % 9 not in (1, 8):
            continue
        _, name, files = trials.damaged(number)
        if files != trials.files_before(number):
            unchanged.discard(name)
    assert not unchanged


def test_some_damaged_bags_are_refused_or_read_as_far_as_they_are_right(trials):
    # Strides that reach every kind of damage and every bag.
    for number in range(QUICK_TRIALS):
        trials.run(7 * number)
    assert not trials.failures, '\n'.join(trials.failures)


@pytest.mark.slow
@pytest.mark.timeout(0)
def test_damaged_bags_are_refused_or_read_as_far_as_they_are_right(trials):
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    first = first_trial()
    numbers = range(first, first + number_of_trials(SLOW_TRIALS))
    for number in numbers:
        trials.run(number)
    add_results('bag_mutations', trials.counts, trials.failures, numbers)
    assert not trials.failures, '\n'.join(trials.failures)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < before_kb + MEMORY_KB
