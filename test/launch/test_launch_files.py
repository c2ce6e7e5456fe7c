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

"""The launch files themselves: their arguments are the parameters that they set."""

import dataclasses

import pytest
from launch_files import FOLDER, LAUNCH_FILES

from piezo_ros.model.parameters import constraint_of
from piezo_ros.parameters.node_parameters import NODE_PARAMETERS

# Of parameters that several nodes have, those of the plant are meant.
NODES = ('recorder', 'controller', 'trajectory', 'plant')


def parameters():
    """Return name to field of what the arguments may set."""
    return {
        field.name: field for node in NODES for parameter_set in NODE_PARAMETERS[node]
        for field in dataclasses.fields(parameter_set)}


def test_the_launch_files_are_rig_loop_and_scan():
    assert [*LAUNCH_FILES] == ['loop.launch.py', 'rig.launch.py', 'scan.launch.py']


@pytest.mark.parametrize('name', LAUNCH_FILES)
def test_an_argument_that_is_a_parameter_says_of_it_what_the_node_declares(name):
    fields = parameters()
    found = 0
    for argument in LAUNCH_FILES[name]:
        if argument.name not in fields:
            continue
        found += 1
        field = fields[argument.name]
        constraint = constraint_of(field)
        unit = f' [{constraint.unit}]' if constraint.unit else ''
        default = str(field.default).lower() if isinstance(field.default, bool) else str(
            field.default)
        if argument.name == 'handshake_timeout_s':
            unit += f'; empty: what a parameter file says, else {default}'
            default = ''
        assert argument.default == default
        assert argument.description == constraint.description + unit
        assert argument.choices == (
            constraint.choices or (('true', 'false') if isinstance(field.default, bool) else ()))
    assert found == {'loop.launch.py': 7, 'rig.launch.py': 7, 'scan.launch.py': 16}[name]


def test_every_launch_file_declares_alike_what_all_have():
    loop, rig, scan = (
        {argument.name: argument for argument in LAUNCH_FILES[name]} for name in LAUNCH_FILES)
    assert loop.items() <= rig.items() <= scan.items()


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
