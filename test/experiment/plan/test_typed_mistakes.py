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

"""Every key of parameter files and plans, typed wrongly in every way: refused, with its name."""

import dataclasses

import pytest

from piezo_ros.experiment.plan import read_plan
from piezo_ros.experiment.plan.plan_file import PLAN_KEYS
from piezo_ros.experiment.plan.run_entry import SHORT_KEYS
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.node_parameters import HARDWARE_PLANT, LOOP_NODES, parameter_sets

FIELDS = {
    (node, field.name): field.default for node in (*LOOP_NODES, HARDWARE_PLANT)
    for each in parameter_sets(node) for field in dataclasses.fields(each)}
PLAN = 'format_version: 1\nparameter_files: [typed.yaml]\nruns: [{scheme: ff}]\n'
SPELLINGS = {
    'a letter lost': lambda name: name[:len(name) // 2] + name[len(name) // 2 + 1:],
    'two letters swapped': lambda name: name[:1] + name[2] + name[1] + name[3:],
    'upper case': str.upper,
    'points': lambda name: f'{name}.x',
    'a hyphen': lambda name: f'{name}-s',
}
ANY = {'nothing': '', 'null': 'null', 'a mapping': '{a: 1}', 'a list of lists': '[[1.0]]',
       'a list of texts': '[a, b]', 'a day': '2026-01-01', 'yes and no': '[yes, no]'}
OF_NUMBERS = {
    'a unit': '300 Hz', 'a unit alone': 'Hz', 'a comma': '0,5', 'a list': '[1.0]', 'octal': '010',
    'base 60': '1:30', 'a text': 'fast', 'a truth value': 'yes', 'no number': '.nan',
    'infinite': '.inf', 'quoted': '"300"', 'thousands': "1'000", 'a space': '3 00'}
OF_TEXTS = {'a number': '3', 'a truth value': 'yes', 'a list': '[a]'}


def wrong_values(default):
    """Return how a parameter with such a default may be typed wrongly."""
    if isinstance(default, bool):
        return {**ANY, 'a text': 'yess', 'a number': '1', 'quoted': '"true"'}
    if isinstance(default, int | float):
        return {**ANY, **OF_NUMBERS}
    if isinstance(default, tuple):
        return {**ANY, 'a number': '1.0', 'a text': 'fast', 'no number': '[.nan]',
                'a unit': '[1.0 um]', 'octal': '[010]', 'infinite': '[1.0, .inf]'}
    return {**ANY, **OF_TEXTS}


def refusal(path):
    """Return what is said of a plan, '' where it is accepted."""
    try:
        read_plan(path)
    except PlanError as error:
        return str(error)
    return ''


def section(node, lines):
    """Return a parameter file of a node; of a device there is one."""
    device = '    device: simulated\n' if node == HARDWARE_PLANT else ''
    name = 'plant' if node == HARDWARE_PLANT else node
    return f'/**/{name}:\n  ros__parameters:\n{device}{lines}'


@pytest.fixture
def typed(tmp_path):
    """Return what is said of a parameter file that a plan names."""
    (tmp_path / 'plan.yaml').write_text(PLAN)

    def said(text):
        (tmp_path / 'typed.yaml').write_text(text)
        return refusal(tmp_path / 'plan.yaml')

    return said


def check(said, text, *words):
    message = said(text)
    assert message, f'accepted: {text}'
    for word in words:
        assert word in message, f'{word} is not in {message!r}, of {text}'


@pytest.mark.parametrize('node', [*LOOP_NODES, HARDWARE_PLANT])
def test_no_wrong_value_of_a_parameter_is_accepted(typed, node):
    for (own, name), default in FIELDS.items():
        if own != node or (node == HARDWARE_PLANT and name == 'device'):
            continue
        for value in wrong_values(default).values():
            check(typed, section(node, f'    {name}: {value}\n'), 'typed.yaml:', name)


@pytest.mark.parametrize('spelling', SPELLINGS)
def test_no_misspelt_parameter_is_accepted(typed, spelling):
    known = {name for _, name in FIELDS}
    for node, name in FIELDS:
        wrong = SPELLINGS[spelling](name)
        if wrong not in known:
            check(typed, section(node, f'    {wrong}: 1\n'), 'typed.yaml:', repr(wrong))


@pytest.mark.parametrize('node', LOOP_NODES)
def test_no_parameter_on_a_wrong_level_twice_or_behind_a_tab_is_accepted(typed, node):
    for own, name in FIELDS:
        if own == node:
            for text, named in (
                    (f'/**/{node}:\n  {name}: 1\n', node), (f'{name}: 1\n', name),
                    (f'/**/{node}:\n  ros__parameters: {{}}\n  {name}: 1\n', name),
                    (section(node, f'    {name}: 1\n    {name}: 1\n'), name),
                    (section(node, f'    {node}:\n      {name}: 1\n'), node)):
                check(typed, text, 'typed.yaml', named)
            check(typed, section(node, f'\t{name}: 1\n'), 'typed.yaml', 'line 3')


@pytest.mark.parametrize('spelling', [kind for kind in SPELLINGS if kind != 'points'])
@pytest.mark.parametrize('node', LOOP_NODES)
def test_no_misspelt_section_is_accepted(typed, node, spelling):
    wrong = SPELLINGS[spelling](node)
    for pattern in (wrong, f'/{wrong}', f'/**/{wrong}', f'/lab/{wrong}'):
        for own, name in FIELDS:
            if own == node:
                check(
                    typed, f'{pattern}:\n  ros__parameters: {{{name}: 1}}\n', 'typed.yaml:2', wrong)


def run_said(tmp_path, entry):
    (tmp_path / 'plan.yaml').write_text(f'format_version: 1\nruns:\n  - scheme: ff\n{entry}')
    return refusal(tmp_path / 'plan.yaml')


@pytest.mark.parametrize('key', [key for key in SHORT_KEYS if key != 'scheme'])
def test_no_wrong_value_of_a_run_is_accepted(tmp_path, key):
    default = FIELDS[SHORT_KEYS[key], key]
    values = {  # A list stands for one run each.
        kind: value for kind, value in wrong_values(default).items()
        if kind not in ('a list', 'yes and no', 'a list of texts')}
    for value in values.values():
        check(lambda text: run_said(tmp_path, text), f'    {key}: {value}\n', 'plan.yaml:', key)
    for wrong in {spelling(key) for spelling in SPELLINGS.values()} - {key}:
        check(lambda text: run_said(tmp_path, text), f'    {wrong}: 1\n', 'plan.yaml:4')


@pytest.mark.parametrize('key', PLAN_KEYS)
def test_no_wrong_value_of_a_plan_is_accepted(tmp_path, key):
    lines = {'format_version': '1', 'runs': '[{scheme: ff}]'}

    def said(text):
        (tmp_path / 'plan.yaml').write_text(text)
        return refusal(tmp_path / 'plan.yaml')

    def with_key(name, value):
        own = {**lines, name: value} if name == key else {
            **{each: text for each, text in lines.items() if each != key}, name: value}
        return ''.join(f'{each}: {text}\n' for each, text in own.items())

    values = ['', 'null', '[[1.0]]', '.nan', 'yes', '[3]']
    if key not in ('title', 'uncertainty_bound_file'):
        values.append('3 Hz')
    if key != 'sweep':  # piezo sweep looks into it
        values.append('{a: 1}')
    for value in values:
        check(said, with_key(key, value), 'plan.yaml', key.rstrip('s'))  # run 1 is …
    for spelling in SPELLINGS.values():
        check(said, with_key(spelling(key), lines.get(key, '1')), 'plan.yaml:', repr(spelling(key)))
