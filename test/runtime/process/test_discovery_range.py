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

import contextlib
import os
import sys
from pathlib import Path

import pytest

from piezo_ros.live.supervisor import Supervisor
from piezo_ros.runtime.process.middleware import initialise_rclpy
from piezo_ros.runtime.process.ros_distribution import profiles_of_fastdds
from piezo_ros.runtime.process.ros_environment import keep_discovery_on_this_machine

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
CHOICES = ['ROS_STATIC_PEERS', 'ROS_DISCOVERY_SERVER', 'ROS_LOCALHOST_ONLY']
TRANSPORTS = 'FASTDDS_BUILTIN_TRANSPORTS'
PROFILES = profiles_of_fastdds()[0]


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    for variable in (RANGE, TRANSPORTS, PROFILES, *CHOICES):
        # Set and deleted, so that what is set by the test is taken back afterwards.
        monkeypatch.setenv(variable, '')
        monkeypatch.delenv(variable)
    return monkeypatch


def _ranges_of_rclpy(environment):
    """Initialise rclpy; return what it and what comes later finds of the two variables."""
    found = []

    def look(**_):
        found.append((os.environ.get(RANGE), os.environ.get('ROS_LOCALHOST_ONLY')))

    environment.setattr('rclpy.init', look)
    initialise_rclpy()
    look()
    return found


@pytest.mark.parametrize(('variable', 'value', 'expected'), [
    (RANGE, 'LOCALHOST', [('SYSTEM_DEFAULT', None), ('LOCALHOST', None)]),
    ('ROS_LOCALHOST_ONLY', '1', [('SYSTEM_DEFAULT', None), (None, '1')])])
def test_shared_memory_is_left_out_by_a_profile_of_our_own(environment, variable, value, expected):
    environment.setenv(variable, value)
    # The children of a process inherit what it has set.
    for _ in range(2):
        assert _ranges_of_rclpy(environment) == expected
        assert os.environ[PROFILES] == str(profiles_of_fastdds(localhost=True)[1])


@pytest.mark.parametrize(('variable', 'value'), [
    (PROFILES, 'mine.xml'), (TRANSPORTS, 'SHM'), ('ROS_STATIC_PEERS', '10.0.0.7'),
    ('ROS_DISCOVERY_SERVER', '127.0.0.1:11811')])
def test_who_has_said_more_gets_what_the_middleware_makes_of_it(environment, variable, value):
    environment.setenv(RANGE, 'LOCALHOST')
    environment.setenv(variable, value)
    assert _ranges_of_rclpy(environment) == [('LOCALHOST', None)] * 2
    assert os.environ[variable] == value
    assert 'localhost' not in os.environ[PROFILES]


@pytest.mark.parametrize('value', [None, 'SUBNET', 'OFF', 'SYSTEM_DEFAULT'])
def test_another_range_is_left_to_the_middleware(environment, value):
    if value:
        environment.setenv(RANGE, value)
    assert _ranges_of_rclpy(environment) == [(value, None)] * 2
    assert os.environ[PROFILES] == str(profiles_of_fastdds()[1])


def test_another_middleware_gets_the_range(environment):
    environment.setenv(RANGE, 'LOCALHOST')
    environment.setattr('rclpy.get_rmw_implementation_identifier', lambda: 'rmw_cyclonedds_cpp')
    assert _ranges_of_rclpy(environment) == [('LOCALHOST', None)] * 2


@pytest.mark.parametrize('variables', [
    {RANGE: 'LOCALHOST'}, {'ROS_LOCALHOST_ONLY': '1', RANGE: 'SUBNET'}, {RANGE: 'SUBNET'}])
def test_no_node_has_shared_memory_whoever_shall_find_it(rig, until, variables):
    rig.environment = {
        name: value for name, value in os.environ.items() if name != PROFILES} | {
            'ROS_DOMAIN_ID': str(rig.domain), **variables}
    node = rig.node('plant', handshake_timeout_s=60.0)
    # Shared memory is made before the sockets.
    until(lambda: [target for target in _files(node.pid) if target.startswith('socket:')],
          'its transports')
    assert not [target for target in _files(node.pid) if '/dev/shm/fast' in target]


def _files(pid):
    """Return what a process has open, and the lines of what it has mapped."""
    targets = Path(f'/proc/{pid}/maps').read_text().splitlines()
    for entry in Path(f'/proc/{pid}/fd').iterdir():
        with contextlib.suppress(OSError):  # closed by now
            targets.append(str(entry.readlink()))
    return targets


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
