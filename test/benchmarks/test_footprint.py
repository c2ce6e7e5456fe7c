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

import pytest

pytest.importorskip('rclpy')

from benchmarks import footprint
from benchmarks.footprint import service_latency_ms, start_beside_peers_s
from piezo_ros.parameters.errors import CampaignError
from piezo_ros.parameters.node_parameters import LOOP_NODES, check_node_parameters
from piezo_ros.parameters.run_and_result import PlannedRun


def planned(periods, **plant):
    parameters = {'trajectory': {'periods': periods}, 'plant': plant}
    return PlannedRun('bench', {
        node: check_node_parameters(node, parameters.get(node, {})) for node in LOOP_NODES})


def test_start_memory_and_idling_of_four_processes_are_measured(monkeypatch):
    monkeypatch.setattr(footprint, '_IDLE_S', 0.5)
    monkeypatch.setattr(footprint, '_AFTER_RUN_S', 0.1)
    result = footprint.footprint(planned(0.1))
    assert result.start_s > 0
    # Four interpreters with numpy and rclpy in them.
    assert 100 < result.rss_mb < 2000
    # They share their libraries.
    assert 50 < result.pss_mb < result.rss_mb
    assert 0 <= result.idle_percent < 100


@pytest.mark.slow
def test_the_start_beside_peers_is_measured():
    assert start_beside_peers_s(planned(0.1)) > 0


@pytest.mark.slow
def test_the_answers_of_a_running_node_are_timed():
    median, percentile_95 = service_latency_ms(planned(1e6), composed=True)
    assert 0 < median <= percentile_95


@pytest.mark.slow
def test_a_run_that_is_too_short_for_the_calls_is_told(monkeypatch):
    monkeypatch.setattr(footprint, '_DISCOVERY_S', 3.0)  # within which it ends on a busy machine
    with pytest.raises(CampaignError, match='ended before the calls did'):
        service_latency_ms(planned(0.1), composed=True)
