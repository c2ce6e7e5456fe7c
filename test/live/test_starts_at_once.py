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

"""Rigs that come and go in one domain, several at a time: every node learns of its peers."""

import signal
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from pathlib import Path

import pytest

from piezo_ros.bag import read

CONFIG = Path(__file__).parents[2] / 'config'
FILES = {'plant': 'rig', 'compensator': 'compensator', 'controller': 'controller',
         'trajectory': 'trajectory'}
RUNS = 8
AT_ONCE = 4


def record_again_and_again(rigs):
    """Start the nodes of one rig after the other; return what went wrong."""
    wrong = []
    for rig in rigs:
        recorder = rig.node('recorder', bag_directory=rig.directory / 'bag')
        nodes = [
            rig.start_node(
                role, '--params-file', str(CONFIG / f'{file}.yaml'), '-p', 'required_readers:=2',
                '-p', 'linger_s:=-1.0', '-p', 'watchdog_s:=60.0',
                *(('-p', 'periods:=0.3') if role == 'trajectory' else ()))
            for role, file in FILES.items()]
        code = recorder.wait()
        for node in nodes:
            node.send(signal.SIGINT)
        codes = [node.wait() for node in nodes]
        if code or any(codes) or read(rig.directory / 'bag').samples != 100:
            wrong += [each.output for each in (recorder, *nodes)]
    return wrong


@pytest.mark.slow
def test_rigs_that_come_and_go_beside_each_other_all_record(make_rig):
    rigs = [[make_rig() for _ in range(RUNS)] for _ in range(AT_ONCE)]
    for each in rigs:
        for rig in each:
            rig.environment['ROS_DOMAIN_ID'] = str(rigs[0][0].domain)
    with ThreadPoolExecutor(AT_ONCE) as threads:
        assert [*chain.from_iterable(threads.map(record_again_and_again, rigs))] == []
