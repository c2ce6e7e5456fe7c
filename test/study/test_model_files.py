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

from types import SimpleNamespace

import pytest

from piezo_ros.parameters.parameter_file import read_parameter_file
from piezo_ros.study.model_files import write_models


def section(node, name):
    return lambda *_, **__: f'/**/{node}:\n  ros__parameters:\n    {name}: 1.5\n'


@pytest.mark.parametrize('has_gains', [False, True])
def test_each_model_of_a_study_is_a_parameter_file(tmp_path, has_gains):
    wanted = {'compensator': 'creep_per_decade', 'trajectory': 'time_constant_s'}
    gains = SimpleNamespace(to_parameter_yaml=section('controller', 'proportional_gain'))
    write_models(tmp_path, *(
        SimpleNamespace(to_parameter_yaml=section(*pair)) for pair in wanted.items()),
        gains if has_gains else None)
    if has_gains:
        wanted['controller'] = 'proportional_gain'
    assert {path.stem for path in (tmp_path / 'models').iterdir()} == {*wanted}
    for node, name in wanted.items():
        values = read_parameter_file(tmp_path / 'models' / f'{node}.yaml', (node,))[node]
        assert values[name] == 1.5
    told = read_parameter_file(tmp_path / 'models' / 'trajectory.yaml', ('trajectory',))
    assert told['trajectory']['hysteresis_place'] == 'undecided'
