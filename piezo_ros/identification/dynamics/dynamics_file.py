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

"""
The file of an identified G(s): parameters for the nodes, and the facts of the identification.

Nodes read the section of the trajectory node alone; the facts stand in a section of their own,
``/**/identified_dynamics``, for prediction, tuning and the reader.
"""

from collections.abc import Iterable, Mapping
from typing import Final

from piezo_ros.identification.yaml_text import yaml_value

__all__ = ['FACTS_SECTION', 'Fact', 'dynamics_yaml']

FACTS_SECTION: Final = '/**/identified_dynamics'
MODEL_FORMAT_VERSION: Final = 1
_SECTION: Final = 'ros__parameters'

Fact = float | int | str | list[float]


def dynamics_yaml(
    parameters: Mapping[str, Fact], facts: Mapping[str, Fact], *, source: str,
    notes: Mapping[str, str], title: str,
) -> str:
    """
    Return a ROS parameter file for the nodes.

    Parameters
    ----------
    parameters : mapping of str to value
        For the trajectory node.
    facts : mapping of str to value
        Of the identification.
    source : str
        Origin of the record, one or several lines.
    notes : mapping of str to str
        Comments by the names of parameters.
    title : str
        The first line.

    """
    lines = [
        f'# {title}',
        f'# model format_version: {MODEL_FORMAT_VERSION}',
        *(f'# source: {line}' for line in source.splitlines() or ['']),
        '/**/trajectory:',
        f'  {_SECTION}:',
        *_entries(parameters, notes),
        f'{FACTS_SECTION}:',
        f'  {_SECTION}:',
        *_entries(facts, {}),
    ]
    return '\n'.join(lines) + '\n'


def _entries(values: Mapping[str, Fact], notes: Mapping[str, str]) -> Iterable[str]:
    for name, value in values.items():
        note = f'  # {notes[name]}' if name in notes else ''
        yield f'    {name}: {yaml_value(value)}{note}'
