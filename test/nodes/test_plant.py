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

"""The plant between foreign nodes: it alone owns the voltage, and brings it back to zero."""

import signal

import numpy as np
import pytest

from piezo_ros.model import Rig, RigParameters

VOLTAGE_V = 1.5 * np.sin(0.03 * np.arange(400.0))


@pytest.fixture
def plant(rig, peer):
    """Start the plant between a foreign writer and a foreign reader."""
    def start(**parameters):
        peer.read('displacement')
        writer = peer.writer('voltage')
        # Busy machines keep processes waiting for seconds.
        process = rig.node(
            'plant', handshake_timeout_s=60.0, **{'watchdog_s': 60.0, **parameters})
        peer.wait_for_status('plant', state='active')
        return process, writer

    return start


def _rig(**parameters):
    return Rig(RigParameters(**parameters))


def _assert_end(peer, count):
    peer.wait(
        lambda: len(peer.received['displacement'][-1].data) == 2, 'the end of the displacement')
    assert list(peer.received['displacement'][-1].data) == [count, 1e-5]


@pytest.mark.parametrize('compiled', ['false', 'true'])
def test_it_opens_with_the_first_reading_and_answers_each_voltage_with_the_next(
        plant, peer, block, compiled):
    process, writer = plant(compiled=compiled, linger_s=0.0)
    rig = _rig()
    assert peer.wait_for_samples('displacement', 1) == [rig.measure()]
    start = 0
    for length in [1, 1, 2, 1, 95, 300]:
        writer.publish(block('voltage', start, VOLTAGE_V[start:start + length]))
        start += length
        displacement_um = peer.wait_for_samples('displacement', start + 1)
        assert len(displacement_um) == start + 1
    np.testing.assert_array_equal(displacement_um[1:], rig.run(VOLTAGE_V))
    assert peer.wait_for_status('plant', index=401)['voltage_v'] == VOLTAGE_V[-1]
    writer.publish(block('voltage', 400, []))
    assert peer.wait_for_status('plant', state='finished')['voltage_v'] == 0.0
    _assert_end(peer, 401)
    assert process.wait() == 0


def test_a_voltage_beyond_the_rails_drives_no_further_than_the_rail(plant, peer, block):
    _, writer = plant(noise_rms_um=0.0)
    p = RigParameters()
    high_v, low_v = (rail_v - p.operating_point_v for rail_v in (
        p.voltage_maximum_v, p.voltage_minimum_v))
    assert -100.0 < low_v < 0.0 < high_v < 100.0
    wild_v, tame_v = [100.0] * 300 + [-100.0] * 300, [high_v] * 300 + [low_v] * 300
    writer.publish(block('voltage', 0, wild_v))
    displacement_um = peer.wait_for_samples('displacement', 601)[1:]
    np.testing.assert_array_equal(displacement_um, _rig(noise_rms_um=0.0).run(tame_v))
    assert max(displacement_um) > 1.0
    assert min(displacement_um) < -1.0
    peer.wait_for_status('plant', index=601, rail_samples=600, slew_samples=0)


@pytest.mark.parametrize('refused', [np.nan, np.inf])
def test_a_voltage_that_is_no_number_never_reaches_the_rig(plant, peer, block, refused):
    _, writer = plant()
    writer.publish(block('voltage', 0, [refused]))
    writer.publish(block('voltage', 0, [0.5, refused]))
    peer.wait_for_status('plant', refused=2, index=1, voltage_v=0.0)
    writer.publish(block('voltage', 0, VOLTAGE_V))
    displacement_um = peer.wait_for_samples('displacement', 401)
    np.testing.assert_array_equal(displacement_um[1:], _rig().run(VOLTAGE_V))


def test_a_writer_that_falls_silent_ends_the_run_at_zero_volts(plant, peer, block):
    process, writer = plant(watchdog_s=0.5)
    writer.publish(block('voltage', 0, VOLTAGE_V[:10]))
    status = peer.wait_for_status('plant', state='faulted')
    assert 'no voltage for 0.5 s after sample 9' in status['reason']
    assert status['voltage_v'] == 0.0
    _assert_end(peer, 11)
    assert process.wait() == 1
    # It was silent, not gone.
    assert peer.node.count_publishers(writer.topic_name) == 1


def test_the_watchdog_waits_for_the_first_voltage(plant, peer, block):
    _, writer = plant(watchdog_s=0.01)
    peer.wait_for_samples('displacement', 1)
    reports = peer.reports['plant']
    # Reports come once a second.
    peer.wait(lambda: peer.reports['plant'] >= reports + 2, 'two more reports')
    peer.wait_for_status('plant', state='active', index=1)
    writer.publish(block('voltage', 0, [0.5]))
    assert 'no voltage' in peer.wait_for_status('plant', state='faulted', index=2)['reason']


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_plant_lands_at_zero_volts(plant, peer, block, number):
    process, writer = plant()
    writer.publish(block('voltage', 0, VOLTAGE_V[:50]))
    peer.wait_for_samples('displacement', 51)
    assert VOLTAGE_V[49] != 0.0
    process.send(number)
    status = peer.wait_for_status('plant', state='stopped')
    assert (status['voltage_v'], status['reason']) == (0.0, number.name)
    _assert_end(peer, 51)
    # Somebody wanted it so: no fault.
    assert process.wait() == 0
    assert f'run 1 stopped ({number.name})' in process.output
    assert 'ERROR' not in process.output
    assert 'Traceback' not in process.output


def test_a_plant_whose_writer_leaves_lands_at_zero_volts(plant, peer, block):
    process, writer = plant(watchdog_s=60.0)
    writer.publish(block('voltage', 0, VOLTAGE_V[:50]))
    peer.wait_for_samples('displacement', 51)
    peer.node.destroy_publisher(writer)
    status = peer.wait_for_status('plant', state='faulted')
    assert 'lost its writer after sample 49' in status['reason']
    assert status['voltage_v'] == 0.0
    assert process.wait() == 1
