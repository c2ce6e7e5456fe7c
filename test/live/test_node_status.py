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

"""A2: what is no status of a node is refused; A4: an unknown voltage is told as unknown."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezo_ros.live.node_status import BadStatusError, parse_status, voltage_at_the_end

GOOD = {
    'node': 'plant', 'state': 'active', 'index': 7, 'reason': '', 'by_peer': False,
    'voltage_v': 0.5, 'elapsed_s': 0.1, 'anything': ['else']}
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda parts: st.lists(parts) | st.dictionaries(st.text(), parts), max_leaves=20)


def test_a_status_is_taken_as_it_is():
    assert parse_status(json.dumps(GOOD)) == GOOD


def test_what_a_foreign_node_does_not_say_has_a_value():
    status = parse_status('{"node": "plant", "state": "finished"}')
    assert (status['index'], status['voltage_v'], status['reason']) == (0, None, '')


@pytest.mark.parametrize(('text', 'what'), [
    ('not json', 'is not JSON'),
    ('', 'is not JSON'),
    ('[' * 100_000, 'is not JSON'),
    ('[1]', 'is not an object'),
    ('7', 'is not an object'),
    ('{"a": 1}', "node is ''"),
    ('{"node": "foreign"}', "node is 'foreign'"),
    (json.dumps({**GOOD, 'index': 'seven'}), "index is 'seven'"),
    (json.dumps({**GOOD, 'index': True}), 'index is True'),
    (json.dumps({**GOOD, 'state': None}), 'state is None'),
    (json.dumps({**GOOD, 'voltage_v': math.nan}), 'voltage_v is nan'),
    (json.dumps({**GOOD, 'voltage_v': []}), r'voltage_v is \[\]'),
    (json.dumps({**GOOD, 'index': 10**400}), 'index is no number of a node'),
    (json.dumps({**GOOD, 'voltage_v': -10**400}), 'voltage_v is no number of a node'),
    (json.dumps({**GOOD, 'elapsed_s': 10**400}), 'elapsed_s is no number of a node'),
])
def test_anything_else_is_refused_by_what_is_wrong(text, what):
    with pytest.raises(BadStatusError, match=what) as raised:
        parse_status(text)
    assert len(str(raised.value)) < 300


@given(JSON)
def test_any_json_is_a_status_or_refused(value):
    try:
        status = parse_status(json.dumps(value))
    except BadStatusError:
        return
    assert status['node']


@given(st.text())
def test_any_text_is_a_status_or_refused(text):
    with pytest.raises(BadStatusError):
        parse_status(text)


def test_the_voltage_is_known_once_the_plant_has_ended_its_run():
    plant = {**GOOD, 'state': 'stopped', 'voltage_v': 0.0}
    assert voltage_at_the_end(plant, killed=False) == ['the voltage deviation is 0 V']
    assert voltage_at_the_end({}, killed=False) == []


@pytest.mark.parametrize(('plant', 'killed'), [
    (GOOD, False), (GOOD, True), ({**GOOD, 'state': 'stopped'}, True)])
def test_the_voltage_is_unknown_else(plant, killed):
    (text,) = voltage_at_the_end(plant, killed=killed)
    assert text == (
        'the voltage is unknown: the last that the plant said is 0.5 V at sample 7')


def test_of_a_plant_that_was_killed_at_once_nothing_is_known():
    (text,) = voltage_at_the_end({}, killed=True)
    assert text.startswith('the voltage is unknown')


def test_of_a_device_that_does_not_answer_any_more_nothing_is_known():
    plant = {**GOOD, 'state': 'faulted', 'voltage_v': None, 'voltage_before_v': 0.0}
    (text,) = voltage_at_the_end(plant, killed=False)
    assert text.startswith('the voltage is unknown: the device')
    assert voltage_at_the_end({**plant, 'voltage_before_v': None}, killed=False) == []
