import importlib.util

import pytest

pytest.importorskip('rclpy')

from piezo_ros.nodes import live_speed
from piezo_ros.nodes.other_rings import missing_transport


@pytest.mark.parametrize('transport', [
    'socket',
    pytest.param('cyclone', marks=pytest.mark.skipif(
        importlib.util.find_spec('cyclonedds') is None, reason='cyclonedds is not installed'))])
def test_a_message_goes_round_over_another_transport(transport, monkeypatch):
    monkeypatch.setattr(live_speed, '_OTHER_RING_ROUNDS', 200)
    (rate,) = live_speed._other_ring(transport)
    assert rate > 0


def test_a_transport_that_is_not_installed_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr(importlib.util, 'find_spec', lambda name: None)
    assert 'pip install piezo_ros[cyclonedds]' in missing_transport('cyclone')
    assert missing_transport('socket') == ''
