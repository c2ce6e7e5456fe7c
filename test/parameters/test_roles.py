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

"""The role of a node with any name, and files of such nodes."""

import pytest

from piezo_ros.parameters.node_parameters import NODE_PARAMETERS, check_node_parameters
from piezo_ros.parameters.parameter_file import parameters_yaml, read_parameter_file
from piezo_ros.parameters.roles import parameters_by_role, role_of, roles_of

COMPLETE = {role: check_node_parameters(role, {}) for role in NODE_PARAMETERS}


@pytest.mark.parametrize('role', NODE_PARAMETERS)
def test_a_node_is_what_it_has_the_parameters_of(role):
    assert role_of(COMPLETE[role]) == role
    assert role_of({**COMPLETE[role], 'use_sim_time': False, 'gain_of_mine': 1.0}) == role
    for name in COMPLETE[role]:
        assert role_of({key: COMPLETE[role][key] for key in COMPLETE[role] if key != name}) is None


def test_what_has_parameters_of_two_roles_is_neither():
    assert role_of({**COMPLETE['plant'], **COMPLETE['controller']}) is None
    assert role_of({}) is None


def test_a_name_counts_only_where_no_parameters_tell():
    nodes = {
        '/rig/plant': COMPLETE['controller'], 'stage1': COMPLETE['plant'],
        '/real/plant': {'serial_number': 5}, 'compensator': {}, '/other': {}}
    assert roles_of(nodes) == {
        '/rig/plant': 'controller', 'stage1': 'plant', '/real/plant': 'plant',
        'compensator': 'compensator', '/other': 'other'}
    assert parameters_by_role(nodes) == {
        'controller': COMPLETE['controller'], 'plant': COMPLETE['plant'], 'compensator': {},
        'other': {}}


def test_of_two_nodes_with_one_role_nothing_is_said():
    nodes = {'a': COMPLETE['plant'], 'b': COMPLETE['plant'], 'c': COMPLETE['controller']}
    assert parameters_by_role(nodes) == {'controller': COMPLETE['controller']}


def test_a_file_of_full_names_keeps_them(tmp_path):
    path = tmp_path / 'file.yaml'
    path.write_text(parameters_yaml('/rig', {'/other/a': {'x': 1}, 'b': {'x': 2}}))
    assert path.read_text() == (
        '/other/a:\n  ros__parameters:\n    x: 1\n/rig/b:\n  ros__parameters:\n    x: 2\n')


def test_a_dump_of_a_renamed_node_is_read(tmp_path):
    path = tmp_path / 'dump.yaml'
    path.write_text(parameters_yaml('/rig', {'stage1': COMPLETE['plant'], 'other': {'seed': 3}}))
    values = read_parameter_file(path, ['plant', 'compensator'])
    assert values == {'plant': COMPLETE['plant']}
