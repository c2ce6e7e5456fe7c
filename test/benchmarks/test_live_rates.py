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

import pytest

pytest.importorskip('rclpy')

from benchmarks import live
from benchmarks.__main__ import main


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Shorten the measurements: their values do not matter here."""
    for name, value in {
            '_COMPOSED_PERIODS': 1.0, '_SEPARATE_PERIODS': 1.0, '_BLOCK_PERIODS': 60.0,
            '_BLOCK_ROUNDS': 200, '_OTHER_RING_ROUNDS': 200}.items():
        monkeypatch.setattr(live, name, value)


def record_of(path, names):
    assert main(['--rounds', '1', '--only', names, '--json', str(path)]) == 0
    record = json.loads(path.read_text())
    assert not record['failed']
    assert all(row['minimum'] > 0 for row in record['results'].values())
    return record


def test_the_composed_graph_is_measured_beside_its_ring(tmp_path):
    record = record_of(tmp_path / 'bench.json', 'ring_composed,graph_composed')
    assert set(record['results']) == {'ring_composed', 'graph_composed'}
    assert set(record['ratios']) == {'composed_over_ring'}


@pytest.mark.slow
@pytest.mark.parametrize(('group', 'ratios'), [
    ('composed', {'composed_over_ring', 'composed_recorded_over_unrecorded'}),
    ('separate', {
        'separate_over_ring', 'separate_recorded_over_unrecorded', 'separate_over_socket_ring'}),
    ('blocks', {'blocks_composed_over_ring', 'blocks_separate_over_ring'}),
])
def test_every_group_of_live_rates_is_measured(tmp_path, group, ratios):
    record = record_of(tmp_path / 'bench.json', group)
    assert {row['group'] for row in record['results'].values()} == {group}
    assert ratios <= set(record['ratios'])


@pytest.mark.slow
def test_footprint_and_services_are_measured(tmp_path):
    record = record_of(tmp_path / 'bench.json', 'footprint,services,python_start')
    results = record['results']
    for name in 'memory_four', 'memory_four_compiled':
        assert results[f'{name}_pss']['median'] < results[name]['median']
    assert results['latency_composed_median']['unit'] == 'ms'
    assert set(record['ratios']) == {'start_four_over_python_start'}
