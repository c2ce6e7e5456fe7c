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

"""YAML that would exhaust time, stack or memory is refused (A8); any other is read as before."""

import tracemalloc

import pytest

from piezo_ros.parameters.bounded_yaml import MAXIMUM_BYTES, YamlError, yaml_content

BOMB = 'a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n' + ''.join(
    f'a{level}: &a{level} [{", ".join([f"*a{level - 1}"] * 10)}]\n' for level in range(1, 12))


@pytest.mark.parametrize(('text', 'words'), [
    # libyaml has a bound of its own for brackets.
    ('[' * 900 + ']' * 900, 'nested deeper than 64 levels'),
    ('[' * 20_000 + ']' * 20_000, 'nested deeper than 64 levels|maximum nesting depth'),
    ('- ' * 20_000 + 'x', 'nested deeper than 64 levels'),
    ('&a [*a]', 'alias .a is for nothing or for what it lies in'),
    ('a: &a {b: {c: *a}}', 'alias .a is for nothing or for what it lies in'),
    ('*a', 'alias .a is for nothing'),
    (BOMB, 'aliases repeat more than 1000000 characters'),
    (f'a: &a {"x" * 1000}\nb: [{", ".join(["*a"] * 2000)}]', 'aliases repeat more than'),
    ('9' * 5000, 'a number of 5000 characters'),
    ('1' + ':59' * 1000, 'a number of 3001 characters'),
    ('a: [', 'expected'),
    ('!!python/object:os.system {}', 'could not determine a constructor'),
    ('2001-99-99', 'month'),
    (b'a: \xff', 'UTF-8|utf-8|utf8'),
    ('x' * (MAXIMUM_BYTES + 1), 'bytes of YAML, at most'),
], ids=lambda value: str(value)[:20])
def test_a8_yaml_out_of_bounds_is_refused_with_its_cause(text, words):
    tracemalloc.start()
    with pytest.raises(YamlError, match=words):
        yaml_content(text)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20_000_000


@pytest.mark.parametrize(('text', 'content'), [
    ('', None), ('a: 1e-5', {'a': 1e-5}), ('a: 1.5e-5\nb: [1, x]', {'a': 1.5e-5, 'b': [1, 'x']}),
    ('a: &a [1, 2]\nb: *a', {'a': [1, 2], 'b': [1, 2]}),
    ('a: &a {x: 1}\nb: {<<: *a, y: 2}', {'a': {'x': 1}, 'b': {'x': 1, 'y': 2}}),
    ('1:30', 90), (f'"{"9" * 5000}"', '9' * 5000), (b'a: \xc2\xb5', {'a': 'µ'}),
    ('[' * 60 + ']' * 60, None),
], ids=lambda value: str(value)[:20])
def test_yaml_within_the_bounds_is_read(text, content):
    found = yaml_content(text)
    if content is not None or not text:
        assert found == content


@pytest.mark.parametrize(('text', 'words'), [
    ('runs: [1]\na: 2\nruns: [3]', "the key 'runs' is in line 1 and in line 3"),
    ('a: {b: 1,\n "b": 2}', "the key 'b' is in line 1 and in line 2"),
    ('- {x: 1, x: 1}', "the key 'x' is in line 1 and in line 1"),
    ('a: &a {b: 1}\nc: [*a, {d: 1, d: 2}]', "the key 'd' is in line 2 and in line 2"),
    ('1: a\n"1": b', "the key '1' is in line 1 and in line 2"),
])
def test_a13_a_key_that_comes_twice_is_refused_with_both_lines(text, words):
    with pytest.raises(YamlError, match=words):
        yaml_content(text, as_typed=True)
    assert yaml_content(text)  # bags of other writers may have them


@pytest.mark.parametrize('text', [
    'a: &a {x: 1}\nb: {<<: *a, x: 2}', 'a: {x: 1}\nb: {x: 1}', ''])
def test_keys_that_differ_or_override_merged_ones_are_read(text):
    assert yaml_content(text, as_typed=True) == yaml_content(text)


def test_keys_and_numbers_of_other_bases_are_text_where_people_write_them():
    text = '2: 010\non: 1:30\n~: -0_7\nx: [1:30.5, 0x1F, 0, 0.5, 10]'
    assert yaml_content(text, as_typed=True) == {
        '2': '010', 'on': '1:30', '~': '-0_7', 'x': ['1:30.5', 31, 0, 0.5, 10]}
    assert yaml_content(text) == {2: 8, True: 90, None: -7, 'x': [90.5, 31, 0, 0.5, 10]}


@pytest.mark.parametrize('text', ['1e9', '1.0e9', '1E+9', '1.e9', '+1.0E9', '.1e10'])
def test_a_number_needs_neither_a_point_nor_a_sign_of_the_exponent(text):
    assert yaml_content(f'- {text}') == [1e9]


@pytest.mark.parametrize(('text', 'words'), [
    ('a: 1'.encode('utf-16'), 'it is in UTF-16 or is no text at all, save it as UTF-8'),
    ('a: 1'.encode('utf-16-le'), 'it is in UTF-16 or is no text at all'),
    (b'a: 1\nb: \xb5m', 'line 2: the byte 0xb5 is no UTF-8, save it as UTF-8'),
])
def test_a_text_of_another_encoding_is_refused_with_what_to_do(text, words):
    with pytest.raises(YamlError, match=words):
        yaml_content(text, as_typed=True)


def test_utf_8_may_have_a_mark_of_the_byte_order():
    assert yaml_content('a: µ'.encode('utf-8-sig'), as_typed=True) == {'a': 'µ'}


@pytest.mark.parametrize('text', ['a:\n\tb: 1', 'a: @b', 'a: `b`', 'a: %b'])
def test_a_character_that_begins_no_text_is_named_by_what_it_may_be(text):
    with pytest.raises(YamlError, match='indented with blanks, no tabs, and a text that begins'):
        yaml_content(text)
