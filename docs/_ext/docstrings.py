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

"""Docstrings as API pages show them: parameters with unit and range, |S| as it stands."""

import dataclasses
import re

from piezo_ros.model.parameters import ParameterSet, constraint_of

# What is code already, or a bar that stands for no more than itself.
_CODE_OR_BAR = re.compile(r'``.*?``|`[^`]*`|\|')
_OF_NAMED_TUPLE = re.compile(r'Alias for field number \d+')


def keep_bars(app, what, name, object_, options, lines):
    """Keep |S| an absolute value: reStructuredText would look for a substitution of that name."""
    lines[:] = [
        _CODE_OR_BAR.sub(lambda found: r'\|' if found[0] == '|' else found[0], line)
        for line in lines]


def drop_field_numbers(app, what, name, object_, options, lines):
    """Leave out what Python says of each field of a named tuple: its position."""
    lines[:] = [line for line in lines if not _OF_NAMED_TUPLE.fullmatch(line.strip())]


def describe_parameters(app, what, name, object_, options, lines):
    """List the parameters of a parameter set, with unit, default and range, below its text."""
    if what != 'class' or not (isinstance(object_, type) and issubclass(object_, ParameterSet)):
        return
    lines += ['', '.. rubric:: Values', '']
    for field in dataclasses.fields(object_):
        constraint = constraint_of(field)
        unit = f' [{constraint.unit}]' if constraint.unit else ''
        lines += [
            f'``{field.name}`` = ``{field.default!r}``{unit}', f'    {constraint.description}']


def setup(app):
    """Have docstrings changed as they are read, once numpydoc has done its part."""
    app.connect('autodoc-process-docstring', drop_field_numbers, priority=100)
    app.connect('autodoc-process-docstring', describe_parameters, priority=800)
    app.connect('autodoc-process-docstring', keep_bars, priority=900)
    return {'parallel_read_safe': True}
