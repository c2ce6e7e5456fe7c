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

"""Messages that are no block, in every input of every node: refused and counted, or a fault."""

import pytest
from fault_results import add_results, first_trial, number_of_trials
from ring_trials import INPUTS, RingTrials

SLOW_TRIALS = 30  # of each input


def test_some_malformed_messages_are_refused_or_end_the_run_with_a_reason(tmp_path):
    trials = RingTrials(tmp_path)
    for number in range(2 * len(INPUTS)):
        trials.run(number)
    assert not trials.failures, '\n'.join(trials.failures)


@pytest.mark.slow
@pytest.mark.timeout(0)
def test_malformed_messages_are_refused_or_end_the_run_with_a_reason(tmp_path):
    trials = RingTrials(tmp_path, compiled=True)
    first = first_trial()
    numbers = range(first, first + number_of_trials(SLOW_TRIALS * len(INPUTS)))
    for number in numbers:
        trials.run(number)
    add_results('message_mutations', trials.counts, trials.failures, numbers)
    assert not trials.failures, '\n'.join(trials.failures)
