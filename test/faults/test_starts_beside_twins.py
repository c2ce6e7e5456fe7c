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
Starts and ends of the composed loop and a recorder beside idle nodes of the same full names.

No process dies by a signal that it was not sent, whenever it ends. `PIEZO_FAULT_TRIALS` is the
number of starts, several rigs at a time.
"""

import random
import shutil
import signal
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor

import pytest
import rclpy
from fault_results import add_results, first_trial, number_of_trials
from processes import was_cut_off_while_starting

from piezo_ros.bag import read

SLOW_TRIALS = 12
AT_ONCE = 3
NAMES = ('plant', 'compensator', 'controller', 'trajectory')
SAMPLES = 333  # of one period
LATEST_S = 4.0  # by which most runs are over


def _start_and_end(rig, number):
    """Start a loop and its recorder and end them; return how, and what went wrong."""
    generator = random.Random(number)
    end = generator.choice(['whole run', 'SIGINT', 'SIGTERM'])
    bag = rig.directory / f'bag_{number}'
    recorder = rig.node('recorder', bag_directory=bag, parameters_timeout_s=1.0)
    loop = rig.node(
        'loop', required_readers=2, periods=1.0, linger_s=-1.0, watchdog_s=60.0, compiled='false')
    sent = signal.SIGINT
    if end == 'whole run':
        recorder.wait()
    else:
        sent = signal.Signals[end]
        time.sleep(generator.uniform(0.0, LATEST_S))
    loop.send(sent)
    loop.wait()
    if recorder.exit_code is None:
        recorder.send(sent)
    recorder.wait()
    wrong = [
        f'{name} ended with {process.exit_code}: {process.output[-2000:]}'
        for name, process in (('loop', loop), ('recorder', recorder))
        if not _is_in_order(process, end, sent)]
    if end == 'whole run' and not wrong and read(bag).samples != SAMPLES:
        wrong = [f'{read(bag).samples} samples']
    shutil.rmtree(bag, ignore_errors=True)
    return end, wrong


def _is_in_order(process, end, sent):
    code = process.exit_code
    if end == 'whole run':
        return code == 0 and 'Traceback' not in process.output
    if not process.output or was_cut_off_while_starting(process.output):
        return code in (0, 1, -sent)
    return code in (0, 1) and 'Traceback' not in process.output


@pytest.mark.slow
@pytest.mark.timeout(0)
def test_the_composed_loop_starts_and_ends_beside_twins(make_rig, make_peer):
    counts, failures = Counter(), []
    rigs = [make_rig() for _ in range(AT_ONCE)]
    twins = []
    for rig in rigs:
        peer = make_peer(rig)
        twins += [
            rclpy.create_node(name, namespace=rig.namespace, context=peer.node.context)
            for name in NAMES for _ in range(2)]
    numbers = range(first_trial(), first_trial() + number_of_trials(SLOW_TRIALS))

    def trials(place):
        return [
            (number, *_start_and_end(rigs[place], number)) for number in numbers[place::AT_ONCE]]

    with ThreadPoolExecutor(AT_ONCE) as threads:
        for done in threads.map(trials, range(AT_ONCE)):
            for number, end, wrong in done:
                counts[f'ended by {end}', 'failed' if wrong else 'in order'] += 1
                failures += [f'trial {number}, {end}: {text}' for text in wrong]
    for twin in twins:
        twin.destroy_node()
    add_results('starts_beside_twins', counts, failures, numbers)
    assert not failures, '\n'.join(failures)
