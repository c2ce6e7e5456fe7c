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

"""The plant on a fake clock: answers when they are due, overruns, watchdog, and its end."""

import numpy as np
import pytest
from fake_node import activate, configure, fake_node
from fake_transport import FakeTransport, take_all

from piezo_ros.model import Rig, RigParameters
from piezo_ros.nodes.plant import Plant
from piezo_ros.runtime.streams.fault import StreamFault

PERIOD_S = 1e-3
SLOWNESS = 10.0  # seconds of the clock per simulated second
ANSWER_S = PERIOD_S * SLOWNESS


class Driven:
    """A plant that has begun a run, the writer of its voltage and the reader of its answers."""

    def __init__(self, clock, **parameters):
        self.clock = clock
        self.transport = FakeTransport()
        self.voltage = self.transport.writer('voltage')
        self.displacement = self.transport.reader('displacement')
        for end in (self.voltage, self.displacement):
            end.start(0, PERIOD_S)
        self.node = fake_node(
            Plant, self.transport, **{'sample_period_s': PERIOD_S, **parameters})
        configure(self.node)
        activate(self.node)
        self.begun_s = clock.now_s

    def poll_until(self, answers):
        """Poll until so many samples are answered; return their times since the begin."""
        times = []
        while len(times) < answers:
            before = self.displacement.subscription.messages
            count = len(before)
            self.node.poll()
            times.extend([self.clock.now_s - self.begun_s] * (len(before) - count))
        return times


@pytest.fixture
def drive(clock):
    return lambda **parameters: Driven(clock, **parameters)


@pytest.fixture
def paced(drive):
    driven = drive(realtime_factor=1.0 / SLOWNESS)
    take_all(driven.displacement)
    return driven


def test_without_a_pace_answers_take_no_time_and_have_the_bits_of_the_rig(drive, clock):
    driven = drive()
    voltages = np.linspace(0.0, 5.0, 30)
    driven.voltage.publish(voltages)
    driven.node.poll()
    assert clock.now_s == driven.begun_s
    rig = Rig(RigParameters(), PERIOD_S, compiled=False)
    assert take_all(driven.displacement) == [rig.measure(), *rig.run(voltages).tolist()]


def test_answers_come_one_period_after_each_other(paced):
    for sample in range(5):
        paced.voltage.publish_one(float(sample))
    times = paced.poll_until(5)
    assert times == pytest.approx(np.arange(1, 6) * ANSWER_S)
    assert paced.node.counts()['overruns'] == 0


def test_a_block_is_answered_when_its_last_sample_is_due(paced):
    paced.voltage.publish(np.zeros(8))
    assert paced.poll_until(1) == pytest.approx([8 * ANSWER_S])
    assert len(take_all(paced.displacement)) == 8


def test_the_wait_is_cut_into_short_naps(paced, clock):
    paced.voltage.publish(np.zeros(8))
    naps = 0
    while not take_all(paced.displacement):
        before_s = clock.now_s
        paced.node.poll()
        assert clock.now_s - before_s <= 0.005 + 1e-9
        naps += 1
    assert naps >= 16


def test_a_question_that_comes_late_is_an_overrun_and_answered_at_once(paced, clock):
    paced.voltage.publish_one(0.0)
    paced.poll_until(1)
    clock.advance(1.0)
    paced.voltage.publish_one(0.0)
    paced.voltage.publish_one(0.0)
    late_s, next_s = paced.poll_until(2)
    assert late_s == pytest.approx(ANSWER_S + 1.0)
    assert next_s == pytest.approx(late_s + ANSWER_S)
    assert paced.node.counts()['overruns'] == 1


def test_the_end_waits_for_nothing(paced, clock):
    paced.voltage.publish_one(0.0)
    paced.poll_until(1)
    before_s = clock.now_s
    paced.voltage.end()
    paced.node.poll()
    assert paced.node.run_state.result == 'finished'
    assert clock.now_s == before_s


def test_no_voltage_for_the_time_of_the_watchdog_is_a_fault(drive, clock):
    driven = drive(watchdog_s=2.0)
    clock.run(10.0, lambda: driven.node.watch(clock.now_s))  # nothing is driven yet
    driven.voltage.publish_one(5.0)
    driven.node.poll()
    driven.node.watch(clock.now_s)
    clock.run(1.9, lambda: driven.node.watch(clock.now_s))
    with pytest.raises(StreamFault, match='no voltage for 2 s after sample 0'):
        clock.run(0.3, lambda: driven.node.watch(clock.now_s))


def test_a_paced_plant_is_no_reason_for_its_own_watchdog(drive, clock):
    driven = drive(watchdog_s=0.5, realtime_factor=1.0 / SLOWNESS)
    driven.voltage.publish(np.zeros(200))  # 2 s
    while driven.node.counts()['samples'] < 201:
        driven.node.poll()
        driven.node.watch(clock.now_s)


def test_after_a_fault_the_voltage_is_ramped_to_zero_at_the_safe_slew(drive):
    driven = drive(safe_slew_v_per_s=100.0)
    driven.voltage.publish([0.0, 5.0])
    driven.node.poll()
    rig = driven.node._kept.rig
    driven_v, drive_rig = [], rig.drive

    def note(voltages):
        driven_v.extend(voltages.tolist())
        return drive_rig(voltages)

    rig.drive = note
    driven.node.run.fail('a fault')
    assert driven_v[-1] == 0.0
    steps_v = np.diff([5.0, *driven_v])
    assert np.all(steps_v < 0.0)
    assert np.all(-steps_v <= 100.0 * PERIOD_S + 1e-12)
    assert driven.node.run_state.fault == 'a fault'


@pytest.mark.parametrize('voltages', [
    [0.1, 0.2, 1e4], [1e6], [1e17], [1e300], [1.7e308], [-1.7e308], [3.0, -1e17]])
def test_a1_the_ramp_begins_at_the_rail_and_ends(drive, voltages):
    """A1: it began at what was asked for, and at 1e17 V no step made a difference."""
    driven = drive(safe_slew_v_per_s=100.0)
    driven.voltage.publish(voltages)
    driven.node.poll()
    rig = driven.node._kept.rig
    driven_v, drive_rig = [rig.driven_v], rig.drive

    def note(voltages):
        drive_rig(voltages)
        driven_v.append(rig.driven_v)

    rig.drive = note
    driven.voltage.end()
    driven.node.poll()
    assert driven.node.run_state.activity == 'finished'
    assert rig.commanded_v == 0.0
    assert len(driven_v) <= 7.0 / (100.0 * PERIOD_S) + 2
    resolution_v = 20.0 / 2**16
    assert np.abs(np.diff(driven_v)).max() <= 100.0 * PERIOD_S + resolution_v


def test_a1_a_slew_at_which_the_ramp_would_not_end_is_refused(drive):
    """A1: 1 V/s at 1e-9 s are 1e9 samples for each volt."""
    with pytest.raises(AssertionError, match='safe_slew_v_per_s is 1; .* at least'):
        drive(sample_period_s=1e-9, safe_slew_v_per_s=1.0)
    refusal = drive(sample_period_s=1e-5).node.change_parameters({'safe_slew_v_per_s': 5.0})
    assert 'it must be at least 7' in refusal
