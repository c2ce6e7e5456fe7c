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

"""Many rigs that start at the same time in one domain: every node learns of its peers."""

from pathlib import Path

import pytest

from piezo_ros.bag import read

CONFIG = Path(__file__).parents[2] / 'config'
FILES = {'plant': 'rig', 'compensator': 'compensator', 'controller': 'controller',
         'trajectory': 'trajectory'}


@pytest.mark.slow
@pytest.mark.parametrize('number', range(8))
def test_four_rigs_started_at_once_in_one_domain_all_record(make_rig, number):
    rigs = [make_rig() for _ in range(4)]
    recorders = []
    for rig in rigs:
        rig.environment['ROS_DOMAIN_ID'] = str(rigs[0].domain)
        recorders.append(rig.node(
            'recorder', bag_directory=rig.directory / 'bag', handshake_timeout_s=60.0))
        for role, file in FILES.items():
            rig.start_node(
                role, '--params-file', str(CONFIG / f'{file}.yaml'), '-p', 'required_readers:=2',
                '-p', 'handshake_timeout_s:=60.0', '-p', 'watchdog_s:=60.0',
                *(('-p', 'periods:=0.3') if role == 'trajectory' else ()))
    for rig, recorder in zip(rigs, recorders, strict=True):
        assert recorder.wait() == 0, recorder.output
        assert read(rig.directory / 'bag').samples == 100
