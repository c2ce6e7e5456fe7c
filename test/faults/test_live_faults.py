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

"""
The failure matrix on real processes: what must hold whatever breaks, wherever and whenever.

`PIEZO_FAULT_TRIALS` is the number of trials of the slow test; its cells are drawn by their seed.
"""

import random
import shutil
from collections import Counter

import pytest
from fault_matrix import CELLS, Cell
from fault_results import add_results, first_trial, number_of_trials
from fault_trials import FaultTrial
from message_mutations import arrives_as_block
from processes import was_cut_off_while_starting

from piezo_ros.streams import BlockCodec

SLOW_TRIALS = 12
QUICK = (Cell('malformed bytes', 'voltage', 'composed', 'run'),)


def _cell(number):
    """Return the cell of a trial: in each round of all cells every one of them comes once."""
    rounds, place = divmod(number, len(CELLS))
    return random.Random(rounds).sample(CELLS, len(CELLS))[place]


def test_a_round_of_the_matrix_has_each_cell_once():
    assert sorted(_cell(number) for number in range(len(CELLS))) == sorted(CELLS)


@pytest.mark.parametrize(('output', 'is_cut_off'), [
    ('Fatal Python error: init_import_site: Failed to import the site module', True),
    ('Traceback\n  File "a/executables.py", line 20, in <module>\nKeyboardInterrupt\n', True),
    ('Traceback\n  File "a/host.py", line 20, in host\nKeyboardInterrupt\n', False),
    ('Traceback (most recent call last):\nValueError: no\n', False),
    ('', False),
])
def test_a_traceback_is_forgiven_only_before_the_first_line_of_a_node(output, is_cut_off):
    assert was_cut_off_while_starting(output) is is_cut_off


@pytest.mark.parametrize(('missing', 'is_block'), [(0, True), (2, True), (4, False)])
def test_a_message_that_the_middleware_completes_is_a_block(missing, is_block):
    message = BlockCodec('displacement').encode(0, 1e-5, [1.0, 2.0])
    assert arrives_as_block('displacement', message[:len(message) - missing]) is is_block


@pytest.mark.parametrize('cell', QUICK, ids=lambda cell: cell.title)
def test_a_fault_leaves_right_samples_and_a_right_exit_code(rig, make_peer, write_plan, cell):
    FaultTrial(cell, rig, make_peer, write_plan, 0).run()


@pytest.mark.slow
@pytest.mark.timeout(0)
def test_faults_leave_right_samples_and_right_exit_codes(make_rig, make_peer, write_plan):
    counts, failures, first = Counter(), [], first_trial()
    numbers = range(first, first + number_of_trials(SLOW_TRIALS))
    for number in numbers:
        cell, rig = _cell(number), make_rig()
        title, outcome = f'{cell.fault}: {cell.place}', 'failed'
        try:
            outcome = FaultTrial(cell, rig, make_peer, write_plan, number).run()
        except (AssertionError, pytest.fail.Exception) as error:
            failures.append(f'trial {number}, {cell.title}: {str(error)[:1000]}')
        finally:
            rig.destroy()
        counts[title, outcome] += 1
        if outcome != 'failed':
            shutil.rmtree(rig.directory)
    add_results('live_faults', counts, failures, numbers)
    assert not failures, '\n'.join(failures)
