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
"""Discovery is kept on the machine where the user has not said otherwise."""

import os
import sys

import pytest

from piezo_ros.live.supervisor import Supervisor
from piezo_ros.runtime.process.ros_environment import keep_discovery_on_this_machine

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
CHOICES = ['ROS_STATIC_PEERS', 'ROS_DISCOVERY_SERVER', 'ROS_LOCALHOST_ONLY']


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    for variable in (RANGE, *CHOICES):
        monkeypatch.delenv(variable, raising=False)
    return monkeypatch


@pytest.mark.parametrize('value', [None, ''])
def test_discovery_is_kept_on_the_machine_by_default(environment, value):
    if value is not None:
        environment.setenv(RANGE, value)
    keep_discovery_on_this_machine()
    assert os.environ[RANGE] == 'LOCALHOST'


@pytest.mark.parametrize('value', ['SUBNET', 'OFF', 'SYSTEM_DEFAULT'])
def test_a_range_of_the_user_stays(environment, value):
    environment.setenv(RANGE, value)
    keep_discovery_on_this_machine()
    assert os.environ[RANGE] == value


@pytest.mark.parametrize('variable', CHOICES)
def test_another_choice_of_the_user_stays(environment, variable):
    environment.setenv(variable, '1')
    keep_discovery_on_this_machine()
    assert RANGE not in os.environ


@pytest.mark.parametrize(('given', 'taken'), [(None, 'LOCALHOST'), ('SUBNET', 'SUBNET')])
def test_the_nodes_of_piezo_run_get_the_range(environment, tmp_path, given, taken):
    if given:
        environment.setenv(RANGE, given)
    program = tmp_path / 'tell'
    program.write_text(f'#!{sys.executable}\nimport os\nprint(os.environ["{RANGE}"])\n')
    program.chmod(0o755)
    with Supervisor('/test_range') as supervisor:
        environment.setattr(sys, 'executable', str(program))
        supervisor.processes.start('plant', [], tmp_path / 'plant.log')
        supervisor.spin_until(lambda: not supervisor.processes.going(), timeout_s=30.0)
    assert (tmp_path / 'plant.log').read_text() == f'{taken}\n'
