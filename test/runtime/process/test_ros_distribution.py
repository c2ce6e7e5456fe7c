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

"""What differs between the distributions of ROS 2."""

import os
import re
import sys
from importlib import metadata
from pathlib import Path
from xml.etree import ElementTree

import pytest

from piezo_ros.runtime.process import ros_distribution
from piezo_ros.runtime.process.middleware import set_middleware_defaults
from piezo_ros.runtime.process.ros_distribution import (
    make_events_executor,
    name_of_distribution,
    profiles_of_fastdds,
)

NODES = Path(ros_distribution.__file__).parent
VARIABLES = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')


@pytest.mark.parametrize(('version', 'name'), [
    ('7.1.6', 'jazzy'), ('9.1.2', 'kilted'), ('10.0.0', 'unknown')])
def test_wheels_tell_their_distribution_by_the_version_of_rclpy(monkeypatch, version, name):
    monkeypatch.delenv('ROS_DISTRO', raising=False)
    monkeypatch.setattr(metadata, 'version', lambda package: version)
    assert name_of_distribution() == name


def test_a_sourced_installation_says_it_itself(monkeypatch):
    monkeypatch.setenv('ROS_DISTRO', 'lyrical')
    assert name_of_distribution() == 'lyrical'


@pytest.mark.parametrize(('name', 'variable', 'file'), [
    ('jazzy', VARIABLES[1], 'fastdds2.xml'), ('kilted', VARIABLES[0], 'fastdds3.xml'),
    ('lyrical', VARIABLES[0], 'fastdds3.xml')])
def test_fast_dds_finds_its_profiles_where_it_looks_for_them(monkeypatch, name, variable, file):
    monkeypatch.setenv('ROS_DISTRO', name)
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET')
    for other in VARIABLES:
        # Set and deleted, so that what is set below is taken back afterwards.
        monkeypatch.setenv(other, '')
        monkeypatch.delenv(other)
    assert profiles_of_fastdds() == (variable, NODES / file)
    set_middleware_defaults()
    assert [os.environ.get(other) for other in VARIABLES] == [
        str(NODES / file) if other == variable else None for other in VARIABLES]


def test_a_profile_of_the_user_is_left_alone(monkeypatch):
    for variable in VARIABLES:
        monkeypatch.setenv(variable, 'mine.xml')
    set_middleware_defaults()
    assert [os.environ[variable] for variable in VARIABLES] == ['mine.xml', 'mine.xml']


def test_both_profiles_hold_the_same_settings():
    """Fast DDS 2 writes some names in camel case and never asks for types; all else is equal."""
    def settings(name):
        text = re.sub('<!--.*?-->', '', (NODES / name).read_text(), flags=re.DOTALL)
        if name.startswith('fastdds3'):
            text, found = re.subn(
                r'<propertiesPolicy>(?:\s|</?propert\w+>)*<name>fastdds.type_propagation</name>'
                r'\s*<value>disabled</value>(?:\s|</?propert\w+>)*', '', text)
            assert found == 1
        return re.sub('([A-Z])', lambda match: '_' + match[1].lower(), ''.join(text.split()))

    assert 'heartbeatPeriod' in (NODES / 'fastdds2.xml').read_text()
    assert settings('fastdds2.xml') == settings('fastdds3.xml')
    assert settings('fastdds2_localhost.xml') == settings('fastdds3_localhost.xml')


@pytest.mark.parametrize('name', ['fastdds2', 'fastdds3'])
def test_the_profile_for_one_machine_has_other_transports_and_addresses_alone(name):
    plain, localhost = (
        ElementTree.parse(NODES / f'{name}{ending}.xml').getroot() for ending in ('', '_localhost'))
    space = '{http://www.eprosima.com}'
    for parent, of_localhost in (
            ('profiles', ['transport_descriptors']),
            ('profiles/participant/rtps', ['userTransports', 'useBuiltinTransports']),
            ('profiles/participant/rtps/builtin',
             ['metatrafficUnicastLocatorList', 'initialPeersList'])):
        node = localhost.find('/'.join(space + tag for tag in parent.split('/')))
        for tag in of_localhost:
            node.remove(node.find(space + tag))
    assert _words(localhost) == _words(plain)


def _words(root):
    return ''.join(ElementTree.tostring(root, 'unicode').split())


def test_an_rclpy_without_the_executor_is_told(monkeypatch):
    home = sys.modules['rclpy.experimental'] = __import__('rclpy.experimental').experimental
    monkeypatch.delattr(home, 'EventsExecutor')
    with pytest.raises(ImportError, match=r'rclpy 7\.1\.4 of Jazzy'):
        make_events_executor()
