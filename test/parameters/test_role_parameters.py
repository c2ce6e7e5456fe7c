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

"""Parameter files reach a node by its role, whatever it is called."""

from pathlib import Path

import pytest

from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.role_parameters import parameter_files, role_parameters


@pytest.mark.parametrize(('pattern', 'arrives'), [
    ('/**/plant', True), ('/**', True), ('/lab/plant', True), ('/*/plant', True),
    ('lab/plant', True), ('/plant', False), ('/other/plant', False), ('/**/stage', False),
    ('/*', False), ('/**/lab/plant', True)])
def test_a_section_arrives_as_if_the_node_had_the_name_of_its_role(tmp_path, pattern, arrives):
    file = tmp_path / 'rig.yaml'
    file.write_text(f'{pattern}:\n  ros__parameters:\n    seed: 7\n')
    assert role_parameters('plant', '/lab', [file]) == ({'seed': 7} if arrives else {})


def test_sections_may_lie_in_each_other_and_later_ones_count(tmp_path):
    first, second = tmp_path / 'a.yaml', tmp_path / 'b.yaml'
    first.write_text(
        'lab:\n  plant:\n    ros__parameters:\n      seed: 7\n      noise_rms_um: 1e-3\n')
    second.write_text('/**/plant:\n  ros__parameters:\n    seed: 8\n')
    assert role_parameters('plant', '/lab', [first, second]) == {'seed': 8, 'noise_rms_um': 1e-3}


def test_files_are_those_named_for_ros():
    words = ['plant', '--params-file', 'mine', '--ros-args', '--params-file', 'a', '-p', 'x:=1',
             '--params-file', 'b', '--', '--params-file', 'mine']
    assert parameter_files(words) == [Path('a'), Path('b')]


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(PlanError, match='absent'):
        role_parameters('plant', '/', [tmp_path / 'absent'])
