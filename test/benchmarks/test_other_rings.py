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

import importlib.util

import pytest

pytest.importorskip('rclpy')

from benchmarks.other_rings import missing_transport
from benchmarks.rates import other_ring_rate
from piezo_ros.parameters.errors import CampaignError


@pytest.mark.parametrize('transport', [
    'socket',
    pytest.param('cyclone', marks=pytest.mark.skipif(
        importlib.util.find_spec('cyclonedds') is None, reason='cyclonedds is not installed'))])
def test_a_message_goes_round_over_another_transport(transport):
    assert other_ring_rate(transport, 200) > 0


def test_a_ring_that_fails_is_told_with_the_error_of_its_processes():
    with pytest.raises(CampaignError, match='other_rings failed: (?s:.*)KeyError'):
        other_ring_rate('pigeon', 1)


def test_a_transport_that_is_not_installed_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr(importlib.util, 'find_spec', lambda name: None)
    assert 'pip install cyclonedds' in missing_transport('cyclone')
    assert missing_transport('socket') == ''
