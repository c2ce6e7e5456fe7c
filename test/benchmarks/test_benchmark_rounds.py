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

import json
import math
from functools import partial
from pathlib import Path

import pytest

from benchmarks.benchmark_record import (
    benchmark_record,
    changes,
    check_continues,
    joined,
    read_record,
    record_table,
)
from benchmarks.measurement import (
    BenchmarkError,
    Measurement,
    Quantity,
    Ratio,
    chosen,
    take_rounds,
)
from piezo_ros.parameters.errors import CampaignError


def measurement(name, values, group='group', missing='', better=True):
    source = iter(values)
    return Measurement(
        group, (Quantity(name, 'things/s', better),), lambda: (next(source),), lambda: missing)


def record_of(fast, slow, better=True):
    table = [measurement('fast', fast), measurement('slow', slow)]
    ratios = [Ratio('fast_over_slow', 'fast', 'slow', better)]
    return benchmark_record(table, ratios, take_rounds(table, len(fast)), len(fast))


def test_measurements_take_turns():
    order = []

    def taken(name):
        order.append(name)
        return (1.0,)

    table = [
        Measurement('g', (Quantity(name, 's', False),), partial(taken, name)) for name in 'abc']
    take_rounds(table, 2)
    assert order == list('abcabc')


def test_ratios_are_formed_round_by_round():
    # The machine is half as fast in the second round; the ratio does not see it.
    record = record_of([10.0, 5.0, 12.0], [5.0, 2.5, 4.0])
    assert record['ratios']['fast_over_slow']['values'] == [2.0, 2.0, 3.0]
    assert record['results']['fast']['median'] == 10.0
    assert record['results']['fast']['minimum'] == 5.0
    assert record['results']['fast']['maximum'] == 12.0


def test_what_cannot_be_measured_here_is_skipped_with_the_reason():
    table = [measurement('absent', [], missing='needs a unicorn'), measurement('there', [1.0])]
    readings = take_rounds(table, 1)
    assert readings.skipped == {'absent': 'needs a unicorn'}
    assert readings.values == {'there': [1.0]}
    assert 'skipped: absent: needs a unicorn' in record_table(
        benchmark_record(table, [Ratio('r', 'there', 'absent', True)], readings, 1))


@pytest.mark.parametrize('error', [CampaignError('lost a peer'), OSError('disk full')])
def test_a_measurement_that_fails_is_given_up_and_the_others_go_on(error):
    calls = []

    def fails():
        calls.append(1)
        raise error

    table = [
        Measurement('g', (Quantity('bad', 's', False),), fails), measurement('good', [1.0, 2.0])]
    readings = take_rounds(table, 2)
    assert len(calls) == 1
    assert str(error) in readings.failed['bad']
    assert readings.values == {'good': [1.0, 2.0]}


def test_a_value_that_is_no_number_is_a_failure():
    readings = take_rounds([measurement('bad', [math.nan])], 1)
    assert 'nan' in readings.failed['bad']
    assert not readings.values


def test_groups_and_quantities_can_be_chosen():
    table = [measurement('a', [], 'one'), measurement('b', [], 'two'), measurement('c', [], 'two')]
    assert chosen(table, []) == table
    assert chosen(table, ['two']) == table[1:]
    assert chosen(table, ['c', 'one']) == [table[0], table[2]]
    with pytest.raises(BenchmarkError, match="'x' is no measurement and no group; there are a, b"):
        chosen(table, ['x'])


@pytest.mark.parametrize(('factor', 'better', 'worse'), [
    (0.84, True, True), (0.86, True, False), (2.0, True, False),
    (1.16, False, True), (1.14, False, False), (0.5, False, False)])
def test_a_ratio_that_is_worse_by_more_than_15_percent_is_told(factor, better, worse):
    before = record_of([10.0], [5.0], better)
    now = record_of([10.0 * factor], [5.0], better)
    (change,) = changes(now, before)
    assert change == ('fast_over_slow', 2.0, pytest.approx(2.0 * factor), worse)


def test_only_what_both_have_is_compared():
    before = record_of([10.0], [5.0])
    del before['ratios']['fast_over_slow']
    assert changes(record_of([1.0], [5.0]), before) == []


def test_more_rounds_are_joined_to_earlier_ones():
    earlier = record_of([10.0, 12.0], [5.0, 5.0])
    table = [measurement('fast', [20.0]), measurement('slow', [5.0])]
    readings = joined(earlier, table, take_rounds(table, 1))
    record = benchmark_record(table, [Ratio('fast_over_slow', 'fast', 'slow', True)], readings, 3)
    assert record['results']['fast']['values'] == [10.0, 12.0, 20.0]
    assert record['ratios']['fast_over_slow']['values'] == [2.0, 2.4, 4.0]


def test_rounds_of_something_else_are_not_joined():
    earlier = record_of([10.0], [5.0])
    table = [measurement('fast', [20.0])]
    readings = take_rounds(table, 1)
    with pytest.raises(BenchmarkError, match='of other measurements: slow'):
        joined(earlier, table, readings)
    with pytest.raises(BenchmarkError, match='of other measurements: slow'):
        check_continues(earlier, table)
    check_continues(earlier, [*table, measurement('slow', [5.0])])
    earlier['machine']['cores'] = 10**6
    with pytest.raises(BenchmarkError, match='of another machine'):
        joined(earlier, table, readings)


REFERENCE = Path(__file__).parents[2] / 'docs' / 'bench' / 'reference.json'


def test_the_reference_can_be_read_printed_and_compared():
    record = read_record(REFERENCE)
    assert 'composed_over_ring' in record_table(record)
    found = changes(record, record)
    assert len(found) == len(record['ratios'])
    assert not any(change.worse for change in found)


def test_a_record_survives_its_file(tmp_path):
    path = tmp_path / 'bench.json'
    record = record_of([10.0, 11.0], [5.0, 5.0])
    path.write_text(json.dumps(record))
    assert read_record(path) == record
    assert record['machine']['cores'] >= 1


@pytest.mark.parametrize(('text', 'message'), [
    ('{"format_version": 1}', 'format_version 1, only 2 is known'),
    ('[]', 'format_version None'), ('nonsense', 'is no JSON')])
def test_another_file_is_refused(tmp_path, text, message):
    path = tmp_path / 'bench.json'
    path.write_text(text)
    with pytest.raises(BenchmarkError, match=message):
        read_record(path)
    with pytest.raises(BenchmarkError, match='cannot read'):
        read_record(tmp_path / 'none.json')
