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

"""The launch files themselves, where `launch` is installed."""

import ast
from pathlib import Path

import pytest

from piezo_ros.launching.arguments import LAUNCH_FILES

FOLDER = Path(__file__).parents[2] / 'launch'


def test_every_launch_file_is_in_the_table_and_does_nothing_but_hand_it_over():
    files = {path.name: path for path in FOLDER.glob('*.launch.py')}
    assert files.keys() == LAUNCH_FILES.keys()
    for path in files.values():
        *_, function = ast.parse(path.read_text(encoding='utf-8')).body
        assert isinstance(function, ast.FunctionDef)
        assert function.name == 'generate_launch_description'
        assert ast.unparse(function.body[-1]) == 'return describe(Path(__file__))'


@pytest.mark.parametrize('name', LAUNCH_FILES)
def test_launch_knows_every_argument(name):
    pytest.importorskip('launch_ros')
    from launch.launch_description_sources import get_launch_description_from_python_launch_file
    description = get_launch_description_from_python_launch_file(str(FOLDER / name))
    declared = {argument.name: argument for argument in description.get_launch_arguments()}
    assert list(declared) == [argument.name for argument in LAUNCH_FILES[name]]
    for argument in LAUNCH_FILES[name]:
        assert declared[argument.name].description.startswith(argument.description)
        assert tuple(declared[argument.name].choices or ()) == argument.choices
